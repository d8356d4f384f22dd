# SPDX-License-Identifier: BSD-3-Clause
"""Clocks, timers and how threads wait: time is an object that is handed in."""

from .clock import Clock, ManualClock, SteadyClock, Timer, seconds_asleep
from .coalesced_timers import CoalescedTimers
from .timer_queue import TimerQueue
from .wake_event import WakeEvent
from .watchdog import watchdog
from .work_thread import LateWork, WorkThread

__all__ = [
    'Clock',
    'CoalescedTimers',
    'LateWork',
    'ManualClock',
    'SteadyClock',
    'Timer',
    'TimerQueue',
    'WakeEvent',
    'WorkThread',
    'seconds_asleep',
    'watchdog',
]
