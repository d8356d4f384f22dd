# SPDX-License-Identifier: BSD-3-Clause
"""The rules of the mission queue, without ROS: who may change it, which entry is next, and what follows a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from flexbt_common.values.queue_options import OnFailure
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED
from flexbt_core.values.text import sanitize_for_message
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.persistence.queue_entries import Change, EndedRun, QueueEntry, QueueState

ENTRIES: Final = 100
"""Maximum number of entries."""

QUEUE_SIZE: Final = 4_000_000
"""Maximum bytes and characters of the arguments and inputs of all entries."""

FAILURES: Final = frozenset({'failed', 'canceled', 'aborted', PREEMPTED, ERROR})
"""Outcomes that are failures if an entry does not name those that are wanted."""

_TEXT: Final = 500


class MissionQueue:
    """The queue of one executive. ``write`` makes a change durable after ``state`` has it.

    ``running`` is the number of the entry whose run goes on, 0 for none.
    """

    def __init__(self, state: QueueState, write: Callable[[Change], None]) -> None:
        self.state = state
        self.running = 0
        self._write = write

    def add(self, entry: QueueEntry) -> int:
        """Add an entry, and return its number.

        Raises:
            CommandRefusedError: the queue is full.
        """
        if len(self.state.entries) >= ENTRIES:
            raise CommandRefusedError(f'the queue has {ENTRIES} entries already; remove some')
        self._check_size(entry)
        number = self.state.last_entry + 1
        self._apply(entries=_placed(self.state.entries, replace(entry, number=number)), last_entry=number)
        return number

    def edit(self, changed: QueueEntry) -> None:
        """Replace options and autonomy of the entry of the same number, and arguments and inputs that are given.

        Raises:
            CommandRefusedError: there is no such entry, or it has changed meanwhile, or it is too large.
        """
        entry = self.entry(changed.number)
        if entry.revision != changed.revision:
            raise CommandRefusedError(f'entry {entry.number} was changed meanwhile; look at it again')
        arguments, inputs = changed.arguments or entry.arguments, changed.inputs or entry.inputs
        new = replace(
            entry,
            revision=entry.revision + 1,
            options=changed.options,
            autonomy=changed.autonomy,
            arguments=arguments,
            inputs=inputs,
            failures=0,
            due=entry.due if changed.options.interval == entry.options.interval else 0.0,
        )
        self._check_size(new)
        entries = self.state.entries
        is_moved = new.options.priority != entry.options.priority
        self._apply(entries=_placed(entries, new) if is_moved else {**entries, new.number: new})

    def remove(self, number: int) -> None:
        """Remove an entry. A run of it goes on, and is its last one.

        Raises:
            CommandRefusedError: there is no such entry.
        """
        self._apply(entries=_without(self.state.entries, self.entry(number)))

    def move(self, number: int, before: int) -> None:
        """Move an entry before another one; 0: behind all of its priority.

        Raises:
            CommandRefusedError: there is no such entry, or the other one has another priority.
        """
        entry = self.entry(number)
        priority = entry.options.priority
        if before and (other := self.entry(before).options.priority) != priority:
            raise CommandRefusedError(
                f'entry {before} has the priority {other}, and entry {number} {priority}: change the priority instead'
            )
        if before != number:
            self._apply(entries=_placed(self.state.entries, entry, before))

    def clear(self, newest: int) -> int:
        """Remove all entries up to a number, and return how many. A run of one goes on."""
        left = {number: entry for number, entry in self.state.entries.items() if number > newest}
        gone = len(self.state.entries) - len(left)
        self._apply(entries=left)
        return gone

    def hold(self, why: str) -> None:
        """Start no further entry until the release. A later hold replaces an earlier one, which cannot be released."""
        self._apply(**self._held(why))

    def release(self, hold: int) -> None:
        """End a hold.

        Raises:
            CommandRefusedError: the queue is not held, or held for another reason than the operator has seen.
        """
        if not self.state.hold:
            raise CommandRefusedError('the queue is not held')
        if hold != self.state.hold:
            raise CommandRefusedError(f'the queue is held for another reason meanwhile: {self.state.held}')
        self._apply(hold=0, held='')

    def entry(self, number: int) -> QueueEntry:
        """Return the entry of this number. Raises CommandRefusedError if there is none."""
        found = self.state.entries.get(number)
        if found is None:
            raise CommandRefusedError(f'the queue has no entry {number}; it may have ended, or was removed')
        return found

    def next(self, obstacle: Callable[[QueueEntry], str]) -> QueueEntry | None:
        """Return the first entry without an obstacle; None if there is none, or the queue is held."""
        if self.state.hold or self.running:
            return None
        return next((entry for entry in self.state.entries.values() if not obstacle(entry)), None)

    def settle(self, end: EndedRun, now: float, started: float | None = None) -> str:
        """Note that a run of an entry has ended; ``now`` and ``started`` are times on the executive's clock, s.

        Return the reason if the queue is held because of that; '' if not.
        """
        self.running = 0
        self.state = replace(self.state, ended=end)  # as the journal has it
        entries, why = self._after(end, now, now if started is None else started)
        if not entries:
            why = ''  # nothing is left that could start
        self._apply(entries=entries, ended=None, **(self._held(why) if why else {}))
        return why

    def _after(self, end: EndedRun, now: float, started: float) -> tuple[Mapping[int, QueueEntry], str]:
        """Return the entries after a run, and why the queue has to be held, or ''."""
        entries = self.state.entries
        entry = entries.get(end.number)
        message = sanitize_for_message(end.message, _TEXT)
        ended = f'by {end.outcome!r}' if end.outcome else 'before it began'
        what = f'entry {end.number} ended {ended}' + (f': {message}' if message else '')
        is_interrupted = end.outcome in (PREEMPTED, ERROR)
        why = what if is_interrupted or end.is_forced else ''
        if entry is None:  # removed meanwhile
            return entries, why
        options = entry.options
        told = replace(entry, runs=entry.runs + 1, outcome=end.outcome, message=message, failures=0)
        if is_interrupted:  # a person decides whether it runs again
            return {**entries, entry.number: told}, why
        # It could not start, or has another outcome than those that are wanted.
        is_wanted = end.outcome in options.wanted if options.wanted else end.outcome not in FAILURES
        if not (end.outcome and is_wanted):
            failed = replace(told, failures=entry.failures + 1)
            if options.on_failure is OnFailure.DROP:
                return _without(entries, entry), why
            if options.on_failure is OnFailure.RETRY and entry.failures < options.retries:
                return {**entries, entry.number: failed}, why
            if options.on_failure is not OnFailure.CONTINUE:
                return {**entries, entry.number: told}, what
            told = failed
        if options.count == 1:
            return _without(entries, entry), why
        if options.count:  # an edit by whoever has seen the number before would restore it
            told = replace(told, revision=told.revision + 1, options=replace(options, count=options.count - 1))
        if not options.interval:
            return {**entries, entry.number: told}, why
        return _placed(entries, replace(told, due=max(now, started + options.interval))), why

    def _held(self, why: str) -> dict[str, Any]:
        number = self.state.last_hold + 1
        return {'hold': number, 'held': sanitize_for_message(why, _TEXT), 'last_hold': number}

    def _check_size(self, entry: QueueEntry) -> None:
        others = sum(one.size for one in self.state.entries.values() if one.number != entry.number)
        if others + entry.size > QUEUE_SIZE:
            raise CommandRefusedError(
                f'arguments and inputs of all entries of the queue have at most {QUEUE_SIZE} bytes; with this one they '
                f'would have {others + entry.size}'
            )

    def _apply(self, **parts: Any) -> None:
        before, self.state = self.state, replace(self.state, **parts)
        if change := self.state.since(before):
            self._write(change)


def _placed(entries: Mapping[int, QueueEntry], entry: QueueEntry, before: int = 0) -> Mapping[int, QueueEntry]:
    """Return the entries with one before another of its priority; 0: behind all of these."""
    others = list(_without(entries, entry).values())
    others.insert(next((at for at, one in enumerate(others) if one.number == before), len(others)), entry)
    return {one.number: one for one in sorted(others, key=lambda one: -one.options.priority)}


def _without(entries: Mapping[int, QueueEntry], gone: QueueEntry) -> Mapping[int, QueueEntry]:
    return {number: entry for number, entry in entries.items() if number != gone.number}
