# SPDX-License-Identifier: BSD-3-Clause
"""Results of proofs and of comparisons, as text for a mission engineer and as JSON for programs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.values.findings import FindingRecord, finding_record
from flexbt_core.values.text import pluralize
from flexbt_formal.exploration.comparison import Comparison
from flexbt_formal.exploration.model import Counterexample, Label, Move, Report, System

_SHOWN: Final = 20
_PROGRESS_SECONDS: Final = 0.5
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
    """A line of progress on the standard error, rewritten twice a second; without a terminal it shows nothing."""

    def __init__(self, is_shown: bool) -> None:
        self._is_shown = is_shown and sys.stderr.isatty()
        self._name = ''
        self._began = self._shown = 0.0

    def show(self, name: str, known: int, left: int) -> None:
        """Show the progress of ``name``: the numbers of known and of remaining situations or runs."""
        now = time.monotonic()
        if name != self._name:
            self._name, self._began, self._shown = name, now, now
        if self._is_shown and now - self._shown >= _PROGRESS_SECONDS:
            self._shown = now
            text = f'{name}: {known} known, {left} to do, {now - self._began:.0f} s'
            print(f'\r{text}'.ljust(79)[:79], end='', file=sys.stderr, flush=True)

    def end(self) -> None:
        """Remove the line."""
        if self._is_shown:
            print('\r'.ljust(80) + '\r', end='', file=sys.stderr, flush=True)


def report_lines(report: Report) -> Iterator[str]:
    """Yield the lines of a report: verdict, bounds, violations with their paths, and uncovered parts."""
    size = f'{report.configurations} situations, {report.steps} steps, {report.seconds:.1f} s'
    number = len(report.counterexamples)
    wrong = f'{pluralize(number, "thing")} wrong' if number else 'nothing wrong'
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
        return  # a violation without steps: an event that never happens, or a fault at the start
    yield f'    the shortest way to it ({pluralize(len(found.moves), "step")}):'
    yield from (f'      {line}' for line in found.lines)


# The differences from the previous version, for a mission engineer and for programs.


class Compared(NamedTuple):
    """The result for a version compared with the previous one. ``only`` is ``before`` or ``now`` if just that version
    has it."""

    name: str
    comparison: Comparison = Comparison(0, 0, 0.0, '', (), 0)
    only: str = ''

    @property
    def is_same(self) -> bool:
        """True if no difference between the versions was found."""
        return not self.only and self.comparison.is_same


def comparison_lines(compared: Compared) -> Iterator[str]:
    """Yield the lines of a comparison: the verdict, and the shortest path to each difference."""
    if compared.only:
        yield f'{compared.name}: DIFFERS: it is there only {compared.only}'
        return
    found = compared.comparison
    number = len(found.differences) + found.more
    size = f'{found.situations} situations of both, {found.steps} steps, {found.seconds:.1f} s'
    verdict = pluralize(number, 'difference') if number else 'does the same'
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
    """Return a comparison as plain data for JSON."""
    found = compared.comparison
    plain = {name: value for name, value in vars(found).items() if name not in _LEFT_OUT}
    return {
        'name': compared.name,
        'only': compared.only,
        'complete': found.is_complete,
        **plain,
        'seconds': round(found.seconds, 3),
        'differences': [{'way': one.lines, 'before': one.before, 'now': one.now} for one in found.differences],
    }


# Reports for programs.


_NAMES: Final = {'is_complete': 'complete', 'uncovered': 'never', 'counterexamples': 'wrong'}
"""Names in JSON of the fields of a report that are renamed."""
_LEFT_OUT: Final = ('make', 'checked_restores')


def report_as_json(report: Report) -> dict[str, Any]:
    """Return a report as plain data for JSON."""
    plain = {_NAMES.get(name, name): value for name, value in vars(report).items() if name not in _LEFT_OUT}
    return plain | {
        'seconds': round(report.seconds, 3),
        'written': {name: sorted(keys) for name, keys in sorted(report.written.items())},
        'wrong': [
            {
                'property': found.violation.property.name,
                'where': found.violation.where,
                'text': found.violation.text,
                'lasting': found.violation.is_lasting,
                'moves': plain_moves(found.moves),
                'way': found.lines,
            }
            for found in report.counterexamples
        ],
    }


def proof_findings(report: Report, places: Mapping[str, LoadError]) -> Iterator[FindingRecord]:
    """Yield what is wrong as findings. ``places`` are those of nodes, by their paths: a finding is at the node where it
    happens, or else at the first one that its text names."""
    for found in report.counterexamples:
        kind, where, text, _ = found.violation
        words = [where, *map(_bare, text.split())]
        named = (places[word] for word in (*words, *map(_without_number, words)) if word in places)
        place = next(named, LoadError('', 0, 0, where, ''))
        yield finding_record(
            kind.name.lower().replace('_', '-'),
            'error',
            text,
            file=place.file,
            start=(place.line, place.column),
            end=place.end,
            node=where,
            fix=_REMEDIES.get(kind, ''),
        )


def _without_number(word: str) -> str:
    """Return the path of one of several nodes of one name."""
    return word.rpartition('::')[0]


def _bare(word: str) -> str:
    return word.strip(',;:()[]')


def report_of(plain: dict[str, Any], make: Callable[[], System]) -> Report:
    """Return the report from the data of :func:`report_as_json`, for the system that ``make`` returns.

    Raises KeyError, TypeError or ValueError if the data is not a report.
    """
    names = [field.name for field in fields(Report) if field.name not in _LEFT_OUT]
    values = {name: plain[_NAMES.get(name, name)] for name in names}
    wrong = [
        Counterexample(
            Violation(Property[one['property']], one['where'], one['text'], one['lasting']),
            moves_of(one['moves']),
            tuple(one['way']),
        )
        for one in plain['wrong']
    ]
    return Report(
        **values
        | {
            'counterexamples': tuple(wrong),
            'notes': tuple(plain['notes']),
            'uncovered': tuple(plain['never']),
            'written': {name: frozenset(keys) for name, keys in plain['written'].items()},
        },
        make=make,
    )


# The steps of a proof as plain data, for tests and for JSON.


def plain_moves(moves: Iterable[Move]) -> list[list[Any]]:
    """Return each step as a list of kind, subject, value and answers."""
    return [[*label, list(answers)] for label, answers in moves]


def moves_of(plain: Iterable[Sequence[Any]]) -> tuple[Move, ...]:
    """Return the steps from the data of :func:`plain_moves`."""
    return tuple(Move(Label(kind, subject, value), tuple(answers)) for kind, subject, value, answers in plain)
