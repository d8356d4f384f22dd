# SPDX-License-Identifier: BSD-3-Clause
"""What something does otherwise than its version before: for a mission engineer, and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from flexbt_core.values import counted
from flexbt_formal.exploration import Comparison


class Compared(NamedTuple):
    """What was found of something beside its version before; ``only``: the one version that has it, ``before`` or
    ``now``."""

    name: str
    comparison: Comparison = Comparison(0, 0, 0.0, '', (), 0)
    only: str = ''

    @property
    def is_same(self) -> bool:
        """Whether nothing was found that tells the versions apart."""
        return not self.only and self.comparison.is_same


def comparison_lines(compared: Compared) -> Iterator[str]:
    """What both do, and the shortest way to where each difference begins."""
    if compared.only:
        yield f'{compared.name}: DIFFERS: it is there only {compared.only}'
        return
    found = compared.comparison
    number = len(found.differences) + found.more
    size = f'{found.situations} situations of both, {found.steps} steps, {found.seconds:.1f} s'
    verdict = counted(number, 'difference') if number else 'does the same'
    verdict += '' if found.is_complete else ' as far as it was followed'
    yield f'{compared.name}, against before: {verdict} ({size})'
    if found.is_complete:
        yield '  followed to the end, or to where they differ: what begins, with which inputs, what ends, when, and how'
    else:
        yield f'  NOT followed to the end ({found.stopped_by})'
    for difference in found.differences:
        yield '  DIFFERS; the shortest way to it:'
        yield from (f'      {line}' for line in difference.lines)
        for version, lines in (('before', difference.before), ('now', difference.now)):
            yield f'    {version}:'
            yield from (f'           {line}' for line in lines)
    if found.more:
        yield f'  {found.more} more, farther from the beginning'


def comparison_as_json(compared: Compared) -> dict[str, Any]:
    """A comparison for programs."""
    found = compared.comparison
    return {
        'name': compared.name,
        'only': compared.only,
        'complete': found.is_complete,
        'stopped_by': found.stopped_by,
        'situations': found.situations,
        'steps': found.steps,
        'seconds': round(found.seconds, 3),
        'differences': [
            {'way': list(one.lines), 'before': list(one.before), 'now': list(one.now)} for one in found.differences
        ],
        'more': found.more,
    }
