# SPDX-License-Identifier: BSD-3-Clause
"""Observers of a tree: callbacks before and after a tick, and a log of status changes.

Callbacks cost nothing in a tree that has none. When the first one is set, the parents of all nodes fetch wrapped tick
functions of their children; when the last one is removed, they fetch the plain ones. Both take effect at the next tick
of the tree. Any other callback takes effect as soon as it is set or removed, even in the rest of a tick that another
callback blocks::

    tree.callbacks.set_pre_tick(node, lambda node: NodeStatus.SUCCESS)     # the node succeeds without being ticked
    tree.callbacks.set_post_tick(node, lambda node, status: print(node.path, status) or status)
"""

from __future__ import annotations

import functools
import threading
import types
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any, Final, Generic, Protocol, TypeVar

from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeStatus

from .context import Tick, TreeContext
from .node import WATCHED_STATUS, TreeNode, kept_by_class

PreTick = Callable[[TreeNode], NodeStatus]
"""A callback after the pre-conditions of a node. If it returns SUCCESS or FAILURE, the node is not ticked."""

PostTick = Callable[[TreeNode, NodeStatus], NodeStatus]
"""A callback with the result of a node, after its post-conditions. SUCCESS or FAILURE replaces the result."""

_CALLBACK: Final = 'a callback gave FAILURE'


class TickCallbacks:
    """The callbacks of one tree: :attr:`Tree.callbacks`. Use it from any thread; callbacks run on the ticking thread.

    If a callback replaces the result of a RUNNING node, the node is halted first: its work must not continue while its
    parent considers it done. An exception of a callback is an error of the node; ``TickAbandoned`` ends the tick.
    """

    def __init__(self, context: TreeContext, nodes: Callable[[], Sequence[TreeNode]]) -> None:
        self._context = context
        self._nodes = nodes
        self._before: dict[TreeNode, dict[object, PreTick]] = {}
        self._after: dict[TreeNode, dict[object, PostTick]] = {}
        self._lock = threading.Lock()
        self.on_release: Callable[[], None] | None = None
        """Called by :meth:`release`, from any thread, so that a waiting callback checks :attr:`released`."""

    def set_pre_tick(self, node: TreeNode, callback: PreTick | None, owner: object = None) -> None:
        """Call ``callback`` before each tick of the node, unless it still has a result; None: no callback.

        Each ``owner`` may have one for each node. They are called in the order in which they were set; the first result
        counts.
        """
        self._set(self._before, node, callback, owner)

    def set_post_tick(self, node: TreeNode, callback: PostTick | None, owner: object = None) -> None:
        """Call ``callback`` after each tick of the node, with any result; None: no callback. ``owner`` as above."""
        self._set(self._after, node, callback, owner)

    @property
    def active(self) -> bool:
        """True if any node has a callback."""
        return self._context.callbacks is not None

    def clear(self) -> None:
        """Remove all callbacks."""
        with self._lock:
            self._before.clear()
            self._after.clear()
            self._switch()

    def release(self) -> None:
        """End the waits of a tick, because the host wants to stop the tree. From any thread."""
        self._context.stop()
        on_release = self.on_release
        if on_release is not None:
            on_release()

    @property
    def released(self) -> bool:
        """True if the host wants to stop the tree. A waiting callback then raises TickAbandoned."""
        return self._context.stop_requested

    def _set(self, callbacks: dict[TreeNode, Any], node: TreeNode, callback: Any, owner: object) -> None:
        with self._lock:
            # Make a new dictionary: the ticking thread may be reading the present one.
            placed = {one: other for one, other in callbacks.get(node, {}).items() if callback or one is not owner}
            if callback is not None:
                placed[owner] = callback
            callbacks[node] = placed
            if not placed:
                del callbacks[node]
            self._switch()

    def _switch(self) -> None:
        """Switch callbacks on or off, and make parents fetch the tick functions again if that changes."""
        used = bool(self._before or self._after)
        if used is not self.active:
            self._context.callbacks = self if used else None
            self._context.rewrapped.extend(self._nodes())

    # -- when parents fetch the tick functions ------------------------------------------------------------------------

    def before(self, node: TreeNode, tick: Tick) -> Tick:
        """Return ``tick`` of the node with its pre-tick callback."""
        callbacks = self._before

        def call_and_tick() -> NodeStatus:
            placed = callbacks.get(node)
            if placed is not None and node.stored_status is not SUCCESS and node.stored_status is not FAILURE:
                for callback in placed.values():
                    given = _replacement(node, functools.partial(callback, node))
                    if given is not None:
                        return _complete(node, given)
            return tick()

        return call_and_tick

    def after(self, node: TreeNode, tick: Tick) -> Tick:
        """Return ``tick`` of the node with its post-tick callback."""
        callbacks = self._after

        def tick_and_call() -> NodeStatus:
            node.decided_by = None
            status = tick()
            for callback in callbacks.get(node, {}).values():
                given = _replacement(node, functools.partial(callback, node, status))
                if given is not None and given is not status:
                    return _complete(node, given)
            return status

        return tick_and_call


