# SPDX-License-Identifier: BSD-3-Clause
"""The mission queue as lines. Everything that came over the network is escaped."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from typing import Final

from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_console.mirror.records import FramedPose, MissionQueue, QueueEntry
from flexbt_console.mirror.view import View
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import one_line, pluralize

from .rendering import FIRST_WALL_TIME, autonomy_text, place_text
from .style import Line, Tone

Places = Mapping[str, FramedPose]
"""Poses by the names of places."""

_VALUE: Final = 60
"""Maximum characters shown of the value of an argument or input."""

_UNITS: Final = ((86_400.0, 'd'), (3_600.0, 'h'), (60.0, 'min'))


def queue_summary(view: View) -> str:
    """Return the number of entries and whether the queue is held; '' if there is nothing to tell."""
    snapshot = view.snapshot
    if snapshot is None or not (snapshot.queue_length or snapshot.queue_held):
        return ''
    count = pluralize(snapshot.queue_length, 'entry', 'entries')
    if not snapshot.queue_held:
        return count
    return Line(f'{count}, HELD: {one_line(snapshot.queue_held)}; "queue release" goes on', Tone.WARNING)


def queue_title(queue: MissionQueue) -> str:
    """Return the number of entries, and why the queue is held."""
    held = f', HELD: {one_line(queue.held)}' if queue.hold else ''
    return f'mission queue: {pluralize(len(queue.entries), "entry", "entries")}{held}'


def queue_lines(queue: MissionQueue, places: Places) -> list[str]:
    """Return the whole queue: why it is held, and two lines for each entry."""
    held = [Line(f'HELD: {one_line(queue.held)}; "queue release" goes on', Tone.WARNING)] if queue.hold else []
    entries = [line for entry in queue.entries for line in (entry_line(entry, places), f'      {entry_details(entry)}')]
    return [*held, *(entries or ['the queue is empty'])]


def entry_line(entry: QueueEntry, places: Places) -> str:
    """Return what an entry runs, and what it waits for, in one line."""
    text = f'{entry.number:>4}  {what_text(entry, places)}: {state_text(entry)}'
    return Line(text, Tone.GOOD if entry.running else Tone.PLAIN)


def state_text(entry: QueueEntry) -> str:
    """Return whether an entry runs, or what it waits for."""
    return 'RUNS' if entry.running else one_line(entry.waits_for) or 'next'


def what_text(entry: QueueEntry, places: Places) -> str:
    """Return the behavior of an entry with its arguments and inputs, of a pose the name of its place."""
    given = [f'{one_line(name)}={one_line(value, _VALUE)}' for name, value in entry.arguments]
    given += [f'{one_line(one.key)}={_value_text(one.text, places)}' for one in entry.inputs]
    return ' '.join([one_line(entry.behavior), *given])


def _value_text(text: str, places: Places) -> str:
    with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError):
        pose = load_json(text)
        at = pose['pose']['position']
        return place_text(
            FramedPose(float(at.get('x', 0)), float(at.get('y', 0)), 0.0, pose['header']['frame_id']), places
        )
    return one_line(text, _VALUE) or '...'


def entry_details(entry: QueueEntry) -> str:
    """Return the options of an entry, who added it, and how its last run ended."""
    told = [*options_texts(entry.options), f'autonomy {autonomy_text(entry.autonomy)}']
    if entry.operator:
        told.append(f'by {one_line(entry.operator)}')
    if entry.runs:
        ended = one_line(entry.outcome) or 'it did not start'
        why = f' ({one_line(entry.message)})' if entry.message else ''
        told.append(f'{pluralize(entry.runs, "run")}, the last: {ended}{why}')
    return '; '.join(told)


def options_texts(options: QueueOptions) -> list[str]:
    """Return the options that differ from those of an entry that runs once, in the words of the commands."""
    times = f' {options.retries} times' if options.on_failure is OnFailure.RETRY else ''
    told = {
        f'priority {options.priority}': options.priority,
        f'battery {options.battery:.0%}': options.battery >= 0.0,
        f'after {_moment_text(options.not_before)}': options.not_before,
        f'at {one_line(options.window)}': options.window,
        f'within {options.distance:g} m of {one_line(options.place)}': options.place,
        f'{options.count} more times' if options.count else 'no end': options.count != 1,
        f'every {duration_text(options.interval)}': options.interval,
        f'on failure {options.on_failure.name.lower()}{times}': options.on_failure is not OnFailure.HOLD,
        f'wants {" or ".join(map(one_line, options.wanted))}': options.wanted,
    }
    return [text for text, is_told in told.items() if is_told]


def _moment_text(stamp: float) -> str:
    """Return a time on the executive's clock, which may be on another day: with its date, as in the command."""
    is_simulated = stamp < FIRST_WALL_TIME
    return f'{stamp:g} s' if is_simulated else time.strftime('%Y-%m-%dT%H:%M:%S', time.localtime(stamp))


def duration_text(seconds: float) -> str:
    """Return a duration in the largest unit that divides it: 2 h, 90 min, 45 s."""
    size, unit = next(((size, unit) for size, unit in _UNITS if seconds % size == 0.0), (1.0, 's'))
    return f'{seconds / size:g} {unit}'
