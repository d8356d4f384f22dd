# SPDX-License-Identifier: BSD-3-Clause
"""A running tree: ticking it as BehaviorTree.CPP does, halting it, and reading its state."""

from __future__ import annotations

import functools
import logging
import math
import sys
import types
from collections.abc import Callable, Container
from typing import Any, Final, TypeVar

from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import (
    FailureStep,
    FailureTrace,
    NodeExecutionError,
    PortError,
)
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, NodeKind, NodeStatus
from flexbt_core.clock.clock import Clock, SteadyClock

from .context import Tick, TreeContext
from .leaf import ExpandingAction, LeafNode
from .node import StatusObserver, TreeNode, tick_function
from .observers import TickCallbacks, watch
from .parents import ControlNode, DecoratorNode
from .tree_builder import Instance, Substitute, SubTreeInstance, instantiate

_logger = logging.getLogger(__name__)


class Tree:
    """A tree that can be ticked. One thread at a time may tick or halt it; ``wake`` may be called from any.

    ``library`` and ``tree_id`` (with the document ``file`` to look in first) say which tree. ``on_wake()`` is called,
    from any thread, when a leaf asks for a tick, and when unfinished work ends. ``substitute(definition, path)`` may
    return another definition for a node, such as a leaf that replaces it in a test.
    """

    def __init__(
        self,
        library: TreeLibrary,
        tree_id: str,
        *,
        file: str | None = None,
        blackboard: Blackboard | None = None,
        clock: Clock | None = None,
        services: Any = None,
        on_wake: Callable[[], None] | None = None,
        max_rounds: int = 10_000,
        substitute: Substitute | None = None,
    ) -> None:
        """Make the nodes. Raises TreeLoadError when a blackboard entry is used with several types, LookupError when
        there is no such tree. ``max_rounds`` bounds how often one ``tick_once`` ticks a tree that wakes itself."""
        key = library.find(tree_id, file)
        if key is None:
            known = ', '.join(sorted(library.tree_ids())) or 'none'
            raise LookupError(f'there is no tree [{tree_id}]; known trees: {known}')
        self.key: TreeKey = key
        self.blackboard = blackboard if blackboard is not None else Blackboard()
        self.context = TreeContext(
            clock if clock is not None else SteadyClock(), services, library.documents[key.file].scripts
        )
        self._substitute = substitute
        self._trunk = instantiate(library, key, self.blackboard, self.context, substitute)
        self._expanded: dict[ExpandingAction, Instance] = {}
        self._after_round: Callable[[], None] | None = None
        self._on_expanded: Callable[[], None] | None = None
        self.callbacks = TickCallbacks(self.context, lambda: self.nodes)
        self._join()
        self._max_rounds = max_rounds
        self.on_livelock: Callable[[str], None] = _logger.warning
        """Called with a message when a tick ends because the tree keeps waking itself."""
        self._failure: FailureTrace | None = None
        self._status = IDLE
        self.context.on_wake = on_wake

    def _join(self) -> None:
        """Make one of the tree itself and of those below leaves."""
        parts = (self._trunk, *self._expanded.values())
        self.nodes: tuple[TreeNode, ...] = tuple(node for part in parts for node in part.nodes)
        self.definitions: tuple[NodeDefinition, ...] = tuple(one for part in parts for one in part.definitions)
        self.subtrees: tuple[SubTreeInstance, ...] = tuple(subtree for part in parts for subtree in part.subtrees)
        for uid, node in enumerate(self.nodes, 1):
            node.uid = uid
        self.root = self.nodes[0]
        self._depth = sum(part.depth for part in parts)
        for node in self.nodes:
            watch(node)
        self._entry = self._fetch_entry()

    # -- ticking -----------------------------------------------------------------------------------------------------

    def tick_exactly_once(self) -> NodeStatus:
        """Tick once. A requested wake-up stays pending, see :meth:`take_wake`."""
        return self._settle(self._tick())

    def tick_once(self) -> NodeStatus:
        """One tick, and further ones as long as the tree is RUNNING and woken: a chain of nodes that yield completes.

        After ``max_rounds``, once the host wants to stop the tree (``callbacks.release``), and when a leaf has waited,
        it returns RUNNING with the wake-up pending: a tree that keeps waking itself can be paused and halted.
        """
        context = self.context
        context.waited = False
        status = self._tick()
        rounds = 1
        while status is RUNNING and context.woken and not (context.stopping or context.waited):
            if rounds >= self._max_rounds:
                self.on_livelock(f'tree [{self.key.id}] woke itself {rounds} times in one tick; it may never end')
                break
            context.woken = False
            status = self._tick()
            rounds += 1
        return self._settle(status)

    def tick_while_running(self, wait: Callable[[float], None], sleep_time: float = 0.01) -> NodeStatus:
        """Tick until the tree completes or is skipped.

        ``wait(time)`` waits for a wake-up, or for that time of the clock, in seconds: the one for which a node has
        asked, or ``sleep_time`` from now. That is as in BehaviorTree.CPP, for nodes that ask for nothing and expect
        the next tick: loops, and actions that look at each tick whether they are done.
        """
        while True:
            status = self.tick_once()
            if status is not RUNNING:
                return status
            latest = self.context.clock.now() + sleep_time
            due = self.next_wake
            wait(latest if due is None else min(due, latest))
            self.take_wake()

    def _tick(self) -> NodeStatus:
        deadlines = self.context.deadlines
        if deadlines:
            # This tick serves the requests that are due. A node that needs more asks again.
            now = self.context.clock.now()
            if now >= self.context.earliest:
                for node in [node for node, when in deadlines.items() if when <= now]:
                    del deadlines[node]
                self.context.earliest = min(deadlines.values(), default=math.inf)
        if self.context.advancing:
            self.context.advance_unfinished()
        if self.context.expansions:
            self._expand()
        if self.context.rewrapped:
            self.fetch_ticks()
        try:
            status = self._entry()
        except PortError as error:
            raise self._traced(NodeExecutionError(error.node_path, error.node_id, error, error.uid)) from error
        except NodeExecutionError as error:
            self._traced(error)
            raise
        if self.context.halt_errors:
            self._raise_halt_errors()
        return status

    def _expand(self) -> None:
        """Make the trees that leaves have requested."""
        context = self.context
        while context.expansions:
            leaf, (library, key, blackboard) = context.expansions.popitem()
            self._drop(leaf)
            uid = len(self.nodes) + 1
            try:
                part = instantiate(library, key, blackboard, context, self._substitute, leaf.path, uid)
            except Exception as error:
                leaf.adopt(None, error)
            else:
                self._expanded[leaf] = part
                leaf.adopt(part.nodes[0])
        self._join()
        if self._on_expanded is not None:
            self._on_expanded()

    def _drop(self, leaf: ExpandingAction) -> None:
        """Forget the tree below a leaf, and those below its leaves."""
        part = self._expanded.pop(leaf, None)
        for node in () if part is None else part.nodes:
            self.context.deadlines.pop(node, None)
            if isinstance(node, ExpandingAction):
                self._drop(node)

    def fetch_ticks(self) -> None:
        """Has the parents of nodes fetch the callables anew by which they tick them."""
        count = len(self.context.rewrapped)  # other threads add to them when they set callbacks
        rewrapped = set(self.context.rewrapped[:count])
        del self.context.rewrapped[:count]
        for node in self.nodes:
            if isinstance(node, ControlNode | DecoratorNode | ExpandingAction) and not rewrapped.isdisjoint(
                node.attached
            ):
                node.fetch_ticks()
        if self.root in rewrapped:
            self._entry = self._fetch_entry()

    def _fetch_entry(self) -> Tick:
        # A node with callbacks has two more calls.
        depth = 2 * self._depth if self.context.callbacks is not None else self._depth
        entry = with_room(tick_function(self.root), depth)
        after = self._after_round
        if after is None:
            return entry

        def round_with_end() -> NodeStatus:
            try:
                return entry()
            finally:
                after()

        return round_with_end

    def _settle(self, status: NodeStatus) -> NodeStatus:
        if status is not RUNNING:
            self._failure = None
            if status is not SKIPPED and self.root.stored_status is status:
                self.root.status = IDLE
        self._status = status
        return status

    def halt(self) -> None:
        """Halt all nodes, the RUNNING ones by their own means, and sets them to IDLE.

        Harmless at any time; also after an error. Work that goes on is in :attr:`unfinished`. Raises
        NodeExecutionError, after everything was halted, when a leaf raised.
        """
        # The root first, which halts what is RUNNING in its order. Then all others are halted, too: some keep counts
        # from one activation to the next, and scripts of _onHalted run for all, as in BehaviorTree.CPP.
        for node in (self.root, *self.nodes):
            try:
                node.halt_node()
            except NodeExecutionError as error:
                self.context.halt_errors.append(error)
        # A script of _onHalted that fails keeps the nodes above it from finishing their halt.
        for node in self.nodes:
            if node.stored_status is not IDLE:
                node.status = IDLE
        self.context.deadlines.clear()
        self.context.stopping = False
        self._status = IDLE
        self._raise_halt_errors()

    def empty_outputs(self, given: Container[str] = ()) -> None:
        """Empty what an earlier run has left on the blackboard and this one begins without, as its leaves say.

        Before the first tick. The entries of the tree's own blackboard that are ``given`` stay.
        """
        for leaf in [node for node in self.nodes if isinstance(node, LeafNode)]:
            for port in leaf.begins_without:
                key = leaf.port_key(port)
                entry = None if key is None else leaf.blackboard.entry(key)
                if key is None or entry is None or entry.value is EMPTY:
                    continue
                board, outer = leaf.blackboard.outermost(key)
                if board is not self.blackboard or outer not in given:
                    leaf.empty_output(port)

    def pause(self) -> tuple[str, ...]:
        """Has the RUNNING leaves hold what they have begun; the host does not tick the tree from now on.

        Return 'path: why' for each that continues nevertheless. May be called again, after a tick in between.
        """
        self.context.paused = True
        goes_on = []
        for leaf in self._running_leaves():
            try:
                why = leaf.on_pause()
            except Exception as error:
                why = f'on_pause raised {error!r}'
            if why:
                goes_on.append(f'{leaf.path}: {why}')
        return tuple(goes_on)

    def resume(self) -> None:
        """Has the RUNNING leaves go on; the next tick follows. Raises NodeExecutionError when a leaf raises."""
        self.context.paused = False
        for leaf in self._running_leaves():
            try:
                leaf.on_resume()
            except Exception as error:
                raise self._traced(leaf.fault(error)) from error

    def abandon(self) -> None:
        """End what the leaves have begun elsewhere: the thread that ticks the tree hangs in one of them, and cannot
        halt it. From another thread; the tree is not to be used any more.
        """
        for leaf in self._running_leaves():
            leaf.abandon()

    def _running_leaves(self) -> list[LeafNode]:
        return [node for node in self.nodes if node.stored_status is RUNNING and isinstance(node, LeafNode)]

    def _raise_halt_errors(self) -> None:
        errors = self.context.halt_errors
        if errors:
            first, *others = errors
            errors.clear()
            for other in others:
                first.add_note(f'another leaf raised while being halted: {other}')
            raise self._traced(first)

    def _traced(self, error: NodeExecutionError) -> NodeExecutionError:
        self._status = RUNNING  # it has not completed
        if error.uid:
            error.trace = trace_error(self.nodes, error.uid, error.reason)
        return error

    # -- waking ------------------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Ask for a tick. From any thread."""
        self.context.wake()

    def take_wake(self) -> bool:
        """Return whether a wake-up is pending; it is not, afterwards. A host that has waited calls it before it
        ticks."""
        woken = self.context.woken
        self.context.woken = False
        return woken

    @property
    def wake_pending(self) -> bool:
        """True if a wake-up is pending."""
        return self.context.woken

    @property
    def next_wake(self) -> float | None:
        """The earliest time of the clock at which a node wants a tick; None when none has asked."""
        return min(self.context.deadlines.values(), default=None)

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Unfinished work of leaves that were halted, described for people. ``on_wake`` is called when it changes."""
        return self.context.unfinished

    def advance_unfinished(self) -> None:
        """Let leaves go on that were halted and need ticks to come to their end.

        A host that waits until nothing is :attr:`unfinished` calls it when the tree is woken, and now and then. Raises
        NodeExecutionError as :meth:`halt` does.
        """
        self.context.advance_unfinished()
        self._raise_halt_errors()

    # -- what can be seen --------------------------------------------------------------------------------------------

    @property
    def status(self) -> NodeStatus:
        """Result of the last tick; IDLE before the first and after :meth:`halt`."""
        return self._status

    @property
    def failure(self) -> FailureTrace | None:
        """Reason why the last tick returned FAILURE, if it did. The nodes keep it until the next tick; the trace is
        built only on request."""
        if self._status is FAILURE and self._failure is None:
            self._failure = trace_failure(self.root)
        return self._failure if self._status is FAILURE else None

    def active_nodes(self, *, leaves_only: bool = False) -> list[str]:
        """Paths of the nodes that are RUNNING, in the order of their uid."""
        return [
            node.path
            for node in self.nodes
            if node.stored_status is RUNNING and (not leaves_only or _acts_itself(node))
        ]

    @property
    def observers(self) -> tuple[StatusObserver, ...]:
        """Listeners to changes of statuses, see :meth:`observe`."""
        return self.context.observers

    def observe(
        self,
        *observers: StatusObserver,
        after_round: Callable[[], None] | None = None,
        on_expanded: Callable[[], None] | None = None,
    ) -> None:
        """Report every change of a status to these observers from now on, in order and at once, on the ticking thread,
        and to no others.

        ``after_round()`` is called after each round of a tick, on its thread, also when that raises. ``on_expanded()``
        is called there between two rounds when leaves have had trees made below them (:class:`ExpandingAction`):
        ``nodes``, ``definitions`` and ``subtrees`` are others then, those of the tree itself first, as they were; the
        uids of the others are new, and mean them from the next change on. Not while another thread ticks the tree.
        """
        self.context.observers = observers
        self._after_round = after_round
        self._on_expanded = on_expanded
        for node in self.nodes:
            watch(node)
        self.context.rewrapped += self.nodes


def _acts_itself(node: TreeNode) -> bool:
    """Return whether it is a leaf that has not left the work to a tree below it."""
    below = any(child.stored_status is RUNNING for child in node.attached)
    return node.kind in (NodeKind.ACTION, NodeKind.CONDITION) and not below


def trace_failure(root: TreeNode) -> FailureTrace:
    """Why ``root`` has failed in its last tick."""
    steps: list[FailureStep] = []
    node: TreeNode | None = root
    while node is not None:
        if node.decided_by is not None:
            steps.append(FailureStep(node.path, f'{node.id}: {node.decided_by}'))
            break
        steps.append(FailureStep(node.path, node.failure_reason()))
        node = node.failure_cause()
    return FailureTrace(tuple(reversed(steps)))


def trace_error(nodes: tuple[TreeNode, ...], uid: int, reason: str) -> FailureTrace:
    """Return the way from the node ``uid``, which has raised for ``reason``, up to the root of the tree of these
    nodes."""
    parents = {child.uid: (node, place) for node in nodes for place, child in enumerate(node.attached, 1)}
    steps = [FailureStep(nodes[uid - 1].path, reason)]
    above = parents.get(uid)
    while above is not None:
        node, place = above
        count = len(node.attached)
        which = f'in child {place} of {count}' if count > 1 else 'in the child'
        steps.append(FailureStep(node.path, f'{node.id}: {which}'))
        above = parents.get(node.uid)
    return FailureTrace(tuple(steps))


# Room for the nested calls by which a deep tree is ticked.

T = TypeVar('T')

# Nested Python frames per level of a tree (a node whose tick is Python code in a base class of ours has three; its
# pre- and post-conditions have up to three more), and what host and leaves need on top.
_FRAMES_PER_LEVEL: Final = 6
_FRAMES_OF_HOST: Final = 1000

# CPython keeps the frames of Python calls in chunks of 16 KiB, which it gets from the system, and gives back, one by
# one as calls nest and return. A call whose frame is larger gets a chunk of the next power of two that holds it.
_CHUNK_BYTES: Final = 1 << 14
_SLOT_BYTES: Final = 8
_SLOTS_PER_FRAME: Final = 24
_FEW_CHUNKS: Final = 20


def with_room(call: Callable[[], T], depth: int) -> Callable[[], T]:
    """``call``, to be called instead of it when it nests as deep as a tree of ``depth`` levels.

    Raises the recursion limit if need be. It holds for the whole process, so it is only ever raised; it guards the
    C stack against recursion without end, and calls from Python to Python, which ticks are, do not use the C stack.
    """
    frames = depth * _FRAMES_PER_LEVEL
    if sys.getrecursionlimit() < frames + _FRAMES_OF_HOST:
        sys.setrecursionlimit(frames + _FRAMES_OF_HOST)
    wanted = frames * _SLOTS_PER_FRAME * _SLOT_BYTES
    if wanted <= _FEW_CHUNKS * _CHUNK_BYTES:
        return call
    # Half of the chunk is the frame of this call, which does not use it; the other half is for the calls within.
    half = _CHUNK_BYTES
    while half < wanted:
        half *= 2
    code = _call.__code__.replace(co_stacksize=half // _SLOT_BYTES)
    return functools.partial(types.FunctionType(code, globals()), call)


def _call(call: Callable[[], T]) -> T:
    return call()
