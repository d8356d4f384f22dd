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
    """A tree that can be ticked. One thread at a time may tick or halt it; any thread may call ``wake``.

    ``library`` and ``tree_id`` (with the document ``file`` to search first) select the tree. ``on_wake()`` is called,
    from any thread, when a leaf requests a tick, and when unfinished work ends. ``substitute(definition, path)`` may
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
        """Make the nodes. Raises TreeLoadError if nodes use one blackboard entry with several types or one cannot be
        made, LookupError if the tree is unknown. ``max_rounds`` limits the ticks of a tree that wakes itself in one
        ``tick_once``."""
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
        """Join the nodes of the tree itself and those of the trees below leaves."""
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
        """Tick once. A wake-up stays pending, see :meth:`take_wake`."""
        return self._settle(self._tick())

    def tick_once(self) -> NodeStatus:
        """Tick once, and again while the tree is RUNNING and woken, so that a chain of yielding nodes completes.

        After ``max_rounds``, when the host wants to stop the tree (``callbacks.release``), and after a leaf has waited,
        return RUNNING with the wake-up pending, so that a tree that keeps waking itself can be paused and halted.
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

        ``wait(time)`` waits for a wake-up, or for that time of the clock, in seconds: the one that a node has
        requested, or ``sleep_time`` from now. As in BehaviorTree.CPP, this serves nodes that request nothing and expect
        the next tick: loops, and actions that check at each tick whether they are done.
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
        self._status = RUNNING  # it has not completed
        deadlines = self.context.deadlines
        if deadlines:
            # This tick serves the due requests. A node that needs another tick requests it again.
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
            raise self._traced(self.root.fault(error)) from error
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
            uid = 1 + sum(len(part.nodes) for part in (self._trunk, *self._expanded.values()))
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
        """Remove the tree below a leaf, and those below its leaves."""
        part = self._expanded.pop(leaf, None)
        for node in () if part is None else part.nodes:
            self.context.deadlines.pop(node, None)
            if isinstance(node, ExpandingAction):
                self._drop(node)

    def fetch_ticks(self) -> None:
        """Make the parents of changed nodes fetch their tick functions again."""
        count = len(self.context.rewrapped)  # other threads append to the list when they set callbacks
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
        # Callbacks nest two more calls per node.
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
        """Halt all nodes and set them to IDLE.

        Harmless at any time, even after an error. Work that continues is in :attr:`unfinished`. Raises
        NodeExecutionError, after all nodes are halted, if a leaf raised.
        """
        # The root first, which halts the RUNNING nodes in order. Then all others: some keep counts from one activation
        # to the next, and _onHalted scripts run for all, as in BehaviorTree.CPP.
        for node in (self.root, *self.nodes):
            try:
                node.halt_node()
            except NodeExecutionError as error:
                self.context.halt_errors.append(error)
        # A failing _onHalted script keeps the nodes above it from finishing their halt.
        for node in self.nodes:
            if node.stored_status is not IDLE:
                node.status = IDLE
        self.context.deadlines.clear()
        self.context.stop_requested = self.context.stopping = self.context.paused = False
        self._status = IDLE
        self._raise_halt_errors()

    def empty_outputs(self, given: Container[str] = ()) -> None:
        """Empty the outputs of an earlier run that leaves declare in ``begins_without``. Before the first tick.

        Entries of the tree's own blackboard whose keys are in ``given`` keep their values.
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
        """Make the RUNNING leaves pause their work; the host must not tick the tree until it resumes it.

        Return 'path: why' for each leaf whose work continues. May be called again, after a tick in between.
        """
        self.context.paused = True
        goes_on = []
        for leaf in self._running_leaves():
            try:
                why = leaf.on_pause()
            except BaseException as error:
                why = f'on_pause raised {leaf.fault(error).reason}'
            if why:
                goes_on.append(f'{leaf.path}: {why}')
        return tuple(goes_on)

    def resume(self) -> None:
        """Make the RUNNING leaves resume; the next tick follows. Raises NodeExecutionError if a leaf raises."""
        self.context.paused = False
        for leaf in self._running_leaves():
            try:
                leaf.on_resume()
            except BaseException as error:
                raise self._traced(leaf.fault(error)) from error

    def abandon(self) -> None:
        """End the work that leaves have started outside the tree, because the ticking thread hangs in one of them and
        cannot halt the tree. From another thread; the tree must not be used afterwards.
        """
        for leaf in self._running_leaves():
            leaf.stop_by(leaf.abandon)

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
        if error.uid:
            error.trace = trace_error(self.nodes, error.uid, error.reason)
        return error

    # -- waking ------------------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Request a tick. From any thread."""
        self.context.wake()

    def take_wake(self) -> bool:
        """Return True if a wake-up is pending, and clear it. A host that has waited calls this before it
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
        """Earliest time of the clock for which a node has requested a tick; None without requests."""
        return min(self.context.deadlines.values(), default=None)

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Descriptions of the unfinished work of halted leaves. ``on_wake`` is called when some of it ends."""
        return self.context.unfinished

    def advance_unfinished(self) -> None:
        """Advance halted leaves that need ticks to end.

        A host that waits until nothing is :attr:`unfinished` calls it when the tree is woken, and periodically. Raises
        NodeExecutionError as :meth:`halt` does.
        """
        self.context.advance_unfinished()
        self._raise_halt_errors()

    # -- observation -------------------------------------------------------------------------------------------------

    @property
    def status(self) -> NodeStatus:
        """Result of the last tick; IDLE before the first and after :meth:`halt`."""
        return self._status

    @property
    def failure(self) -> FailureTrace | None:
        """Reason why the last tick returned FAILURE; None if it did not. Nodes keep it until the next tick; the trace
        is built only on request."""
        if self._status is FAILURE and self._failure is None:
            self._failure = trace_failure(self.root)
        return self._failure if self._status is FAILURE else None

    def active_nodes(self, *, leaves_only: bool = False) -> list[str]:
        """Return the paths of the RUNNING nodes, in the order of their uid."""
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
        """Replace the observers: report every status change to these, in order and at once, on the ticking thread.

        ``after_round()`` is called after each round of a tick, on its thread, even if the round raises.
        ``on_expanded()`` is called there, between two rounds, after trees were made below leaves
        (:class:`ExpandingAction`). ``nodes``, ``definitions`` and ``subtrees`` have changed then: those of the tree
        itself come first, unchanged; the uids of the others are new, and valid from the next change on. Do not call
        this method while another thread ticks the tree.
        """
        self.context.observers = observers
        self._after_round = after_round
        self._on_expanded = on_expanded
        for node in self.nodes:
            watch(node)
        self.context.rewrapped += self.nodes


