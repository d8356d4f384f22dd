# SPDX-License-Identifier: BSD-3-Clause
"""A recorded run at any of its times, as the mirror of a console would have had it. Nothing is published."""

from __future__ import annotations

import bisect
import contextlib
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from time import monotonic
from typing import Any, Final

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.middleware.received_messages import Received
from flexbt_common.transform_buffer import TransformBuffer
from flexbt_common.transform_listener import take_transforms
from flexbt_common.values.message_fields import seconds_of
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.link.messages import record_of
from flexbt_console.link.scan_link import PLACE_SECONDS, SCAN_SECONDS, points_of
from flexbt_console.link.surroundings_link import MAP_FRAME, SurroundingsFeed
from flexbt_console.mirror.lanes import Lanes
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_core.clock.clock import ManualClock
from flexbt_core.errors import FlexbtError

from .run_file import DAMAGED, Recorded, going_on, read_run
from .topics import NOT_REPLAYED, TOPICS, check_definition, type_of

MOMENT: Final = 0.02
"""Time within which messages belong together, such as a status and a line of the log, s."""

KEPT_EACH: Final = 500
"""Messages between two kept pictures; to go back, at most this many are read again."""


_IN_LANES: Final = frozenset(
    {
        names.EXECUTIVE_STATUS,
        names.EXECUTIVE_EVENTS,
        names.EXECUTIVE_LOG,
        names.PLACES,
        names.TREE_STRUCTURE,
        names.TREE_STATUS,
    }
)
"""Topics of which the lanes of the time line are made."""

MOST_MEMORY: Final = 1_000_000_000
MESSAGE_MEMORY: Final = 300
"""MOST_MEMORY: default maximum bytes of all messages of a recording, which stay in memory. MESSAGE_MEMORY: overhead of
one."""


