# SPDX-License-Identifier: BSD-3-Clause
"""State that the nodes of a running tree share: clock, services of the host, wake-ups, work that outlives a halt."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol

from flexbt_core.behavior_tree.model.definition import ScriptFactory
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.waiting import WakeEvent

Tick = Callable[[], NodeStatus]
"""A function that ticks a node, stores the status and returns it."""


class CallbackWrapping(Protocol):
    """A wrapper that puts callbacks around the ticks of nodes."""

    def before(self, node: Any, tick: Tick) -> Tick:
        """Return ``tick`` of the node with its pre-tick callback."""

    def after(self, node: Any, tick: Tick) -> Tick:
        """Return ``tick`` of the node with its post-tick callback."""


class LeafMonitor(Protocol):
    """A monitor of the work that leaves start outside the tree."""

    def acts(self, leaf: Any) -> None:
        """Record that a leaf starts work outside the tree."""


class UnfinishedWork:
    """Work of a leaf that continues after its halt, such as a goal whose cancellation is not confirmed yet."""

    __slots__ = ('_context', 'advance', 'description')

    def __init__(self, context: TreeContext, description: str, advance: Callable[[], None] | None) -> None:
        self._context = context
        self.description = description
        self.advance = advance

    def done(self) -> None:
        """Report that the work has ended. From any thread; a second call has no effect."""
        self._context.finish(self)


class TreeContext:
    """The state that all nodes of one running tree share; every node has it as ``self.context``.

    ``services`` are what the host provides to its leaves. ``scripts`` has the enum constants, and compiles scripts.
    ``woken`` is the wake-up flag: :meth:`wake` sets it, the tree clears it. ``advancing`` is true if unfinished work
    needs ticks. ``paused`` is true while leaves hold work that they started outside the tree.
    ``rewrapped`` are nodes whose parents have to fetch a new tick function.
    ``stop_requested`` is true if the host wants to stop the tree, see :meth:`stop`. ``stopping`` is true if a tick has
    to end soon because of that, which a tick that may take long checks: a clean-up within the stop need not.
    ``resting`` makes the host's context around each wait within a tick. ``waited`` is true if a tick has waited.
    ``callbacks`` wraps ticks in pre- and post-tick callbacks; None if no node has any.
    ``observers`` are called for every change of the status of a node, with node, status before, and status after.
    ``log`` receives the changes if a log is the only observer. ``monitor``, if set, checks the run.
    ``expansions`` has the trees to make below nodes before the next round.
    """

    def __init__(self, clock: Clock, services: Any, scripts: ScriptFactory) -> None:
        self.clock = clock
        self.services = services
        self.scripts = scripts
        self.woken = False
        self.stop_requested = False
        self.stopping = False
        self.resting: Callable[[], AbstractContextManager[None]] = nullcontext
        self.on_wake: Callable[[], None] | None = None
        self.observers: tuple[Callable[[Any, NodeStatus, NodeStatus], None], ...] = ()
        self.log: Any = None
        self.deadlines: dict[object, float] = {}
        # Lower bound of the deadlines.
        self.earliest = math.inf
        self.halt_errors: list[NodeExecutionError] = []
        self.rewrapped: list[object] = []
        self.expansions: dict[Any, Any] = {}
        self.callbacks: CallbackWrapping | None = None
        self.monitor: LeafMonitor | None = None
        self.advancing = False
        self.paused = False
        self.waited = False
        self._awaited: WakeEvent | None = None
        self._unfinished: list[UnfinishedWork] = []
        self._lock = threading.Lock()

    def wake(self) -> None:
        """Request a tick as soon as possible. From any thread, and also within a tick."""
        # Before the callback, which may check the flag.
        self.woken = True
        on_wake = self.on_wake
        if on_wake is not None:
            on_wake()

    def wait(self, event: WakeEvent, clock: Clock, until: float | None) -> None:
        """Block the tick until ``event`` is set, ``clock`` shows ``until`` (None: no limit), or the host wants to stop
        the tree.

        On the ticking thread.
        """
        self.waited = True
        self._awaited = event  # before the check of ``stopping``, so that stop() misses no wait
        if not self.stopping:
            with self.resting():
                event.wait(clock, until)
        self._awaited = None

    def stop(self) -> None:
        """Make the current tick end soon, because the host wants to stop the tree. From any thread."""
        self.stop_requested = True
        self.stopping = True
        awaited = self._awaited
        if awaited is not None:
            awaited.set()

    def add_unfinished(self, description: str, advance: Callable[[], None] | None = None) -> UnfinishedWork:
        """Register work that must end before the tree is idle; call ``done()`` of the returned object when it ends.

        Work that needs ticks to end passes ``advance``: each tick calls it, and after the last tick the host.
        """
        work = UnfinishedWork(self, description, advance)
        with self._lock:
            self._unfinished.append(work)
            self.advancing = self.advancing or advance is not None
        return work

    def advance_unfinished(self) -> None:
        """Advance all work that needs ticks to end by one step. On the ticking thread."""
        for work in self.works:
            if work.advance is not None:
                work.advance()

    def finish(self, work: UnfinishedWork) -> None:
        """Remove work that has ended; see :meth:`UnfinishedWork.done`."""
        with self._lock:
            if work not in self._unfinished:
                return
            self._unfinished.remove(work)
            self.advancing = any(other.advance is not None for other in self._unfinished)
        on_wake = self.on_wake
        if on_wake is not None:
            on_wake()

    @property
    def works(self) -> tuple[UnfinishedWork, ...]:
        """Work that continues after the halt of its leaf."""
        with self._lock:
            return tuple(self._unfinished)

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Descriptions of the work in :attr:`works`."""
        return tuple(work.description for work in self.works)
