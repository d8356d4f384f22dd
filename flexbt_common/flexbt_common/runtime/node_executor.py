# SPDX-License-Identifier: BSD-3-Clause
"""The executor of one process: rclpy's single-threaded executor, and a faster one.

For each callback, rclpy creates a wait set and lists of all its possible entities, and wraps the callback in a task,
which wakes the executor twice more. That costs 0.15 ms of processor time a turn for a node like the onboard executive,
several times for each message, while the wait itself takes 3 us. This executor keeps the wait set until a node gets or
loses an entity, and calls ready callbacks at once. It uses the clock and simulated time of the node that it is created
for. ``add_node`` adds nodes with other names (:mod:`flexbt_common.lifecycle.lifecycle_subnode`).

A subscription wakes the executor only while something waits for its messages. The subscription to the simulated time
does so while a timer waits (:mod:`.ros_clock`), one whose callback has ``is_awaited`` while that returns True. Other
messages stay in the middleware, up to the depth of the subscription, until they are taken. Events of incompatible QoS
are checked once a second, since each topic of a node has two of them.

While it waits, another thread may call a function in its place (:meth:`NodeExecutor.run_here`): waking the executor and
waiting for it takes longer than most callbacks.

A coroutine (of a service whose callback awaits something) is a task of rclpy. The executor continues it whenever it is
awake, and fifty times a second, since the awaited future wakes the executor only in some versions of rclpy. If rclpy
lacks a part that :class:`NodeExecutor` needs, rclpy's own loop runs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from inspect import iscoroutine, iscoroutinefunction
from threading import Lock, get_ident
from time import monotonic
from types import coroutine
from typing import Any, Final
from weakref import WeakKeyDictionary, ref

from rclpy import wait_for_message
from rclpy.clock import ClockType
from rclpy.event_handler import EventHandler, QoSPublisherEventType, QoSSubscriptionEventType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

from flexbt_common.middleware import rclpy_private
from flexbt_common.middleware.rclpy_private import ExtendedExecutor, Take
from flexbt_core.clock.clock import SteadyClock

from .ros_clock import LONGEST_WAIT, HandledTime, SimulatedTime, is_clock_subscription

_CHECK_SECONDS: Final = 1.0
_CHECK_TOLERANCE: Final = 0.1
"""Approximate period of the check of entities that nothing waits for, s; it runs when the executor is awake anyway."""

_MISFITS: Final = frozenset(
    (type(event), event)  # events of different types compare equal by their numbers
    for event in (
        QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
    )
)

Later = Callable[[float, Callable[[], object]], object]
"""A function that calls another one after a delay in seconds of wall time, on the executor thread."""

BORROW_SECONDS: Final = 0.001
"""Time that another thread waits for the turn, s: an executor that has just answered it is about to wait again."""

_AWAITING_TURN: Final = 0.02
"""Maximum turn of rclpy's own loop, s: it may continue to wait although new work has arrived."""


def is_misfit(event: QoSPublisherEventType | QoSSubscriptionEventType) -> bool:
    """Return whether the event reports incompatible QoS."""
    return (type(event), event) in _MISFITS


def make_executor(
    node: Node,
    on_fault: Callable[[Exception], None],
    on_turn: Callable[[], object],
    later: Later,
) -> NodeExecutor | StockNodeExecutor:
    """Return the best executor that this version of rclpy allows.

    ``on_fault(error)`` gets the exception of a callback; the other callbacks still run. ``on_turn()`` is called after
    the wait, before any callback (by rclpy's own loop, before the wait). ``later`` is for answers of services that
    could not be sent.
    """
    if rclpy_private.is_usable(rclpy_private.EXECUTOR):
        return NodeExecutor(node, on_fault, on_turn, later)
    return StockNodeExecutor(node, on_fault, on_turn, later)


