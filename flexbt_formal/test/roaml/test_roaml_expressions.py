# SPDX-License-Identifier: BSD-3-Clause
"""The expressions of models, and probabilities in graphs."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_formal.roaml.expressions import ExpressionError, constant, parse_expression
from flexbt_formal.roaml.probabilities import BAD, GOOD, GraphChoices, reach


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1 + 2 * 3 - 4 / 2', 5.0),
        ('-7 % 3', -1),
        ('(1 + 2) * -3', -9),
        ('1 < 2 && !(2 <= 1) || false', True),
        ('1 == 1.0 && 1 !== 2', True),
        ('true ? 1 : false ? 2 : 3', 1),
        ('Math.min(3, 1, 2) + Math.max(4, 5) + Math.floor(-1.5) + Math.abs(-2)', 6),
        ('Math.pow(2, 10)', 1024),
        ('[1, [2, 3]][1][0]', 2),
        ("{'a': [1, 2], b: 'x'}.a.length", 2),
        ("'it\\'s' + \"\\n\"", "it's\n"),
        ("'abc'.length", 3),
        ("'é'.length == 2 && 'é'[1] == 169", True),  # a text is its bytes
        ('1e3 + .5', 1000.5),
        ('- -1', 1),
    ],
)
def test_an_expression_has_the_value_of_ecmascript(text: str, value: Any) -> None:
    found = constant(parse_expression(text))
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    'text',
    [
        '',
        '1 +',
        '(1',
        '1 2',
        'a',
        '__import__("os")',
        'Math.max()',
        'True',
        '[1, 2',
        "'a",
        '1 @ 2',
        '(' * 1000,
        'x' * 30_000,
    ],
)
def test_what_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        constant(parse_expression(text))


@given(st.text(alphabet='01.+-*/%<>=!&|()[]{},:?\'"ab \n', max_size=40))
def test_no_text_does_harm(text: str) -> None:
    with contextlib.suppress(ExpressionError):
        constant(parse_expression(text))


@given(st.integers(2, 30), st.floats(0.05, 0.95))
def test_a_walk_between_two_ends(length: int, up: float) -> None:
    """Gambler's ruin: from the middle of a line to its upper end."""
    graph: list[GraphChoices] = [[], []]
    for place in range(1, length):
        above = GOOD if place == length - 1 else place + 2
        below = BAD if place == 1 else place
        graph.append([[(up, above), (1.0 - up, below)]])
    values, is_exact = reach(graph, is_least=True)
    assert is_exact
    ratio = (1.0 - up) / up
    for place in range(1, length):
        wanted = place / length if math.isclose(ratio, 1.0) else (1 - ratio**place) / (1 - ratio**length)
        assert values[place + 1] == pytest.approx(wanted, abs=1e-9)


def test_least_and_greatest_over_choices_and_circles() -> None:
    # 2 may go round for ever, or take a chance of 1/2.
    graph: list[GraphChoices] = [[], [], [[(1.0, 3)], [(0.5, GOOD), (0.5, BAD)]], [[(1.0, 2)]]]
    assert reach(graph, is_least=True)[0][2] == 0.0
    assert reach(graph, is_least=False)[0][2] == pytest.approx(0.5)
    assert reach([[], [], [[(0.9, 2), (0.1, GOOD)]]], is_least=True)[0][2] == pytest.approx(1.0)
