# SPDX-License-Identifier: BSD-3-Clause
"""The age of the picture of the executive, and the state of the link that follows from it."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from typing import Final

LIVE_PERIODS: Final = 1.5
"""Age of a picture, in heartbeat periods, above which it is no longer shown as live."""

LOST_PERIODS: Final = 2.5
"""Age of a picture, in heartbeat periods, above which the link counts as lost; see also :data:`LOST_SECONDS`."""

LOST_SECONDS: Final = 5.0
"""Minimum age of a picture for the link to count as lost, s. On a busy computer a late message is not a lost one."""

PERIOD_BOUNDS: Final = (0.05, 10.0)
"""Limits of a received heartbeat period, s: a wrong period must not keep an old picture live."""

SKEW_TOLERANCE: Final = 0.05
"""Difference between the clocks of two computers that is ignored, s."""

BASELINE_LENGTH: Final = 16
"""Number of latest messages of which the fastest one is used to estimate the difference between the two clocks."""

PING_PERIOD: Final = 30.0
"""Seconds after which the clocks are compared again."""

ECHOES_REMEMBERED: Final = 8
"""Number of latest comparisons of the clocks; the best one is used."""


class LinkState(Enum):
    """The state of the link: the picture is live, the picture is old, or the sender is gone."""

    LIVE = 'live'
    STALE = 'stale'
    LOST = 'lost'


class Freshness:
    """An estimate of the age of the newest message, in seconds on the reader's clock.

    ``transit`` is the time of arrival minus the time of sending, each on the wall clock of its own computer. The
    smallest of the latest transits is the difference of the clocks plus the shortest delay. The excess of a transit
    over that smallest one counts as age.

    This alone cannot distinguish a link that delays every message from a difference of the clocks. So the other side
    echoes our pings. An echo is sent after its ping, so the time of the echo on the sender's clock minus the time of
    the ping on ours is an upper bound of how far the sender's clock is ahead. Added to the transit, it is an upper
    bound of the delay of a message. A delay of one heartbeat period is allowed; the rest counts as age. Without an
    echo, the picture is STALE until a transit alone shows that it is young, because the first message may have been
    kept for late subscribers.

    Messages are sent one after another. If a transit exceeds the one before by more than the time between the two
    arrivals, a clock was set in between. So it was if the message had arrived before it was sent, by the echoes; and if
    its transit is shorter than all others after a gap, unless it is at most a heartbeat period: then the others have
    waited. The message counts as having taken as long as the one before, and after a gap longer by all of it: it may
    have waited. An echo shows if it has not.
    """

    def __init__(self, lost_after: float = LOST_SECONDS) -> None:
        """Count the link as lost at an age above ``lost_after`` seconds, but not before LOST_PERIODS."""
        self._lost_after = lost_after
        self._arrived: float | None = None
        self._transit: float | None = None
        self._period = 1.0
        self._confirmed = False
        self._gone = False
        self._transits: deque[float] = deque(maxlen=BASELINE_LENGTH)
        self._ahead: deque[float] = deque(maxlen=ECHOES_REMEMBERED)
        self._echoed = 0.0

    def start_over(self) -> None:
        """Forget the measurements, because another process sends the messages now."""
        self._transits.clear()
        self._ahead.clear()
        self._confirmed = False
        self._arrived = None

    def arrived(self, now: float, heartbeat_period: float, transit: float | None = None) -> None:
        """Note that a message newer than all before it has arrived."""
        low, high = PERIOD_BOUNDS
        self._period = min(max(heartbeat_period, low), high) if math.isfinite(heartbeat_period) else 1.0
        before, first = self._transit, self._arrived is None
        since = math.inf if self._arrived is None else now - self._arrived
        self._arrived = now
        self._gone = False
        self._transit = transit if transit is not None and math.isfinite(transit) else None
        if self._transit is None:
            self._confirmed = not first
            return
        gap = since if since > LIVE_PERIODS * self._period else 0.0
        is_young = -SKEW_TOLERANCE <= self._transit <= self._period
        if before is not None and (
            self._transit - before > since + SKEW_TOLERANCE
            or (self._ahead and self._longest_delay(self._transit) < -SKEW_TOLERANCE)
            or (gap and not is_young and self._transit < min(self._transits, default=-math.inf) - SKEW_TOLERANCE)
        ):
            step = self._transit - before - gap
            self._transits = deque((one + step for one in self._transits), BASELINE_LENGTH)
            self._ahead = deque((one - step for one in self._ahead), ECHOES_REMEMBERED)
        self._transits.append(self._transit)
        self._confirmed = self._confirmed or is_young or bool(self._ahead)

    def echoed(self, now: float, ahead: float) -> None:
        """Note an echo that was sent ``ahead`` seconds after the ping, each on the wall clock of its own computer.

        If the newest message had arrived before it was sent, by this echo, the sender's clock was set back between the
        two. The next messages may come from before that as well, so the echo says nothing about them.
        """
        if self._transit is not None and self._transit + ahead < -SKEW_TOLERANCE:
            return
        self._ahead.append(ahead)
        self._echoed = now
        self._confirmed = self._confirmed or self._transit is not None

    def wants_ping(self, now: float) -> bool:
        """Return whether to send a ping: the latest echo is missing, old or slow, or the link is not live."""
        if not self._ahead or now - self._echoed > PING_PERIOD or self.state(now) is not LinkState.LIVE:
            return True
        return self._transit is not None and self._longest_delay(self._transit) > self._period

    def sender_gone(self) -> None:
        """Note that the middleware reports the sender as gone."""
        self._gone = True

    def age(self, now: float) -> float | None:
        """Estimated age of the picture, s; None before the first message."""
        return None if self._arrived is None else max(0.0, now - self._arrived) + self._lateness()

    def silent(self, now: float, listened: float = math.inf) -> bool:
        """Return whether a message is overdue. ``listened``: seconds since the latest message in which messages could
        arrive."""
        if self._arrived is None or self._gone:
            return True
        return min(now - self._arrived, listened) > LIVE_PERIODS * self._period

    def state(self, now: float) -> LinkState:
        """Return the state of the link at ``now``."""
        age = self.age(now)
        if age is None or self._gone or age > self._lost_age:
            return LinkState.LOST
        if not self._confirmed or age > LIVE_PERIODS * self._period:
            return LinkState.STALE
        return LinkState.LIVE

    def next_change(self, now: float) -> float | None:
        """Time at which :meth:`state` changes if nothing arrives, or None."""
        age = self.age(now)
        state = self.state(now)
        if age is None or state is LinkState.LOST:
            return None
        limit = LIVE_PERIODS * self._period if state is LinkState.LIVE else self._lost_age
        return now + limit - age + 1e-3

    @property
    def _lost_age(self) -> float:
        return max(LOST_PERIODS * self._period, self._lost_after)

    def _lateness(self) -> float:
        """Estimated age of the newest message on its arrival, s."""
        if self._transit is None:
            return 0.0
        excess = self._transit - min(self._transits)
        if not self._ahead:
            return max(0.0, self._transit if len(self._transits) == 1 else excess)
        longest = self._longest_delay(self._transit)
        return max(0.0, longest - self._period, min(excess, longest))

    def _longest_delay(self, transit: float) -> float:
        """Return the upper bound of the delay of a message that the echoes allow for, s."""
        return transit + min(self._ahead)