class StockNodeExecutor(SingleThreadedExecutor):
    """An executor that runs the callbacks of its nodes by rclpy's own loop, on the thread that calls :meth:`turn`."""

    def __init__(
        self, node: Node, on_fault: Callable[[Exception], None], on_turn: Callable[[], object], later: Later
    ) -> None:
        super().__init__(context=node.context)
        self.later = later
        self._on_fault = on_fault
        self._on_turn = on_turn
        self.simulated_time = SimulatedTime(lambda error: self.create_task(on_fault, error))
        self.listening_time = HandledTime(SteadyClock(), node.get_clock())
        self.guests = GuestExecutors()
        self.doorbell = node.create_guard_condition(lambda: None)
        self.add_node(node)

    is_lent: Final = False
    """See :attr:`NodeExecutor.is_lent`; never True here."""

    is_resting: Final = False
    """See :attr:`NodeExecutor.is_resting`; not known here."""

    def run_here(self, _fn: Callable[[], object]) -> bool:
        """Return False: this executor does not lend its turn."""
        return False

    def turn(self, timeout: float | None) -> None:
        """Run a turn as :meth:`NodeExecutor.turn`, but call at most one callback, and wait at most 0.02 s."""
        self.guests.host_thread = get_ident()
        self._on_turn()
        self.listening_time.sample()
        try:
            self.spin_once(_AWAITING_TURN if timeout is None else min(timeout, _AWAITING_TURN))
        except ExternalShutdownException:
            raise
        except Exception as error:
            self._on_fault(error)
        self.guests.wake()
        if not self.context.ok():
            raise ExternalShutdownException