def _acts_itself(node: TreeNode) -> bool:
    """Return True for a leaf, unless its work is done by a tree below it."""
    below = any(child.stored_status is RUNNING for child in node.attached)
    return node.kind in (NodeKind.ACTION, NodeKind.CONDITION) and not below


def trace_failure(root: TreeNode) -> FailureTrace:
    """Return why ``root`` failed in its last tick."""
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
    """Return the trace from the node ``uid``, which raised for ``reason``, up to the root of the tree of these
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


# Stack space for the nested calls that tick a deep tree.

T = TypeVar('T')

# Nested Python frames per level of a tree (a node whose base class calls a tick in Python has three; its pre- and
# post-conditions have up to three more), and the additional frames of host and leaves.
_FRAMES_PER_LEVEL: Final = 6
_FRAMES_OF_HOST: Final = 1000

# CPython keeps the frames of Python calls in chunks of 16 KiB, allocated and freed one by one as calls nest and
# return. A call whose frame is larger gets a chunk of the next power of two that holds it.
_CHUNK_BYTES: Final = 1 << 14
_SLOT_BYTES: Final = 8
_SLOTS_PER_FRAME: Final = 24
_FEW_CHUNKS: Final = 20


def with_room(call: Callable[[], T], depth: int) -> Callable[[], T]:
    """Return a replacement for ``call`` that has stack space for the calls of a tree of ``depth`` levels.

    Increases the recursion limit if necessary, and never reduces it, since it applies to the whole process. The limit
    protects the C stack against endless recursion; ticks are calls from Python to Python, which do not use the C stack.
    """
    frames = depth * _FRAMES_PER_LEVEL
    if sys.getrecursionlimit() < frames + _FRAMES_OF_HOST:
        sys.setrecursionlimit(frames + _FRAMES_OF_HOST)
    wanted = frames * _SLOTS_PER_FRAME * _SLOT_BYTES
    if wanted <= _FEW_CHUNKS * _CHUNK_BYTES:
        return call
    # The unused frame of this call fills half of the chunk; the other half holds the frames of the calls within.
    half = _CHUNK_BYTES
    while half < wanted:
        half *= 2
    code = _call.__code__.replace(co_stacksize=half // _SLOT_BYTES)
    return functools.partial(types.FunctionType(code, globals()), call)


def _call(call: Callable[[], T]) -> T:
    return call()
