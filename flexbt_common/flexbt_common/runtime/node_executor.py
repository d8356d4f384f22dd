# SPDX-License-Identifier: BSD-3-Clause
"""rclpy's single-threaded executor, for one node, without its costs.

rclpy makes a wait set, and lists of everything that can be in it, anew for each callback; it wraps each callback in a
task; and each task wakes it twice again. That is 0.15 ms of processor time a turn for a node like the onboard
executive, several times for each message, where the wait itself takes 3 us. Here the wait set is kept until the node
gets or loses an entity, and what is ready is called at once.

What rclpy does with coroutines (a service whose callback awaits something) depends on its version. While one is under
way, rclpy's own loop runs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Coroutine, Iterable
from contextlib import ExitStack
from inspect import iscoroutine, iscoroutinefunction
from threading import get_ident
from types import coroutine
from typing import Any, Final

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

__all__ = ['NodeExecutor']

_AWAITING_TURN: Final = 0.02
"""Longest turn of rclpy's own loop, s: it may go on waiting although work was brought in meanwhile."""


class NodeExecutor(SingleThreadedExecutor):
    """Runs the callbacks of one node, on the thread that calls :meth:`turn`.

    ``on_fault(error)`` is told what a callback lets escape; the others are called all the same.
    """

    def __init__(self, node: Node, on_fault: Callable[[Exception], None]) -> None:
        super().__init__(context=node.context)
        self._node = node
        self._on_fault = on_fault
        self._entities: _Entities | None = None
        self._is_changed = True
        self._soon: deque[Task] = deque()
        self._awaiting: list[Task] = []
        self._thread = 0
        self.add_node(node)

    def turn(self, timeout: float | None) -> None:
        """Wait until something is ready, at most ``timeout`` seconds (None: for ever), and call everything that is.

        May come back without having called anything.

        Raises:
            ExternalShutdownException: the context is shut down.
        """
        self._thread = get_ident()
        self._run_soon()
        self._let_go_of_ended()
        known = len(self._awaiting)
        if known:
            self._turn_of_rclpy(_AWAITING_TURN if timeout is None else min(timeout, _AWAITING_TURN))
        else:
            self._call_ready(timeout)
        for _ in self._awaiting[known:]:
            self._turn_of_rclpy(0.0)  # coroutines begin before anything that is brought in later
        if not self.context.ok():
            raise ExternalShutdownException

    def wake(self) -> None:
        """Come back from the wait; the node has got or lost an entity. From any thread."""
        self._is_changed = True
        super().wake()

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        """Have a callback called soon, or a coroutine run. From any thread."""
        if iscoroutine(callback) or iscoroutinefunction(callback):
            task = super().create_task(callback, *args, **kwargs)
            self._awaiting.append(task)
        else:
            task = Task(callback, args, kwargs, executor=self)
            self._soon.append(task)
        if get_ident() != self._thread:  # whose own tasks are run before the next wait
            super().wake()  # only now: rclpy's wake comes before the task is known here
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End; nothing is called any more."""
        self._forget_entities()
        return bool(super().shutdown(timeout_sec))

    def _call_ready(self, timeout: float | None) -> None:
        if self._is_changed or self._entities is None:
            self._is_changed = False
            self._forget_entities()
            self._entities = self._entities_of_node()
        for take, entity in self._entities.ready(-1 if timeout is None else int(timeout * 1e9)):
            self._call(take, entity)
            self._run_soon()

    def _turn_of_rclpy(self, timeout: float) -> None:
        self._forget_entities()
        try:
            self.spin_once(timeout)
        except ExternalShutdownException:
            raise
        except Exception as error:
            if not any(task.exception() is error for task in self._awaiting):  # those are told when they are let go
                self._on_fault(error)

    def _let_go_of_ended(self) -> None:
        if not self._awaiting:
            return
        for task in tuple(self._awaiting):
            if task.done() or task.cancelled():
                self._awaiting.remove(task)
                self._tell_fault(task)
        if not self._awaiting:
            self._cb_iter = None  # rclpy's loop, at rest between two turns, holds entities that may be destroyed now

    def _tell_fault(self, task: Task) -> None:
        error = task.exception()
        if error is not None:
            self._on_fault(error)

    def _make_handler(self, *arguments: Any, **options: Any) -> Task:
        """A call that rclpy's own loop makes: it may await something."""
        task = super()._make_handler(*arguments, **options)
        self._awaiting.append(task)
        return task

    def _entities_of_node(self) -> _Entities:
        node = self._node
        for guard in node.guards:
            if guard._executor_triggered:  # rclpy's own loop has seen it, and not come to call it
                guard._executor_triggered = False
                guard.trigger()
        return _Entities(
            self.context,
            (self._guard, self._sigint_gc),
            waitables=_taken_by(self._take_waitable, node.waitables),
            timers=_taken_by(self._take_timer, node.timers),
            subscriptions=_taken_by(self._take_subscription, node.subscriptions),
            guards=_taken_by(self._take_guard_condition, node.guards),
            clients=_taken_by(self._take_client, node.clients),
            services=_taken_by(self._take_service, node.services),
        )

    def _forget_entities(self) -> None:
        if self._entities is not None:
            self._entities.close()
            self._entities = None

    def _call(self, take: _Take, entity: Any) -> None:
        """Take what has come for an entity, and call its callback."""
        try:
            start = take(entity)
            if start is None:
                return
            called = start()
            try:
                awaited = called.send(None)
            except StopIteration:
                return
        except InvalidHandle:
            return  # destroyed by a callback before this one
        except Exception as error:
            self._on_fault(error)
            return
        entity.callback_group.beginning_execution(entity)
        self.create_task(_go_on(called, awaited, lambda: entity.callback_group.ending_execution(entity)))

    def _run_soon(self) -> None:
        while self._soon:
            task = self._soon.popleft()
            task()
            self._tell_fault(task)


