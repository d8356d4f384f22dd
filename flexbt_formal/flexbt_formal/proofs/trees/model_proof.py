# SPDX-License-Identifier: BSD-3-Clause
"""What was found of the properties of a model, for a mission engineer and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from flexbt_formal.roaml import Result

_FIRST: Final = 10
_LAST: Final = 50
"""Lines of a long way that are printed."""


def result_lines(result: Result) -> Iterator[str]:
    """A property: the verdict, how that was found, and how it can fail."""
    yield f'  {result.asked.name}: {_VERDICTS[result.holds]}, probability {_probability(result)}'
    yield f'    {result.asked.text}{_demanded(result)}'
    yield f'    {result.how}, {result.seconds:.1f} s'
    for note in result.notes:
        yield f'    note: {note}'
    if result.way and result.holds is not True:
        kind = 'the shortest way' if result.is_exact else 'the shortest way that was met'
        yield f'    {kind} to where it has failed:'
        yield from (f'      {line}' for line in _shown(result.way))


_VERDICTS: Final = {True: 'holds', False: 'CAN FAIL', None: 'NOT DECIDED'}


def _probability(result: Result) -> str:
    if result.is_exact:
        return f'{result.value:.6g}'
    return f'{result.value:.4g} (between {result.low:.4g} and {result.high:.4g})'


def _demanded(result: Result) -> str:
    if result.asked.demand is None:
        return ''
    sign, value = result.asked.demand
    return f' {sign} {value:g}'


def _shown(way: Sequence[str]) -> Sequence[str]:
    hidden = len(way) - _FIRST - _LAST
    if hidden <= 1:
        return way
    return [*way[:_FIRST], f'... {hidden} lines, which --json has ...', *way[-_LAST:]]


def result_as_json(result: Result) -> dict[str, Any]:
    """A property for programs."""
    return {
        'name': result.asked.name,
        'text': result.asked.text,
        'demand': None if result.asked.demand is None else list(result.asked.demand),
        'holds': result.holds,
        'value': result.value,
        'low': result.low,
        'high': result.high,
        'how': result.how,
        'exact': result.is_exact,
        'complete': result.is_complete,
        'size': result.size,
        'seconds': round(result.seconds, 3),
        'notes': list(result.notes),
        'way': list(result.way),
    }