class RunPlayer:
    """A recording, and the ``mirror`` at ``time``, in seconds from the first message. If the file lacks its end, the
    mirror's problem says so. Messages that cannot be read are skipped.

    Raises:
        UsageError: the file cannot be read, has no run, or was recorded with other fields of the messages.
    """

    def __init__(self, file: Path, most_memory: int = MOST_MEMORY) -> None:
        damaged: list[str] = []
        messages = going_on(read_run(file, lambda: damaged.append(f'the recording {DAMAGED}')))
        known = (one for one in messages if one.topic not in NOT_REPLAYED and one.topic in TOPICS)
        self._messages = sorted(_within_memory(file, known, most_memory), key=lambda one: one.time)
        if not self._messages:
            raise UsageError(f'{file}: has no messages of a run')
        for (topic, name), definition in {(one.topic, one.type): one.definition for one in self._messages}.items():
            check_definition(topic, name, definition, f'{file}: ')
        self._scans, self._statics = (
            [place for place, one in enumerate(self._messages) if one.topic == topic]
            for topic in (names.SCAN, names.TF_STATIC)
        )
        self.begin = begin = self._messages[0].time
        self._times = [(one.time - begin) * 1e-9 for one in self._messages]
        self.duration = self._times[-1]
        blank = Mirror(ManualClock())
        blank.set_problem(''.join(damaged))
        self._kept = [(blank, MAP_FRAME)]
        self._lanes_clock = ManualClock()
        self._lanes_feed = MirrorFeed(Mirror(self._lanes_clock))
        self._lanes, self._lanes_next = Lanes(self._lanes_feed.mirror), 0
        self.time, self._next = 0.0, 0
        self._restore(0)
        self.go_to(0.0)

    def go_to(self, time: float, patience: float = math.inf) -> bool:
        """Show the state at a time, limited to the recording, starting from the nearest stored picture before it.

        What was not read yet may take long: after ``patience`` seconds it is not there yet, which is False, and shows
        what was known at the :attr:`time` to which it has come. So calls with the same time lead there.
        """
        time = min(max(0.0, time), self.duration)
        wanted = end = bisect.bisect_right(self._times, time)
        nearest = min(end // KEPT_EACH, len(self._kept) - 1)
        if time < self.time or nearest * KEPT_EACH > self._next:
            self._restore(nearest)
        latest = monotonic() + patience
        for place in range(self._next, wanted):
            if place == len(self._kept) * KEPT_EACH:
                self._kept.append((self.mirror.copy(ManualClock()), self._feed.surroundings.map_frame))
            self._clock.set(self._times[place])
            self._feed.take(self._messages[place].topic, received(self._messages[place]))
            if monotonic() > latest and place + 1 < wanted:
                time, end = self._times[place], place + 1
                break
        self._next = end
        self._clock.set(time)
        self.time = time
        self._show_scan(end)
        return end == wanted

    def moment(self, time: float) -> Mirror:
        """Return the mirror as it was at a time; it stands still."""
        self.go_to(time)
        return self.mirror.copy(ManualClock(self.time))

    @property
    def has_lanes(self) -> bool:
        """Whether :meth:`lanes` has read the whole recording."""
        return self._lanes_next == len(self._messages)

    def lanes(self, patience: float = math.inf) -> Lanes:
        """Return the lanes of the time line of the whole recording, or as far as they were read after ``patience``
        seconds; the next call reads on."""
        latest = monotonic() + patience
        while self._lanes_next < len(self._messages) and monotonic() <= latest:
            one = self._messages[self._lanes_next]
            self._lanes_clock.set(self._times[self._lanes_next])
            self._lanes_next += 1
            if one.topic in _IN_LANES:
                self._lanes_feed.take(one.topic, received(one))
        return self._lanes

    def _restore(self, number: int) -> None:
        """Go back to the kept state with this number. A state is kept every :data:`KEPT_EACH` messages."""
        kept, map_frame = self._kept[number]
        self._clock = ManualClock()
        self.mirror = kept.copy(self._clock)
        self._feed = MirrorFeed(self.mirror)
        self._feed.surroundings.map_frame = map_frame
        self._next, self._scan = number * KEPT_EACH, -1

    def _show_scan(self, end: int) -> None:
        """Place the last scan before a message, by the transforms around it. Earlier scans are never decoded."""
        latest = bisect.bisect_left(self._scans, end) - 1
        if latest < 0 or latest == self._scan:
            return
        self._scan = latest
        at = self._scans[latest]
        begin = bisect.bisect_left(self._times, self._times[at] - PLACE_SECONDS)
        behind = bisect.bisect_right(self._times, self._times[at] + PLACE_SECONDS)
        around = [place for place in range(begin, behind) if self._messages[place].topic == names.TF]
        try:
            frames = TransformBuffer()
            for place in (*self._statics, *around):
                is_static = self._messages[place].topic == names.TF_STATIC
                take_transforms(frames, received(self._messages[place]).checked(type_of(names.TF)), is_static=is_static)
            scan = received(self._messages[at]).checked(type_of(names.SCAN))
            where = frames.lookup(
                self._feed.surroundings.map_frame, scan.header.frame_id, seconds_of(scan.header.stamp)
            )
            shown = points_of(scan, where)
        except (ValueError, FlexbtError):
            shown = ()  # its place on the map is not known
        self.mirror.receive_scan(shown, SCAN_SECONDS - (self.time - self._times[at]))

    def next_said(self, by: int) -> float:
        """Return the time of the next (1) or the previous (-1) message of the executive."""
        said = [time for time, one in zip(self._times, self._messages, strict=True) if one.topic in _SAID]
        if by > 0:
            return next((time for time in said if time > self.time), self.duration) + MOMENT
        return next((time for time in reversed(said) if time < self.time - 2.0 * MOMENT), 0.0) + MOMENT

    def find(self, text: str) -> float:
        """Return the time of the next message that contains this text, ignoring the case of
        letters.

        Raises:
            RefusedError: no such message follows.
        """
        wanted = text.lower()
        for time, one in zip(self._times, self._messages, strict=True):
            if time > self.time and one.topic in _SAID and wanted in one.data.decode(errors='replace').lower():
                return time + MOMENT
        raise RefusedError(f'nothing has {text!r} in it after {self.time:.1f} s')


_SAID: Final = frozenset({names.EXECUTIVE_STATUS, names.EXECUTIVE_LOG, names.EXECUTIVE_EVENTS})


class MirrorFeed:
    """Messages of :data:`TOPICS` into a mirror. Those that cannot be read, or exceed the limits, are skipped."""

    def __init__(self, mirror: Mirror) -> None:
        self.mirror, self.surroundings = mirror, SurroundingsFeed(mirror)
        self._receivers: dict[str, Callable[[Any], object]] = {
            names.EXECUTIVE_STRUCTURE: mirror.receive_structure,
            names.EXECUTIVE_BEHAVIORS: mirror.receive_behaviors,
            names.EXECUTIVE_LOG: mirror.receive_log,
            names.EXECUTIVE_EVENTS: mirror.receive_events,
            names.EXECUTIVE_SUBJECTS: mirror.receive_subjects,
            names.EXECUTIVE_QUEUE: mirror.receive_queue,
            names.STOP_GUARD_STATUS: mirror.receive_guard,
            names.PLACES: mirror.receive_places,
        }

    def take(self, topic: str, message: Received) -> None:
        """Take a message."""
        surrounds, receive = self.surroundings.receivers.get(topic), self._receivers.get(topic)
        with contextlib.suppress(ValueError, LimitExceededError):
            if surrounds is not None:
                surrounds(message.unpack(type_of(topic)))
            elif receive is not None:
                receive(record_of(message.checked(type_of(topic))))
            elif topic == names.EXECUTIVE_STATUS:
                status = record_of(message.checked(type_of(topic)))
                transit = Transit(message.sent, message.arrived * 1e-9) if message.sent else None
                self.mirror.receive_snapshot(status, transit)


def received(one: Recorded) -> Received:
    """Return a message as it was received."""
    return Received(one.data, len(one.data), b'', one.sent * 1e-9, one.time)


def _within_memory(file: Path, messages: Iterable[Recorded], most: int) -> Iterator[Recorded]:
    taken = 0
    for one in messages:
        taken += len(one.data) + MESSAGE_MEMORY
        if taken > most:
            raise UsageError(
                f'{file}: its messages take more than {most // 10**6} MB; "replay" publishes them without keeping them'
            )
        yield one
