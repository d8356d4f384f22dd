# SPDX-License-Identifier: BSD-3-Clause
"""Clocks, timers, guard conditions and wait sets: stand-ins for those of rclpy's compiled module."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Any, Final

from .graph import REAL, Destroyable, Entity, RCLError
from .scheduler import SCHEDULER, SECOND

_ROS_TIME: Final = REAL.ClockType.ROS_TIME
_STEADY_TIME: Final = REAL.ClockType.STEADY_TIME
_CHANGE: Final = REAL.ClockChange
_CANCELED: Final = getattr(REAL, 'TimerCancelledError', RCLError)  # since Kilted


class Clock(Destroyable):
    """Stand-in for rcl's clock: steady time, wall time, or ROS time, which ``/clock`` may override."""

    def __init__(self, clock_type: Any) -> None:
        super().__init__()
        self.type = REAL.ClockType(int(clock_type))
        self._is_steady = self.type == _STEADY_TIME
        self.is_overridden = False
        self.timers: list[Timer] = []
        self._override = 0
        self._jump_handles: list[tuple[Any, bool, int, int]] = []

    def nanoseconds(self) -> int:
        """Return the time, ns."""
        if self._is_steady:
            return SCHEDULER.now
        return self._override if self.is_overridden else SCHEDULER.wall

    def get_now(self) -> Any:
        return REAL.rcl_time_point_t(self.nanoseconds(), self.type)

    def get_ros_time_override_is_enabled(self) -> bool:
        return self.is_overridden

    def set_ros_time_override_is_enabled(self, is_enabled: bool) -> None:
        if is_enabled == self.is_overridden:
            return
        change = _CHANGE.ROS_TIME_ACTIVATED if is_enabled else _CHANGE.ROS_TIME_DEACTIVATED
        self._tell_jump(change, 0, is_before=True)
        self.is_overridden = is_enabled
        self._tell_jump(change, 0, is_before=False)

    def set_ros_time_override(self, time_point: Any) -> None:
        delta = time_point.nanoseconds - self._override
        if self.is_overridden:
            self._tell_jump(_CHANGE.ROS_TIME_NO_CHANGE, delta, is_before=True)
        self._override = time_point.nanoseconds
        if self.is_overridden:
            self._tell_jump(_CHANGE.ROS_TIME_NO_CHANGE, delta, is_before=False)

    def add_clock_callback(self, handle: Any, on_change: bool, forward: int, backward: int) -> None:
        self._jump_handles.append((handle, on_change, forward, backward))

    def remove_clock_callback(self, handle: Any) -> None:
        self._jump_handles = [one for one in self._jump_handles if one[0] is not handle]

    def _tell_jump(self, change: Any, delta: int, is_before: bool) -> None:
        is_change = change != _CHANGE.ROS_TIME_NO_CHANGE
        for timer in self.timers:
            if not is_before:
                timer.follow_jump(is_change)
            elif is_change:
                timer.save_credit()
        for handle, on_change, forward, backward in tuple(self._jump_handles):
            is_meant = on_change if is_change else (forward and delta >= forward) or (backward and delta <= backward)
            if not is_meant:
                continue
            if is_before and handle._pre_callback is not None:
                handle._pre_callback()
            elif not is_before and handle._post_callback is not None:
                handle._post_callback({'clock_change': change, 'delta': delta})