_Take = Callable[[Any], Callable[[], Coroutine[Any, Any, None]] | None]
"""Takes what has come for an entity; gives the call of its callback, if there is one to be made."""


def _taken_by(take: _Take, entities: Iterable[Any]) -> list[tuple[_Take, Any]]:
    return [(take, entity) for entity in entities]


async def _go_on(called: Coroutine[Any, Any, None], awaited: Any, on_end: Callable[[], None]) -> None:
    """The rest of a coroutine that has been started; ``awaited`` is what it waits for."""
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


class _Entities:
    """The entities of a node, and the wait set for them. While it is open, none of them is really destroyed."""

    def __init__(
        self,
        context: Any,
        bells: Iterable[Any],
        *,
        waitables: list[tuple[_Take, Any]],
        timers: list[tuple[_Take, Any]],
        subscriptions: list[tuple[_Take, Any]],
        guards: list[tuple[_Take, Any]],
        clients: list[tuple[_Take, Any]],
        services: list[tuple[_Take, Any]],
    ) -> None:
        self._held = ExitStack()
        self._held.enter_context(context.handle)
        self._waitables = [(take, waitable) for take, waitable in waitables if self._hold(waitable)]
        held = {
            kind: {entity.handle.pointer: (take, entity) for take, entity in entities if self._hold(entity.handle)}
            for kind, entities in (
                ('timer', timers),
                ('subscription', subscriptions),
                ('guard_condition', guards),
                ('client', clients),
                ('service', services),
            )
        }
        self._by_kind = [(kind, entities) for kind, entities in held.items() if entities]
        bell_handles = [bell.handle for bell in bells if self._hold(bell.handle)]
        count = NumberOfEntities(
            len(held['subscription']),
            len(held['guard_condition']) + len(bell_handles),
            len(held['timer']),
            len(held['client']),
            len(held['service']),
        )
        for _, waitable in self._waitables:
            count += waitable.get_num_entities()
        self._wait_set = wait_set = rclpy_implementation.WaitSet(
            count.num_subscriptions,
            count.num_guard_conditions,
            count.num_timers,
            count.num_clients,
            count.num_services,
            count.num_events,
            context.handle,
        )
        adds = {
            'timer': wait_set.add_timer,
            'subscription': wait_set.add_subscription,
            'guard_condition': wait_set.add_guard_condition,
            'client': wait_set.add_client,
            'service': wait_set.add_service,
        }
        self._adds = [(adds[kind], entity.handle) for kind, entities in held.items() for _, entity in entities.values()]
        self._adds += [(wait_set.add_guard_condition, handle) for handle in bell_handles]
        self._adds += [(waitable.add_to_wait_set, wait_set) for _, waitable in self._waitables]

    def ready(self, timeout: int) -> list[tuple[_Take, Any]]:
        """Wait until something is ready, at most ``timeout`` ns (-1: for ever); gives what is."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._adds:
            add(handle)
        wait_set.wait(timeout)
        ready = [(take, waitable) for take, waitable in self._waitables if waitable.is_ready(wait_set)]
        for kind, entities in self._by_kind:
            for pointer in wait_set.get_ready_entities(kind):
                found = entities.get(pointer)
                if found is not None and (kind != 'timer' or found[1].handle.is_timer_ready()):
                    ready.append(found)
        return ready

    def close(self) -> None:
        """Let go of the entities."""
        self._adds.clear()
        self._held.close()

    def _hold(self, handle: Any) -> bool:
        try:
            self._held.enter_context(handle)
        except InvalidHandle:
            return False
        return True
