# SPDX-License-Identifier: BSD-3-Clause
"""Texts of errors: places in files and scripts, causes, and traces that are too long."""

from __future__ import annotations

import pytest

from flexbt_core.behavior_tree.model.errors import (
    ElementError,
    FailureStep,
    FailureTrace,
    LoadError,
    NodeExecutionError,
    ScriptError,
    Source,
    TreeLoadError,
)

TEXT = '<a b="1" c=\'2\'/>\n  word x\n"open'


@pytest.mark.parametrize(
    ('offset', 'start', 'end'),
    [
        (0, (1, 1), (1, 17)),  # a tag
        (3, (1, 4), (1, 9)),  # an attribute
        (9, (1, 10), (1, 15)),
        (19, (2, 3), (2, 7)),  # a word
        (26, (3, 1), (3, 2)),
        (27, (3, 2), (3, 6)),
        (len(TEXT), (3, 6), (3, 6)),
    ],
)
def test_an_error_in_a_file_has_its_place(offset: int, start: tuple[int, int], end: tuple[int, int]) -> None:
    error = Source('f.xml', TEXT).error(offset, 'wrong', '<a>')
    assert error == LoadError('f.xml', *start, '<a>', 'wrong', end=end)
    assert str(error) == f'f.xml:{start[0]}:{start[1]}: <a>: wrong'


def test_errors_of_files_are_short_texts_in_a_row() -> None:
    long = Source('f.xml', TEXT).error(0, 'm' * 600, 'n' * 300)
    assert (len(long.node), len(long.message)) == (200, 500)
    errors = LoadError('f', 0, 0, '', 'all of it'), LoadError('f', 0, 0, '<a>', 'one'), LoadError('f', 1, 2, '', 'at')
    assert str(TreeLoadError(errors)) == 'f: all of it\nf: <a>: one\nf:1:2: at'
    assert str(ElementError([('a', 'is wrong'), ('b', 'is missing')])) == '[a] is wrong; [b] is missing'


@pytest.mark.parametrize(
    ('script', 'offset', 'place'),
    [
        ('a := ', 5, 'column 6'),
        ('a\nbcd', 4, 'line 2, column 3'),
        ('a\nbcd', 0, 'line 1, column 1'),
        ('ab\n\ncd', 4, 'line 3, column 1'),
    ],
)
def test_an_error_in_a_script_has_its_place(script: str, offset: int, place: str) -> None:
    error = ScriptError(script, offset, 'a value is missing')
    assert str(error) == f'a value is missing ({place} of the script [{script}])'
    assert not error.is_absent
    assert len(str(ScriptError('x' * 500, 0, ''))) == len(str(ScriptError('x' * 200, 0, '')))


class Unprintable(Exception):
    def __str__(self) -> str:
        raise ValueError


@pytest.mark.parametrize(
    ('cause', 'reason'),
    [
        ('too late', 'too late'),
        (ValueError('too late'), 'ValueError: too late'),
        (ValueError(), 'ValueError'),
        (Unprintable(), 'Unprintable: its text cannot be made'),
    ],
)
def test_an_error_of_a_node_has_its_cause(cause: BaseException | str, reason: str) -> None:
    error = NodeExecutionError('in/x', 'Wait', cause, 7)
    assert str(error) == f'exception in node [in/x] (Wait): {reason}'
    assert (error.cause, error.reason) == (None if isinstance(cause, str) else cause, reason)
    assert error.trace == FailureTrace((FailureStep('in/x', reason),))
    assert (error.node_path, error.node_id, error.uid) == ('in/x', 'Wait', 7)
    assert NodeExecutionError('x', 'Wait', '').uid == 0


@pytest.mark.parametrize(('most', 'head', 'tail'), [(6, '012', '56'), (5, '01', '56'), (4, '01', '6'), (3, '0', '6')])
def test_a_long_trace_keeps_both_ends(most: int, head: str, tail: str) -> None:
    trace = FailureTrace(tuple(FailureStep(str(number), 'failed') for number in range(7)))
    lines = [*(f'{number}: failed' for number in head), f'({7 - most + 1} nodes in between)']
    assert trace.lines(most) == [*lines, *(f'{number}: failed' for number in tail)]
    assert trace.lines(7) == [f'{number}: failed' for number in range(7)]
