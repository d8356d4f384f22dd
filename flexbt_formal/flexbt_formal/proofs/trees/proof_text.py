# SPDX-License-Identifier: BSD-3-Clause
"""What a proof has found, for a mission engineer and for programs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Final

from flexbt_core.values import counted
from flexbt_formal.exploration import Counterexample, Progress, Property, Report

_SHOWN: Final = 20
_REMEDIES: Final = {
    Property.NO_DEADLOCK: 'have the node call wake() or wake_at(), give it a time limit, or another outcome for that',
    Property.CAN_END: 'lead out of there: by a limit of attempts or a Timeout in a tree, by a transition in a machine',
    Property.REACHABLE: 'leave it out, or mend what keeps it from being used: ports, order of children, control above',
    Property.LIMITS: 'put it where it is ticked again after its child has succeeded, such as into a PipelineSequence, '
    'or leave it out',
    Property.LISTENS: 'put it below a ReactiveFallback or ReactiveSequence, before what works: in each tick',
    Property.POSSIBLE: 'lead back from there, as reactive controls and further attempts do, or do not require it',
    Property.NO_LIVELOCK: 'wait in the loop, or limit how often it goes round',
    Property.DATA: 'write the key on every way to there, or give the machine or tree a default',
    Property.ONE_WRITER: 'give each a key of its own, or let one of them end before the other begins',
    Property.PRECONDITION: 'bring it about before, and look whether a condition is inverted, or the children swapped',
    Property.DEADLINE: 'put a Timeout around it that is no longer than the deadline',
    Property.ONE_OWNER: 'let one of them end before the other begins',
    Property.RECOVERY: 'have what it waits for confirm a cancel, or end by a time limit',
    Property.HALTED: 'have the node above it halt its children, as ControlNode.reset_children does',
}


class ProgressLine:
    """One line of the standard error, written over and over; nothing where that is no terminal."""

    def __init__(self, is_shown: bool) -> None:
        self._is_shown = is_shown and sys.stderr.isatty()

    def tell(self, name: str, progress: Progress) -> None:
        """Show how far an exploration has come."""
        self.show(
            f'{name}: {progress.configurations} situations, {progress.waiting} to follow, {progress.seconds:.0f} s'
        )

    def show(self, text: str) -> None:
        """Show a text in the place of the one before."""
        if self._is_shown:
            print(f'\r{text}'.ljust(79)[:79], end='', file=sys.stderr, flush=True)

    def end(self) -> None:
        """Take the line away."""
        if self._is_shown:
            print('\r'.ljust(80) + '\r', end='', file=sys.stderr, flush=True)


def report_lines(report: Report) -> Iterator[str]:
    """A report: the verdict, of what it holds, what is wrong with the way to it, and what was never taken."""
    size = f'{report.configurations} situations, {report.steps} steps, {report.seconds:.1f} s'
    number = len(report.counterexamples)
    wrong = f'{counted(number, "thing")} wrong' if number else 'nothing wrong'
    if report.is_complete:
        yield f'{report.name}: {wrong} ({size})'
        yield f'  followed to the end: {report.bounds}'
    else:
        why = report.stopped_by or 'too many ways to answer in one step'
        yield f'{report.name}: {wrong} as far as it was followed ({size})'
        yield f'  NOT followed to the end ({why}): all ways of up to {max(report.depth - 1, 0)} steps: {report.bounds}'
    ends = ', '.join(sorted(report.ends)) or 'in no way'
    is_cut = any(
        one.violation.property.is_shown_by_a_way and not one.violation.is_lasting for one in report.counterexamples
    )
    yield f'  it can end: {ends}' + ('; what may come after something wrong was not followed' if is_cut else '')
    yield f'  reached: {report.covered} of {report.coverable}' + (
        '' if not report.uncovered else f'; never: {_some(report.uncovered)}'
    )
    for note in report.notes:
        yield f'  note: {note}'
    for found in report.counterexamples:
        yield from _counterexample_lines(found)


def _some(names: tuple[str, ...]) -> str:
    rest = len(names) - _SHOWN
    return ', '.join(names[:_SHOWN]) + (f' and {rest} more' if rest > 0 else '')


def _counterexample_lines(found: Counterexample) -> Iterator[str]:
    kind = found.violation.property
    yield f'  WRONG: {found.violation.text}'
    yield f'    it should be: {kind.value}'
    if kind in _REMEDIES:
        yield f'    remedy: {_REMEDIES[kind]}'
    if not found.moves:
        return  # what never happens, or is so from the beginning: there is no way to show
    yield f'    the shortest way to it ({counted(len(found.moves), "step")}):'
    yield from (f'      {line}' for line in found.lines)