class NodeExecutor(ExtendedExecutor):
    """An executor that runs the callbacks of its nodes on the thread that calls :meth:`turn`. Its ``doorbell`` ends the
    wait."""

    def __init__(
        self,
        node: Node,
        on_fault: Callable[[Exception], None],
        on_turn: Callable[[], object],
        later: Later,
    ) -> None:
        super().__init__(context=node.context)
        self.later = later
        self.simulated_time = SimulatedTime(lambda error: self.create_task(on_fault, error))
        self._node = ref(node)  # which may end before other nodes of this executor
        self._on_fault = on_fault
        self._on_turn = on_turn
        self.doorbell = GuardCondition(None, None, context=node.context)
        self._entities: _Entities | None = None
        self._is_changed = True
        self._soon: deque[Task] = deque()
        self._awaiting: list[Task] = []
        self._thread = self._lent_to = 0
        self._turn = _Turn()
        self._rests_since = 0.0
        self.listening_time = HandledTime(SteadyClock(), node.get_clock())
        self.guests = GuestExecutors()
        self.add_node(node)

    def turn(self, timeout: float | None) -> None:
        """Wait until something is ready, at most ``timeout`` seconds (None: forever), and call everything that is.

        It may return without having called anything.

        Raises:
            ExternalShutdownException: the context is shut down.
        """
        self._thread = self.guests.host_thread = get_ident()
        self._run_soon()
        if self._awaiting:
            timeout = _AWAITING_TURN if timeout is None else min(timeout, _AWAITING_TURN)
        self._call_ready(timeout)
        self._go_on()
        if not self.context.ok():
            raise ExternalShutdownException

    def run_here(self, fn: Callable[[], object]) -> bool:
        """Call ``fn`` as the executor would, but on this thread, if the executor waits now or within BORROW_SECONDS.
        Return whether it was called. In ``fn``, only our clocks return the newest simulated time.
        """
        if not self._turn.borrow():
            return False
        self._lent_to = get_ident()
        try:
            self._on_turn()
            fn()
        except Exception as error:
            self._on_fault(error)
        finally:
            self._lent_to = 0
            self._turn.give_back()
        return True

    @property
    def is_lent(self) -> bool:
        """True if this thread is in :meth:`run_here`."""
        return self._lent_to == get_ident()

    @property
    def is_resting(self) -> bool:
        """True while it waits, and not longer than its waits take. From any thread."""
        return self._turn.is_free and monotonic() < self._rests_since + _CHECK_SECONDS + _CHECK_TOLERANCE

    def add_node(self, node: Node) -> bool:
        """Start calling the callbacks of this node. From any thread."""
        is_new = bool(super().add_node(node))
        self.wake()
        return is_new

    def remove_node(self, node: Node) -> None:
        """Stop calling the callbacks of this node. From any thread."""
        super().remove_node(node)
        self.wake()

    def wake(self) -> None:
        """End the wait, since a node has got or lost an entity. From any thread."""
        self._is_changed = True
        self._end_wait()

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        """Call a callback or run a coroutine soon. From any thread."""
        task = Task(callback, args, kwargs, executor=self)
        (self._awaiting if iscoroutine(callback) or iscoroutinefunction(callback) else self._soon).append(task)
        if get_ident() != self._thread:  # whose own tasks are run before the next wait
            self._end_wait()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Shut down: nothing is called any more."""
        self._forget_entities()
        self.doorbell.destroy()
        return bool(super().shutdown(timeout_sec))

    def _end_wait(self) -> None:
        with suppress(InvalidHandle):  # it has ended
            self.doorbell.trigger()

    def _call_ready(self, timeout: float | None) -> None:
        if self._is_changed or self._entities is None:
            self._is_changed = False
            self._forget_entities()
            self._entities = self._entities_of_nodes()
        if self.simulated_time.subscription is not None:
            timeout = LONGEST_WAIT if timeout is None else min(timeout, LONGEST_WAIT)
        self._rests_since = monotonic()
        try:
            ready = self._entities.ready(timeout, self._turn, bool(self._awaiting))
        except InvalidHandle:  # another thread is destroying an entity
            self._is_changed = True
            return
        self._on_turn()
        self.listening_time.sample()
        self.simulated_time.take_newest()  # first, so that no message is from the future
        for take, entity in ready:
            if self._awaiting and not entity.callback_group.can_execute(entity):
                if isinstance(entity, GuardCondition):
                    entity.trigger()  # all others are still ready in the next turn
                continue
            self._call(take, entity)
            self._run_soon()
        if not all(isinstance(entity, GuardCondition) for _, entity in ready):
            self.guests.wake()

    def taking_all(self, subscription: Subscription) -> Callable[[Subscription], object] | None:
        """Return the function of the base class."""
        if is_clock_subscription(subscription):
            return lambda _: self.simulated_time.take_newest()
        return super().taking_all(subscription)

    def _go_on(self) -> None:
        for task in tuple(self._awaiting):
            task()
            if task.done() or task.cancelled():
                self._awaiting.remove(task)
                self._tell_fault(task)

    def _tell_fault(self, task: Task) -> None:
        error = task.exception()
        if error is not None:
            self._on_fault(error)

    def _entities_of_nodes(self) -> _Entities:
        nodes = self.get_nodes()

        def all_of(kind: str) -> list[Any]:
            return [entity for node in nodes for entity in getattr(node, kind)]

        for node in nodes:
            known = node.default_callback_group.entities  # weak references, which rclpy keeps when they are dead
            known.difference_update([one for one in tuple(known) if one() is None])
        own = self._node()
        clocks = filter(is_clock_subscription, () if own is None else own.subscriptions)
        self.simulated_time.subscription = next(clocks, None)
        entities = {
            'timer': all_of('timers'),
            'subscription': [one for one in all_of('subscriptions') if not _waits_itself(one)],
            'guard_condition': all_of('guards'),
            'client': all_of('clients'),
            'service': all_of('services'),
        }
        return _Entities(self.context, self.doorbell, self.takes(), entities, all_of('waitables'))

    def _forget_entities(self) -> None:
        if self._entities is not None:
            self._entities.close()
            self._entities = None

    def _call(self, take: Take, entity: Any) -> None:
        """Take the data of an entity and call its callback."""
        try:
            start = take(entity)
            if start is None:
                return
            called = start()
            try:
                awaited = called.send(None)
            except StopIteration:
                return
        except Exception as error:
            if not isinstance(error, InvalidHandle) or self._has(entity):
                self._on_fault(error)
            return  # otherwise a callback has destroyed it: this one, or one before
        entity.callback_group.beginning_execution(entity)
        self.create_task(_go_on(called, awaited, lambda: entity.callback_group.ending_execution(entity)))

    def _has(self, entity: Any) -> bool:
        """Return whether an entity still belongs to a node."""
        kinds = ('timers', 'subscriptions', 'guards', 'clients', 'services', 'waitables')
        return any(entity in getattr(node, kind) for node in self.get_nodes() for kind in kinds)

    def _run_soon(self) -> None:
        while self._soon:
            task = self._soon.popleft()
            task()
            self._tell_fault(task)


def _waits_itself(subscription: Subscription) -> bool:
    """Return whether a subscription has a separate wait set, on the thread that created it."""
    return getattr(subscription.callback, '__module__', '') == wait_for_message.__name__


class GuestExecutors:
    """Executors of users' code with a node that this process already spins.

    rclpy would move the node to the other executor: after ``rclpy.spin_once(node)`` in a state, the node would have no
    executor, and two threads would take its messages meanwhile. Instead the node stays with its executor, and the guest
    waits. It gets a task when it first arrives, and each time the node's executor has called callbacks, so that all
    forms of spinning return as usual.
    """

    def __init__(self) -> None:
        self.host_thread = 0
        self._lock = Lock()
        self._woken: WeakKeyDictionary[Executor, Task | None] = WeakKeyDictionary()

    def admit(self, guest: Executor, node: Node) -> None:
        """Make ``guest`` wait for the callbacks of ``node``, which was added to it.

        Raises:
            RuntimeError: this is the thread that calls these callbacks.
        """
        guest.remove_node(node)
        if get_ident() == self.host_thread:
            raise RuntimeError(
                f'a callback of node {node.get_fully_qualified_name()} cannot spin this node: what it waits for is '
                'called on the same thread after it has returned. Return from the callback and continue in another one '
                '(future.add_done_callback), or in the execute() of a state or the tick of a leaf'
            )
        with self._lock:
            # The callback that a new guest waits for may have run just before: let the guest return once and check.
            self._woken[guest] = None if guest in self._woken else guest.create_task(_nothing)

    def wake(self) -> None:
        """Let the guests return after callbacks have been called."""
        if not self._woken:
            return
        with self._lock:
            for guest, task in tuple(self._woken.items()):
                if task is not None and not task.done():
                    continue  # it spins no more, or is behind
                try:
                    self._woken[guest] = guest.create_task(_nothing)
                except (AttributeError, InvalidHandle):  # it is shut down
                    del self._woken[guest]


def _nothing() -> None:
    pass


async def _go_on(called: Coroutine[Any, Any, None], awaited: Any, on_end: Callable[[], None]) -> None:
    """Run the rest of a started coroutine, which waits for ``awaited``."""
    try:
        await _rest(called, awaited)
    finally:
        on_end()


@coroutine
def _rest(called: Coroutine[Any, Any, None], awaited: Any) -> Any:
    while True:
        yield awaited
        try:
            awaited = called.send(None)
        except StopIteration:
            return


class _Turn:
    """The right to call callbacks: the executor's thread has it, unless it waits and another thread has borrowed it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._lock.acquire()
        self._is_wanted = False

    def __enter__(self) -> None:
        """Lend the turn during a ``with`` block, and wait for it at the end."""
        self._lock.release()

    def __exit__(self, *_: object) -> None:
        self._is_wanted = True
        self._lock.acquire()
        self._is_wanted = False

    @property
    def is_free(self) -> bool:
        """True if it is lent, and nobody has borrowed it."""
        return not self._lock.locked()

    def borrow(self) -> bool:
        """Borrow the turn until :meth:`give_back`, unless the executor uses it or waits for it. Return whether that
        succeeded."""
        return not self._is_wanted and self._lock.acquire(timeout=BORROW_SECONDS)

    def give_back(self) -> None:
        """Return the turn to the executor."""
        self._lock.release()


