# SPDX-License-Identifier: BSD-3-Clause
"""Counterexamples as tests of pytest, which fail until the violation is fixed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexbt_core.monitors.properties import Violation
from flexbt_core.monitors.requirement_text import StatedRequirement
from flexbt_core.values.text import one_line
from flexbt_formal.exploration.model import Counterexample
from flexbt_tools.errors import UsageError
from flexbt_tools.trees.files import BY_PACKAGE, STDIN

from .proof_report import plain_moves


class File(NamedTuple):
    """A file that a test reads: found from the folder of the test, or by its package, wherever pytest is run."""

    name: str

    def expression(self, test: str) -> str:
        """Return the expression for this file in the code of the test file ``test``. Raises UsageError."""
        if self.name == STDIN:
            raise UsageError('--save-test: a test cannot read the standard input again; give a file')
        if self.name.startswith(BY_PACKAGE):
            return repr(self.name)
        relative = os.path.relpath(Path(self.name).resolve(), Path(test).resolve().parent)
        return f'str(HERE / {relative!r})'


class Replay(NamedTuple):
    """Counterexamples, and the call by which a test replays one.

    ``function`` is one of this package. ``settings`` are its arguments other than the moves; empty ones are omitted.
    ``what`` is for people.
    """

    what: str
    function: Callable[..., list[Violation]]
    settings: Mapping[str, Any]
    counterexamples: Sequence[Counterexample]

    def call(self, test: str) -> str:
        """Return the code of the call for the test file ``test``."""
        given = [f'{name}={_expression(value, test)}' for name, value in self.settings.items() if value not in ('', [])]
        return f'{self.function.__name__}({", ".join(["moves=moves", *given])})'


def saved_test(test: str, wrong: Iterable[Replay]) -> str:
    """Return the code of the test file ``test`` for these counterexamples. Raises UsageError if a test cannot read
    their files."""
    found = [replay for replay in wrong if replay.counterexamples]
    what = ', '.join(dict.fromkeys(replay.what for replay in found))
    functions = {replay.function for replay in found}
    imports = sorted(f'from {function.__module__} import {function.__name__}' for function in functions)
    lines = [f'"""What a proof has found wrong with {one_line(what)}. Each test fails until that is put right."""', '']
    calls = [replay.call(test) for replay in found]
    if any('HERE / ' in call for call in calls):
        lines += ['from pathlib import Path', '', *imports, '', 'HERE = Path(__file__).resolve().parent', '']
    else:
        lines += [*imports, '']
    number = 0
    for call, replay in zip(calls, found, strict=True):
        for one in replay.counterexamples:
            number += 1
            if not one.violation.property.is_shown_by_a_way:
                lines += ['', f'# No steps show this, prove it again: {one_line(one.violation.text)}']
                continue
            lines += ['', f'def test_{one.violation.property.name.lower()}_{number}() -> None:']
            lines += [f'    # {one_line(line, 500)}' for line in (one.violation.text, *one.lines)]
            lines += ['    moves = [', *(f'        {move!r},' for move in plain_moves(one.moves)), '    ]']
            lines += [f'    wrong = {call}', '    assert not wrong, wrong[0].text', '']
    return '\n'.join(line.rstrip() for line in lines) + '\n'


def requirement_texts(required: Iterable[StatedRequirement]) -> list[str]:
    """Return the texts of requirements, as arguments of a test."""
    return [str(one.requirement) for one in required]


def _expression(value: Any, test: str) -> str:
    if isinstance(value, File):
        return value.expression(test)
    if isinstance(value, list):
        return f'[{", ".join(_expression(one, test) for one in value)}]'
    return repr(value)
