# SPDX-License-Identifier: BSD-3-Clause
"""A counterexample as a test of pytest, which fails until what is wrong has been put right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from flexbt_core.exploration import Bounds, Counterexample
from flexbt_core.monitors import Stated
from flexbt_core.values import one_line

from .moves import plain_moves


def tree_test(
    files: Sequence[str],
    tree: str,
    found: Iterable[Counterexample],
    given: Sequence[str] = (),
    required: Sequence[Stated] = (),
) -> str:
    """The text of a test file for what was found about a tree."""
    call = f'replay_tree({list(files)!r}, {tree!r}, moves, given={list(given)!r}{_require(required)})'
    return _text('proofs', 'replay_tree', call, f'the tree {tree!r}', found)


def behavior_test(
    name: str,
    parameters: Sequence[tuple[str, str]],
    bounds: Bounds,
    found: Iterable[Counterexample],
    required: Sequence[Stated] = (),
) -> str:
    """The text of a test file for what was found about the machine of a behavior."""
    settings = (
        f'parameters={list(parameters)!r}, operator={bounds.operator.value!r}, forces={bounds.forces}, '
        f'faults={bounds.faults}, autonomy={bounds.autonomy}{_require(required)}'
    )
    call = f'replay_behavior({name!r}, moves, {settings})'
    return _text('behavior_proofs', 'replay_behavior', call, f'the behavior {name!r}', found)


def _require(required: Sequence[Stated]) -> str:
    texts = [str(one.requirement) for one in required]
    return f', require={texts!r}' if texts else ''


def _text(room: str, function: str, call: str, what: str, found: Iterable[Counterexample]) -> str:
    lines = [f'"""What a proof has found wrong with {what}. Each test fails until that is put right."""', '']
    lines += [f'from flexbt_tools.{room} import {function}', '']
    for number, one in enumerate(found, start=1):
        if not one.violation.property.is_shown_by_a_way:
            lines += ['', f'# No steps show this, prove it again: {one_line(one.violation.text)}']
            continue
        lines += ['', f'def test_{one.violation.property.name.lower()}_{number}() -> None:']
        lines += ['    # ' + line for line in [one.violation.text, *one.lines]]
        lines += ['    moves = [', *(f'        {_move(move)},' for move in plain_moves(one.moves)), '    ]']
        lines += [f'    wrong = {call}', '    assert not wrong, wrong[0].text', '']
    return '\n'.join(line.rstrip() for line in lines)


def _move(move: list[Any]) -> str:
    return repr(move)