class ClockEvent:
    """Stand-in for rclpy's event that waits by a clock."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def set(self) -> None:
        self._event.set()

    def clear(self) -> None:
        self._event.clear()

    def is_set(self) -> bool:
        return self._event.is_set()

    def wait_until_steady(self, clock: Clock, until: Any) -> None:
        self._event.wait((until.nanoseconds - clock.nanoseconds()) / SECOND)

    wait_until_system = wait_until_steady

    def wait_until_ros(self, clock: Clock, until: Any) -> None:
        if not clock.is_overridden:
            self.wait_until_steady(clock, until)
        elif clock.nanoseconds() < until.nanoseconds:
            self._event.wait()


def _check_context(what: str, context: Any) -> None:
    if context is not None and not context.ok():
        raise RCLError(f'failed to create {what}: the given context is not valid, rcl_shutdown() was called')


class Timer(Entity):
    """Stand-in for rcl's timer."""

    def __init__(self, clock: Clock, context: Any, period: int, autostart: bool = True) -> None:
        super().__init__()
        _check_context('timer', context)
        if context is not None and period < 0:
            raise RCLError('failed to create timer: timer period must be non-negative')
        self.clock = clock
        self.is_canceled = not autostart
        self.next = clock.nanoseconds() + period
        self._period = period
        self._last = clock.nanoseconds()
        self._credit = 0
        clock.timers.append(self)

    def is_ready(self) -> bool:
        return not self.is_canceled and self.next <= self.clock.nanoseconds()

    is_timer_ready = is_ready

    @property
    def due(self) -> int | None:
        """Time of the steady clock at which it becomes ready by itself, ns; None if it does not."""
        if self.is_canceled or self.clock.is_overridden:
            return None
        return SCHEDULER.now + max(0, self.next - self.clock.nanoseconds())

    def reset_timer(self) -> None:
        self.is_canceled = False
        self.next = self.clock.nanoseconds() + self._period
        self.notify()

    def cancel_timer(self) -> None:
        self.is_canceled = True

    def is_timer_canceled(self) -> bool:
        return self.is_canceled

    def get_timer_period(self) -> int:
        return self._period

    def change_timer_period(self, period: int) -> None:
        self._period = period

    def call_timer(self) -> None:
        """Count a call: the next one is due a period after this one was, or the next multiple from now."""
        if self.is_canceled:
            raise _CANCELED('failed to call timer: timer is canceled')
        now = self.clock.nanoseconds()
        self._last = now
        self.next += self._period
        if self.next <= now:
            self.next = now if not self._period else self.next + (1 + (now - self.next) // self._period) * self._period

    def call_timer_with_info(self) -> dict[str, int]:
        expected = self.next
        self.call_timer()
        return {'expected_call_time': expected, 'actual_call_time': self._last}

    def save_credit(self) -> None:
        """Note, before the source of ROS time changes, how long it has to wait."""
        if now := self.clock.nanoseconds():
            self._credit = self.next - now

    def follow_jump(self, is_change: bool) -> None:
        """Become ready, or wait for a period from now, after a jump of ROS time, as ``_rcl_timer_time_jump`` of rcl."""
        now = self.clock.nanoseconds()
        if is_change:
            if now and self._credit:
                self._last, self._credit = now - self._credit, 0
                self.next = self._last + self._period
        elif self.next <= now:
            self.notify()
        elif now < self._last:
            self.next, self._last = now + self._period, now

    def time_until_next_call(self) -> int | None:
        return None if self.is_canceled else self.next - self.clock.nanoseconds()

    def time_since_last_call(self) -> int:
        return self.clock.nanoseconds() - self._last

    def _destroy(self) -> None:
        if self in self.clock.timers:
            self.clock.timers.remove(self)


class GuardCondition(Entity):
    """Stand-in for rcl's guard condition."""

    def __init__(self, context: Any) -> None:
        super().__init__()
        _check_context('guard_condition', context)
        self.is_triggered = False

    def trigger_guard_condition(self) -> None:
        self.is_triggered = True
        self.notify()

    def is_ready(self) -> bool:
        return self.is_triggered


_POLL: Final = SECOND // 10_000
"""Time that a wait with a timeout of 0 takes, ns: a loop of them must not hold the clock."""

_KINDS: Final = ('subscription', 'guard_condition', 'timer', 'client', 'service', 'event')


class WaitSet(Destroyable):
    """Stand-in for rcl's wait set."""

    def __init__(self, *_counts: Any) -> None:
        super().__init__()
        self.clear_entities()

    def clear_entities(self) -> None:
        self._by_kind: dict[str, list[Any]] = {kind: [] for kind in _KINDS}
        self._further: list[Entity] = []
        self._ready: set[Entity] = set()

    def _add(self, kind: str, entity: Any) -> int:
        if entity.is_ended:
            raise RCLError(f'failed to add {kind} to the wait set: it is destroyed')
        self._by_kind[kind].append(entity)
        return len(self._by_kind[kind]) - 1

    def add_subscription(self, entity: Any) -> int:
        return self._add('subscription', entity)

    def add_guard_condition(self, entity: Any) -> int:
        return self._add('guard_condition', entity)

    def add_timer(self, entity: Any) -> int:
        return self._add('timer', entity)

    def add_client(self, entity: Any) -> int:
        return self._add('client', entity)

    def add_service(self, entity: Any) -> int:
        return self._add('service', entity)

    def add_event(self, entity: Any) -> int:
        return self._add('event', entity)

    def add_all(self, entities: Iterable[Entity]) -> None:
        """Add the parts of an action client or server."""
        self._further.extend(entities)

    def entities(self) -> list[Any]:
        """Return all entities."""
        return [*(entity for those in self._by_kind.values() for entity in those), *self._further]

    def look(self) -> None:
        """Note which entities are ready now."""
        self._ready = {entity for entity in self.entities() if entity.is_ready()}

    def has(self, entity: Entity) -> bool:
        """Return whether an entity was ready at the end of the wait."""
        return entity in self._ready

    def is_ready(self, kind: str, index: int) -> bool:
        return self._by_kind[kind][index] in self._ready

    def get_ready_entities(self, kind: str) -> list[int]:
        return [entity.pointer for entity in self._by_kind[kind] if entity in self._ready]

    def wait(self, timeout: int) -> None:
        """Wait until an entity is ready, at most ``timeout`` ns, forever if it is negative."""
        entities = self.entities()
        until = None if timeout < 0 else SCHEDULER.now + timeout
        if timeout == 0:
            SCHEDULER.block('a poll', SCHEDULER.now + _POLL)
        while True:
            self.look()
            if self._ready or (until is not None and SCHEDULER.now >= until):
                break
            for entity in entities:
                entity.waiter = SCHEDULER.current
            due = [when for entity in entities if isinstance(entity, Timer) and (when := entity.due) is not None]
            SCHEDULER.block('a wait set', min([*due, *(() if until is None else (until,))], default=None))
            for entity in entities:
                entity.waiter = None
        for guard in self._by_kind['guard_condition']:
            if guard in self._ready:
                guard.is_triggered = False
