# SPDX-License-Identifier: BSD-3-Clause
"""The conditions under which an entry of the mission queue may start: time, battery and place."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import BatteryState

from flexbt_common.middleware.received_messages import LatestMessage
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_core.values.places import Place
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.persistence.queue_entries import QueueEntry

MOST_RUNS: Final = 1_000_000
MOST_RETRIES: Final = 1000
MOST_PRIORITY: Final = 1000
SHORTEST_INTERVAL: Final = 1.0
LONGEST_INTERVAL: Final = 31_536_000.0
FARTHEST: Final = 1_000_000.0
LATEST: Final = 2.0**31 - 1.0
"""Limits of the options; seconds and metres."""

OLD_SECONDS: Final = 60.0
"""Age above which a charge of the battery no longer counts, s of wall time. Drivers publish it at least this often."""

_WINDOW: Final = re.compile(r'([01]\d|2[0-3]):([0-5]\d)-([01]\d|2[0-3]):([0-5]\d)')


def check_options(options: QueueOptions, places: Mapping[str, Place]) -> None:
    """Check the options of an entry.

    Raises:
        CommandRefusedError: a value is not allowed. The text has the option and the value.
    """

    def require(is_allowed: bool, option: str, value: object, expected: str) -> None:
        if not is_allowed:
            raise CommandRefusedError(f'{option} of an entry is {short_repr(value)}; expected {expected}')

    most, battery = f'from -{MOST_PRIORITY} to {MOST_PRIORITY}', options.battery
    require(abs(options.priority) <= MOST_PRIORITY, 'priority', options.priority, most)
    require(battery <= 1.0, 'battery', battery, 'a charge from 0 to 1')
    latest = 'a time until January 2038, which messages can have'
    require(abs(options.not_before) <= LATEST, 'not_before', options.not_before, latest)
    window = options.window
    require(not window or _WINDOW.fullmatch(window) is not None, 'window', window, 'times of a day, as in 22:00-06:00')
    if options.place:
        known = did_you_mean(options.place, places, f'; the robot knows {", ".join(sorted(places)) or "none"}')
        require(options.place in places, 'place', options.place, f'a place of the robot{known}')
    is_near = options.distance > 0.0 if options.place else options.distance >= 0.0
    require(
        is_near and options.distance <= FARTHEST, 'distance', options.distance, f'metres above 0, at most {FARTHEST:g}'
    )
    on_failure = options.on_failure
    require(on_failure is not OnFailure.UNKNOWN, 'on_failure', int(on_failure), 'hold, continue, retry or drop')
    interval, limits = options.interval, f'0, or seconds from {SHORTEST_INTERVAL:g} to {LONGEST_INTERVAL:g}'
    require(interval == 0.0 or SHORTEST_INTERVAL <= interval <= LONGEST_INTERVAL, 'interval', interval, limits)
    require(options.count <= MOST_RUNS, 'count', options.count, f'at most {MOST_RUNS}')
    require(options.count > 0 or interval > 0.0, 'count', options.count, 'at least 1 without an interval')
    require(options.retries <= MOST_RETRIES, 'retries', options.retries, f'at most {MOST_RETRIES}')


class StartConditions:
    """The conditions of entries, checked against the robot. Used on the executor thread.

    ``battery_topic`` has the charge (sensor_msgs/BatteryState), ``pose`` returns the newest pose of the robot, and
    ``pose_problem`` why it is not known.
    """

    def __init__(
        self,
        runtime: Runtime,
        places: Mapping[str, Place],
        battery_topic: str,
        pose: Callable[[], PoseStamped],
        pose_problem: Callable[[], str],
    ) -> None:
        self.places = places
        self._runtime = runtime
        self._battery_topic = battery_topic
        self._pose = pose
        self._pose_problem = pose_problem
        self._battery: LatestMessage | None = None
        self._charge: BatteryState | None = None
        self._charged_at = self._looked_at = 0.0

    def obstacle(self, entry: QueueEntry, now: float) -> str:
        """Return why an entry may not start, '' if it may; ``now`` is the time on the executive's clock, s."""
        options = entry.options
        if problem := time_problem(entry, now):
            return problem
        if options.battery >= 0.0 and (problem := self._battery_problem(options.battery)):
            return problem
        return self._place_problem(options) if options.place else ''

    def _battery_problem(self, least: float) -> str:
        if self._battery is None:
            self._battery = LatestMessage(
                self._runtime.node, BatteryState, self._battery_topic, qos_profile_sensor_data
            )
        newest, now = self._battery.message, self._runtime.steady.now()
        if newest is not self._charge:
            self._charge, self._charged_at = newest, self._looked_at  # or later: it waits until it is taken
        self._looked_at = now
        if newest is None or now - self._charged_at > OLD_SECONDS or math.isnan(newest.percentage):
            return f'the charge of the battery is not known ({self._battery_topic})'
        # 0 to 1 by definition, but some drivers publish percent.
        charge = newest.percentage / (100.0 if newest.percentage > 1.0 else 1.0)
        return '' if charge >= least - 1e-6 else f'battery below {least:.0%}'

    def _place_problem(self, options: QueueOptions) -> str:
        place, pose = self.places.get(options.place), self._pose()
        if place is None:
            return f'the robot knows no place {options.place!r} any more'
        if problem := self._pose_problem():
            return f'the pose of the robot is not known: {problem}'
        if pose.header.frame_id != place.frame:
            return f'the pose of the robot is in the frame {pose.header.frame_id!r}, {options.place} in {place.frame!r}'
        distance = math.dist((pose.pose.position.x, pose.pose.position.y), (place.x, place.y))
        return '' if distance <= options.distance else f'more than {options.distance:g} m from {options.place}'


def time_problem(entry: QueueEntry, now: float) -> str:
    """Return why it is too early, or the wrong time of day, for an entry; '' if it is not."""
    options = entry.options
    if now < options.not_before:
        return f'not before {_moment(options.not_before)}'
    if now < entry.due <= now + options.interval:  # more is left only if the clock was set back
        return f'due at {_moment(entry.due)}'
    return f'starts only at {options.window}' if options.window and not is_within(options.window, now) else ''


def is_within(window: str, now: float) -> bool:
    """Return whether a time, s, is in a window of the day, as in 22:00-06:00, in local time. The end is excluded."""
    at, (begin, end) = time.strftime('%H:%M', time.localtime(now)), window.split('-')
    return begin <= at < end if begin < end else at >= begin or at < end


def _moment(when: float) -> str:
    return time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(when))
