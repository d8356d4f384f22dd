# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool``, ``behavior_tool`` and other commands, as tests call them: in this process, with what they print."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from flexbt_tools.cli import behavior_tool as behavior_executable
from flexbt_tools.cli.bt_tool import main

_SHARED_DATA = Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).resolve().parents[4] / 'shared/data'))
STOCK_TREES = sorted((_SHARED_DATA / 'nav2/jazzy_trees').glob('*.xml'))
"""Those of Nav2, where they are at hand."""


class Done(NamedTuple):
    """What a command has left."""

    code: int
    out: str
    err: str


def called(main: Callable[[Sequence[str]], int], words: Sequence[str]) -> Done:
    """Runs the main function of a command; the standard streams are caught."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as exit:  # of argparse
            assert isinstance(exit.code, int)
            code = exit.code
    return Done(code, out.getvalue(), err.getvalue())


def tool(*words: str) -> Done:
    """Runs ``bt_tool``."""
    return called(main, words)


def document(*trees: str, main: str | None = 'Main') -> str:
    """A file; each tree begins with its ID: ``Main: <AlwaysSuccess/>``, and stands on a line of its own."""
    head = '<root BTCPP_format="4"' + (f' main_tree_to_execute="{main}">' if main else '>')
    parts = [tree.partition(':') for tree in trees]
    bodies = [f'<BehaviorTree ID="{id}">{body.strip()}</BehaviorTree>' for id, _, body in parts]
    return '\n'.join([head, *bodies, '</root>'])


def without_marks(text: str) -> tuple[str, list[str]]:
    """A text in which ``^`` stands before places, without these marks, and the places as ``line:column``."""
    places = []
    while (position := text.find('^')) >= 0:
        line = text.count('\n', 0, position) + 1
        places.append(f'{line}:{position - text.rfind(chr(10), 0, position)}')
        text = text[:position] + text[position + 1 :]
    return text, places


def behavior_tool(*words: str) -> Done:
    """Run ``behavior_tool``."""
    return called(behavior_executable.main, words)