@dataclass(frozen=True)
class _Group:
    """Entities that are in the wait set while ``is_awaited()``, and once in a while if they are ``checked``.

    ``adds`` are calls that put them there, with their argument and the entity; ``waitables`` those among them, with how
    each is taken.
    """

    is_awaited: Callable[[], bool]
    is_checked: bool = True
    adds: list[tuple[Callable[[Any], object], Any, Any]] = field(default_factory=list)
    waitables: list[tuple[Take, Any]] = field(default_factory=list)


class _Entities:
    """The entities of a node, and their wait set. While it is open, it keeps all of them from being destroyed."""

    def __init__(
        self,
        context: Any,
        doorbell: GuardCondition,
        takes: Mapping[str, Take],
        entities: Mapping[str, Iterable[Any]],
        waitables: Iterable[Any],
    ) -> None:
        """Hold all entities. ``takes`` and ``entities`` are by kind; ``doorbell`` only ends the wait."""
        self._held = ExitStack()
        self._held.enter_context(context.handle)
        held_waitables = [waitable for waitable in waitables if self._hold(waitable)]
        held = {
            kind: {entity.handle.pointer: (takes[kind], entity) for entity in those if self._hold(entity.handle)}
            for kind, those in entities.items()
        }
        self._by_kind = [(kind, those) for kind, those in held.items() if those]
        self._held.enter_context(doorbell.handle)
        count = NumberOfEntities(
            len(held['subscription']),
            len(held['guard_condition']) + 1,
            len(held['timer']),
            len(held['client']),
            len(held['service']),
        )
        for waitable in held_waitables:
            count += waitable.get_num_entities()
        self._wait_set = wait_set = rclpy_private.wait_set(count, context)
        self._of_ros_time = [
            timer.handle for _, timer in held['timer'].values() if timer.clock.clock_type is ClockType.ROS_TIME
        ]
        self._check_at = 0.0

        always, seldom = _Group(lambda: True), _Group(lambda: False)
        self._groups = [always, seldom]
        adds = {
            'timer': wait_set.add_timer,
            'guard_condition': wait_set.add_guard_condition,
            'client': wait_set.add_client,
            'service': wait_set.add_service,
        }
        for kind, add in adds.items():
            always.adds.extend((add, entity.handle, entity) for _, entity in held[kind].values())
        self._doorbell = doorbell.handle
        group_of: dict[Any, _Group] = {}  # by event of a subscription
        for _, subscription in held['subscription'].values():
            group, is_awaited = always, self._awaited(subscription)
            if is_awaited is not None:
                # The middleware ends the wait for an event when a message has come, too.
                group, of_events = _Group(is_awaited, is_checked=False), _Group(is_awaited)
                self._groups += group, of_events
                group_of |= dict.fromkeys(subscription.event_handlers, of_events)
            group.adds.append((wait_set.add_subscription, subscription.handle, subscription))
        for waitable in held_waitables:
            tells_misfit = isinstance(waitable, EventHandler) and is_misfit(waitable.event_type)
            group = seldom if tells_misfit else group_of.get(waitable, always)
            group.adds.append((waitable.add_to_wait_set, wait_set, waitable))
            group.waitables.append((takes['waitable'], waitable))

    def ready(self, timeout: float | None, turn: _Turn, some_await: bool) -> list[tuple[Take, Any]]:
        """Wait until something is ready, at most ``timeout`` seconds (None: forever); return what is. Others may have
        the turn meanwhile. When ``some_await``, the callback groups of some may be busy; these are not waited for."""
        now = monotonic()
        checks_all = now >= self._check_at - _CHECK_TOLERANCE
        if checks_all:
            self._check_at = now + _CHECK_SECONDS
        else:
            until = max(0.0, self._check_at + _CHECK_TOLERANCE - now)
            timeout = until if timeout is None else min(timeout, until)
        groups = [group for group in self._groups if (checks_all and group.is_checked) or group.is_awaited()]
        wait_set = self._wait_set
        wait_set.clear_entities()
        for group in groups:
            for add, argument, entity in group.adds:
                if not some_await or entity.callback_group.can_execute(entity):
                    add(argument)
        wait_set.add_guard_condition(self._doorbell)
        with turn:  # which others may borrow meanwhile
            wait_set.wait(-1 if timeout is None else int(timeout * 1e9))
        ready = [entry for group in groups for entry in group.waitables if entry[1].is_ready(wait_set)]
        for kind, entities in self._by_kind:
            for pointer in wait_set.get_ready_entities(kind):
                found = entities.get(pointer)
                if found is not None and (kind != 'timer' or found[1].handle.is_timer_ready()):
                    ready.append(found)
        return ready

    def close(self) -> None:
        """Release the entities."""
        self._groups.clear()
        self._of_ros_time.clear()
        self._held.close()

    def _awaited(self, subscription: Subscription) -> Callable[[], bool] | None:
        """Return the function that reports whether something waits for the messages; None for always."""
        if is_clock_subscription(subscription):
            return self._is_time_awaited
        is_awaited: Callable[[], bool] | None = getattr(subscription.callback, 'is_awaited', None)
        return is_awaited

    def _is_time_awaited(self) -> bool:
        return not all(timer.is_timer_canceled() for timer in self._of_ros_time)

    def _hold(self, handle: Any) -> bool:
        try:
            self._held.enter_context(handle)
        except InvalidHandle:
            return False
        return True
