# SPDX-License-Identifier: BSD-3-Clause
"""State that the nodes of one running tree share: clock, services of the host, wake-ups, work that outlives a halt."""

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
"""A function that ticks a node and returns the status, after it was stored."""


class CallbackWrapping(Protocol):
    """A wrapper that puts callbacks around the ticks of nodes."""

    def before(self, node: Any, tick: Tick) -> Tick:
        """``tick`` of the node with its pre-tick callback."""

    def after(self, node: Any, tick: Tick) -> Tick:
        """``tick`` of the node with its post-tick callback."""


class LeafMonitor(Protocol):
    """A monitor of the work that leaves do elsewhere."""

    def acts(self, leaf: Any) -> None:
        """Note that a leaf begins work elsewhere."""


class UnfinishedWork:
    """Work of a leaf that goes on after the leaf was halted, such as a goal whose cancelling is not confirmed yet."""

    __slots__ = ('_context', 'advance', 'description')

    def __init__(self, context: TreeContext, description: str, advance: Callable[[], None] | None) -> None:
        self._context = context
        self.description = description
        self.advance = advance

    def done(self) -> None:
        """Note that the work has ended. From any thread; harmless when it was called before."""
        self._context.finish(self)


class TreeContext:
    """The state that all nodes of one running tree share; every node has it as ``self.context``.

    ``services`` is provided by the host to its leaves. ``scripts`` has the enum constants, and compiles scripts.
    ``woken`` is the wake-up flag: set by :meth:`wake`, taken by the tree. ``advancing`` is whether there is unfinished
    work that needs ticks. ``paused`` is true while leaves hold the work that they began elsewhere.
    ``rewrapped`` are nodes for which their parents have to fetch another tick function.
    ``stopping`` is true if the host wants to stop the tree, see :meth:`stop`: a tick that may take long checks it.
    ``resting`` is the host's: a context around each wait within a tick. ``waited`` is whether there was one.
    ``callbacks`` puts pre- and post-tick callbacks around ticks, while there are any.
    ``observers`` are called for every change of the status of a node, with node, status before, and status after.
    ``log`` receives the changes when a log is the only observer. ``monitor`` checks the run, if there is one.
    ``expansions`` has the trees that are to be made below nodes before the next round.
    """

    def __init__(self, clock: Clock, services: Any, scripts: ScriptFactory) -> None:
        self.clock = clock
        self.services = services
        self.scripts = scripts
        self.woken = False
        self.stopping = False
        self.resting: Callable[[], AbstractContextManager[None]] = nullcontext
        self.on_wake: Callable[[], None] | None = None
        self.observers: tuple[Callable[[Any, NodeStatus, NodeStatus], None], ...] = ()
        self.log: Any = None
        self.deadlines: dict[object, float] = {}
        # No deadline is earlier.
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
        """Ask for a tick as soon as possible. From any thread, and also from within a tick."""
        # The flag first: the receiver of the callback has to find it set.
        self.woken = True
        on_wake = self.on_wake
        if on_wake is not None:
            on_wake()

    def wait(self, event: WakeEvent, clock: Clock, until: float) -> None:
        """Hold up the tick until ``event`` is set, ``clock`` shows ``until``, or the host wants to stop the tree.

        On the ticking thread.
        """
        self.waited = True
        self._awaited = event  # before the look at ``stopping``
        if not self.stopping:
            with self.resting():
                event.wait(clock, until)
        self._awaited = None

    def stop(self) -> None:
        """Have a tick that is under way come to its end: the host wants to stop the tree. From any thread."""
        self.stopping = True
        awaited = self._awaited
        if awaited is not None:
            awaited.set()

    def add_unfinished(self, description: str, advance: Callable[[], None] | None = None) -> UnfinishedWork:
        """Register work that has to end before the tree is idle; call ``done()`` of the returned object at its end.

        Work that needs ticks to come to its end gives ``advance``: each tick calls it, and after the last the host.
        """
        work = UnfinishedWork(self, description, advance)
        with self._lock:
            self._unfinished.append(work)
            self.advancing = self.advancing or advance is not None
        return work

    def advance_unfinished(self) -> None:
        """One step of all work that needs ticks to come to its end. On the ticking thread."""
        for work in self.works:
            if work.advance is not None:
                work.advance()

    def finish(self, work: UnfinishedWork) -> None:
        """See :meth:`UnfinishedWork.done`."""
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
        """The work that goes on after leaves were halted."""
        with self._lock:
            return tuple(self._unfinished)

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Descriptions of the work that goes on."""
        return tuple(work.description for work in self.works)