def _complete(node: TreeNode, result: NodeStatus) -> NodeStatus:
    if node.stored_status is RUNNING:
        node.halt_node()
    node.status = result
    node.decided_by = _CALLBACK
    return result


def _replacement(node: TreeNode, callback: Callable[[], NodeStatus]) -> NodeStatus | None:
    """Return the result with which a callback replaces that of the node; None if it does not."""
    try:
        given = callback()
    except NodeExecutionError:
        raise
    except BaseException as error:
        raise node.fault(error) from error
    return given if given is SUCCESS or given is FAILURE else None


# A log of the status changes of a tree, to be read later, possibly by another thread.
#
# Writing must cost almost nothing, so an entry is one integer, a *mark*: the uid of the node, and the number of its new
# status. The reader knows the previous status of each node, and makes changes from the marks, in the order in which the
# statuses were stored.

_SHIFT: Final = 4
"""Number of bits of a mark that hold the status."""
_STATUS: Final = (1 << _SHIFT) - 1

T = TypeVar('T')


class Log(Protocol):
    """A sink for marks. A list is the fastest."""

    def append(self, mark: int, /) -> None: ...


class StatusLog:
    """An observer that writes every change to a log: ``tree.observe(StatusLog(log))``."""

    def __init__(self, log: Log) -> None:
        self.log = log

    def __call__(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        self.log.append(node.uid << _SHIFT | after)


class LogReader(Generic[T]):
    """A reader that turns the log of a tree into transitions.

    Create it before the first mark is written; it has to read all of them. A transition is the object that ``make``
    returns for a node's uid and the numbers of its statuses before and after.
    """

    def __init__(self, nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> None:
        self.statuses = bytearray([0, *(node.status for node in nodes)])
        """Status number of each node, by uid, after the marks read so far."""
        self._make = make
        self._made: dict[int, T] = {}

    def read(self, marks: Iterable[int]) -> list[T]:
        """Return the changes in these marks, which continue those read before."""
        statuses = self.statuses
        made = self._made
        transitions: list[T] = []
        for mark in marks:
            uid, status = mark >> _SHIFT, mark & _STATUS
            # Few changes are distinct, so the transition of each is made only once.
            change = mark << _SHIFT | statuses[uid]
            transition = made.get(change)
            if transition is None:
                transition = made[change] = self._make(uid, statuses[uid], status)
            statuses[uid] = status
            transitions.append(transition)
        return transitions


# Detection of status changes. Storing a status must cost almost nothing, so ``status`` of a node is a slot.
# A node with observers, or with post-conditions that run when it stores its result, gets a derived class in which
# ``status`` is a property. Nothing else differs.


def watch(node: TreeNode) -> None:
    """Give a node the class that suits its observers and its conditions."""
    observers = node.context.observers
    node_class: Any = vars(type(node)).get('unwatched', type(node))
    if node.conditions is not None and node.conditions.run_at_store:
        node_class = _watched(node_class)
    elif len(observers) == 1 and isinstance(observers[0], StatusLog):
        node.context.log = observers[0].log
        node_class = _logged(node_class)
    elif observers:
        node_class = _watched(node_class)
    node.__class__ = node_class


@kept_by_class
def _watched(plain: type[Any]) -> type[Any]:
    """Return ``plain`` with observers, and with post-conditions that run when the result is stored."""
    return _derived(plain, WATCHED_STATUS)


@kept_by_class
def _logged(plain: type[Any]) -> type[Any]:
    """Return ``plain`` for a tree whose only observer is a log: one call writes a change."""
    return _derived(plain, property(attrgetter('stored_status'), _store_and_log))


def _store_and_log(node: TreeNode, status: NodeStatus) -> None:
    if node.stored_status is not status:
        node.stored_status = status
        node.context.log.append(node.uid << _SHIFT | status)


def _derived(plain: type[Any], status: property) -> type[Any]:
    names = {'__module__': plain.__module__, '__qualname__': plain.__qualname__, '__doc__': plain.__doc__}
    namespace = {**names, '__slots__': (), 'status': status, 'unwatched': plain}
    return types.new_class(plain.__name__, (plain,), exec_body=lambda made: made.update(namespace))
