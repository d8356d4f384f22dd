# SPDX-License-Identifier: BSD-3-Clause
"""A running tree for Groot2: structure, statuses, transitions, blackboards, breakpoints. Needs msgpack."""

from __future__ import annotations

import json
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from typing import Any, Final

import msgpack

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.observers import LogReader
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes, show_blackboard
from flexbt_core.behavior_tree.model.errors import TickAbandoned
from flexbt_core.behavior_tree.model.status import NodeStatus

from . import json_requests as read
from . import protocol
from .json_requests import RequestError
from .log_file import LogBuffer
from .protocol import tree_document

RECORDED: Final = 1000
"""Maximum number of transitions that a recording keeps for the client; it drops the oldest."""

clock = time.perf_counter_ns
"""Clock of the logs of watched trees."""

ROOT: Final = 'ROOT'
"""Name of the topmost blackboard in the reply to a request for others."""

_MANY: Final = 2000
"""Number of marks above which the thread of the run reads them without a request."""

_LARGEST: Final = (-(1 << 63), (1 << 64) - 1)


class WatchedTree:
    """One run of a tree. The server thread reads the log of the tree when a client sends a request."""

    def __init__(
        self,
        tree: Tree,
        log: LogBuffer,
        types: JsonTypes,
        on_reached: Callable[[int], None],
        on_held: Callable[[bool], None],
    ) -> None:
        self.tree = tree
        self.uuid = uuid.uuid4().bytes
        self.breakpoints = Breakpoints(tree, on_reached, on_held)
        self._types = types
        self._document: str | None = None
        self._boards: dict[str, Blackboard] = {}
        for subtree in tree.subtrees:
            self._boards.setdefault(subtree.path or subtree.tree_id, subtree.blackboard)
        # Position of each node's status: sub-tree by sub-tree, in the order of their creation, as clients expect.
        self._places = [0] * (len(tree.nodes) + 1)
        self._statuses = bytearray()
        groups: dict[int, list[TreeNode]] = {id(subtree.blackboard): [] for subtree in tree.subtrees}
        for node in tree.nodes:
            groups[id(node.blackboard)].append(node)
        for group in groups.values():
            for node in group:
                self._statuses += protocol.status_bytes(node.uid, node.status)
                self._places[node.uid] = len(self._statuses) - 1
        self.log = log
        self._reader = LogReader(tree.nodes, self._change)
        self._reading = threading.RLock()
        self._ended = False
        self._recorded: deque[tuple[int, int, int]] = deque(maxlen=RECORDED)
        self._recorded_from = 0
        # Changes whose time has not been read yet.
        self._untimed: list[tuple[int, int]] = []

    def _change(self, uid: int, before: int, after: int) -> tuple[int, int, int, int]:
        """Return the position and status of a change for clients, and the values to record."""
        return self._places[uid], protocol.status_byte(before, after), uid, after

    def same_tree(self, other: WatchedTree) -> bool:
        """Return whether both are runs of the same tree with the same nodes."""
        ours, theirs = self.tree.definitions, other.tree.definitions
        return len(ours) == len(theirs) and all(one is two for one, two in zip(ours, theirs, strict=True))

    def end(self) -> None:
        """Read the last marks of these nodes, and end a recording of them.

        Later marks belong to another watched tree, even if a request arrives late.
        """
        with self._reading:
            self._read()
            self.log.timed = False
            self._ended = True

    def settle(self) -> None:
        """Read the marks of a round of a tick if there are many."""
        if len(self.log) > _MANY:
            self._read()

    def _read(self) -> None:
        with self._reading:
            if self._ended:
                return
            marks = self.log.take()
            if self.log.timed:
                self._read_timed(marks)
                return
            statuses = self._statuses
            for place, shown, _, _ in self._reader.read([mark for mark in marks if mark >= 0]):
                statuses[place] = shown

    def _read_timed(self, marks: list[int]) -> None:
        for mark in marks:
            if mark < 0:
                self._recorded.extend((~mark, *change) for change in self._untimed)
                self._untimed.clear()
                continue
            for place, shown, uid, after in self._reader.read((mark,)):
                self._statuses[place] = shown
                self._untimed.append((uid, after))

    # -- on the thread of the server -----------------------------------------------------------------------------------

    def document(self) -> bytes:
        if self._document is None:
            self._document = tree_document(self.tree)
        return self._document.encode()

    def statuses(self) -> bytes:
        self._read()
        return bytes(self._statuses)

    def toggle_recording(self, command: bytes) -> bytes | None:
        """Start recording and return the time since the epoch in µs, or stop recording."""
        if command not in (b'start', b'stop'):
            return None
        with self._reading:
            self._read()
            self._untimed.clear()
            if not self._ended:
                self.log.timed = command == b'start'
            if command == b'stop':
                return None
            self._recorded.clear()
            self._recorded_from = clock()
            return str(time.time_ns() // 1000).encode()

    def transitions(self) -> bytes:
        """Return the transitions recorded since the last call."""
        with self._reading:
            self._read()
            recorded = list(self._recorded)
            self._recorded.clear()
            start = self._recorded_from
        return b''.join(protocol.record(max(0, when - start) // 1000, uid, status) for when, uid, status in recorded)

    def blackboards(self, names: str) -> bytes:
        """Return the blackboards of sub-trees as msgpack. ``names`` are the paths of the sub-trees (the tree ID for the
        main one), separated by ``;``. Missing ones are left out. Raises RequestError if a sub-tree has the name of the
        topmost blackboard."""
        boards: dict[str, dict[str, Any] | None] = {}
        top: Blackboard | None = None
        for name in dict.fromkeys(names.split(';')):
            board = self._boards.get(name)
            if board is None:
                continue
            external = board.root if board.root is not board else None
            if name == ROOT and (external is not None or top is not None):
                raise RequestError(
                    'blackboard dump request uses reserved name [ROOT] together with an external root blackboard export'
                )
            boards[name] = self._shown(board)
            if external is not None and top is None:
                if ROOT in boards:
                    raise RequestError(
                        'blackboard dump request would overwrite subtree [ROOT] with an external root blackboard export'
                    )
                top = external
                boards[ROOT] = self._shown(top)
        # As in BehaviorTree.CPP, an empty result is null.
        packed: bytes = msgpack.packb(_packable(boards) if boards else None, unicode_errors='replace')
        return packed

    def _shown(self, board: Blackboard) -> dict[str, Any] | None:
        return show_blackboard(board, self._types) or None


def _packable(value: Any) -> Any:
    """Return the value, with integers that are too large for msgpack replaced by text."""
    if isinstance(value, dict):
        return {key: _packable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_packable(item) for item in value]
    if isinstance(value, int) and not _LARGEST[0] <= value <= _LARGEST[1]:
        return str(value)
    return value


# The hooks that Groot2 sets on nodes of a tree: breakpoints, which block its ticking thread, and replaced results.
#
# Rules: Groot2Publisher of BehaviorTree.CPP 4.10.

UNKNOWN_NODE: Final = 'Node ID not found'


class HookMode(IntEnum):
    """The effect of a hook when its node is reached. Other numbers count as REPLACE."""

    BREAKPOINT = 0
    REPLACE = 1


@dataclass
class HookSettings:
    """The settings of a hook, as clients see them. ``position`` is 0 before the tick, otherwise after it."""

    enabled: bool
    uid: int
    mode: int
    once: bool
    desired_status: str
    position: int

    @classmethod
    def read(cls, document: Any) -> HookSettings:
        """Return the settings in the JSON of a request. Raises RequestError."""
        # In the order of BehaviorTree.CPP: the first fault is told.
        uid = read.unsigned_16(read.member(document, 'uid'))
        position = read.signed_32(read.member(document, 'position'))
        enabled = read.boolean(read.member(document, 'enabled'))
        once = read.boolean(read.member(document, 'once'))
        mode = read.signed_32(read.member(document, 'mode'))
        status = read.string(read.member(document, 'desired_status'))
        if status not in NodeStatus.__members__:
            raise RequestError(f'Cannot convert this to NodeStatus: {status}')
        return cls(enabled, uid, mode, once, status, position)


class _Hook:
    """A hook in use. ``ready``: it does not hold up the present or the next tick that reaches it."""

    def __init__(self, settings: HookSettings) -> None:
        self.settings = settings
        self.ready = False


class Breakpoints:
    """The hooks of one tree, and Groot2's requests about them. From any thread.

    ``on_reached(uid)`` is called when the tree reaches an enabled hook, ``on_held(held)`` when a breakpoint holds or
    releases the tree; both on the ticking thread.
    """

    def __init__(self, tree: Tree, on_reached: Callable[[int], None], on_held: Callable[[bool], None]) -> None:
        self._callbacks = tree.callbacks
        self._nodes = {node.uid: node for node in tree.nodes}
        self._on_reached = on_reached
        self._on_held = on_held
        self._placed: dict[tuple[bool, int], _Hook] = {}
        self._muted = False
        self._ended = False
        self._holding: _Hook | None = None
        self._changed = threading.Condition()
        self._callbacks.on_release = self._look

    @property
    def held(self) -> bool:
        """True if a breakpoint holds the tree and has not been released."""
        with self._changed:
            return self._holding is not None and not self._goes_on(self._holding)

    def take_over(self, older: Breakpoints) -> None:
        """Copy the hooks of an earlier run of the same tree."""
        for settings in older.all():
            self._place(settings)

    def take_over_from(self, older: Breakpoints) -> None:
        """Move the hooks of the same run here after its nodes have changed, for nodes that still exist."""
        for settings in older.end():
            if self._nodes.get(settings.uid) is older._nodes[settings.uid]:
                self._place(settings)

    def end(self) -> list[HookSettings]:
        """Remove all hooks and return their settings. From now on insert nothing: a request may arrive late."""
        with self._changed:
            self._ended = True
            settings = self.all()
            self.remove_all()
            return settings

    def all(self) -> list[HookSettings]:
        """Return copies of the settings of all hooks, those before ticks first, by uid."""
        with self._changed:
            return [replace(hook.settings) for _, hook in sorted(self._placed.items(), key=lambda item: item[0])]

    def mute(self, muted: bool) -> None:
        """Disable all hooks while ``muted`` is true: they have no effect and hold nothing up. Their settings stay."""
        with self._changed:
            self._muted = muted
            self._changed.notify_all()

    # -- requests ----------------------------------------------------------------------------------------------------

    def insert(self, document: Any) -> None:
        """Insert one hook or several. An existing hook gets the new settings. Raises RequestError.

        Hooks of nodes that do not exist are dropped.
        """
        for item in document if isinstance(document, list) else [document]:
            self._place(HookSettings.read(item))

    def _place(self, settings: HookSettings) -> None:
        place = (settings.position != 0, settings.uid)
        with self._changed:
            if self._ended:
                return
            hook = self._placed.get(place)
            if hook is not None:
                if hook.settings.mode == HookMode.BREAKPOINT and settings.mode == HookMode.REPLACE:
                    hook.ready = True
                hook.settings = settings
                self._changed.notify_all()
                return
            node = self._nodes.get(settings.uid)
            if node is None:
                return
            hook = self._placed[place] = _Hook(settings)
            if settings.position == 0:
                self._callbacks.set_pre_tick(node, lambda node: self._reach(hook, node))
            else:
                self._callbacks.set_post_tick(node, lambda node, status: self._reach(hook, node))

    def remove(self, document: Any) -> None:
        """Remove the hook of a node. Raises RequestError."""
        uid = read.unsigned_16(read.member(document, 'uid'))
        after = read.signed_32(read.member(document, 'position')) != 0
        with self._changed:
            if (after, uid) not in self._placed:
                raise RequestError(UNKNOWN_NODE)
            self._drop(after, uid)

    def remove_all(self) -> None:
        with self._changed:
            for after, uid in tuple(self._placed):
                self._drop(after, uid)

    def disable_all(self) -> None:
        with self._changed:
            for hook in self._placed.values():
                hook.settings.enabled = False
            self._changed.notify_all()

    def unlock(self, document: Any) -> None:
        """Release a breakpoint, with the result for its node. Raises RequestError."""
        uid = read.unsigned_16(read.member(document, 'uid'))
        status = read.string(read.member(document, 'desired_status'))
        after = read.signed_32(read.member(document, 'position')) != 0
        remove = read.boolean(read.member(document, 'remove_when_done'))
        with self._changed:
            hook = self._placed.get((after, uid))
            if hook is None:
                raise RequestError(UNKNOWN_NODE)
            settings = hook.settings
            settings.desired_status = status if status in ('SUCCESS', 'FAILURE') else 'SKIPPED'
            settings.once = settings.once or remove
            if settings.mode == HookMode.BREAKPOINT:
                hook.ready = True
                self._changed.notify_all()

    def dump(self) -> str:
        """Return all hooks, as JSON."""
        return json.dumps([asdict(settings) for settings in self.all()], separators=(',', ':'), sort_keys=True)

    # -- on the ticking thread -----------------------------------------------------------------------------------------

    def _reach(self, hook: _Hook, node: TreeNode) -> NodeStatus:
        if not hook.settings.enabled or self._muted:
            return NodeStatus.SKIPPED
        self._on_reached(node.uid)
        with self._changed:
            if hook.settings.mode == HookMode.BREAKPOINT:
                self._hold(hook)
                hook.ready = False
            if self._callbacks.released:
                raise TickAbandoned(node.path, node.id, 'the tree was stopped while a breakpoint held this node up')
            settings = hook.settings
            if not settings.enabled or self._muted:
                return NodeStatus.SKIPPED
            if settings.once:
                self._drop(settings.position != 0, settings.uid)
            return NodeStatus[settings.desired_status]

    def _hold(self, hook: _Hook) -> None:
        if self._goes_on(hook):
            return
        self._holding = hook
        self._on_held(True)
        try:
            self._changed.wait_for(lambda: self._goes_on(hook))
        finally:
            self._holding = None
            self._on_held(False)

    def _goes_on(self, hook: _Hook) -> bool:
        return hook.ready or not hook.settings.enabled or self._muted or self._callbacks.released

    def _drop(self, after: bool, uid: int) -> None:
        hook = self._placed.pop((after, uid))
        hook.settings.enabled = False
        if after:
            self._callbacks.set_post_tick(self._nodes[uid], None)
        else:
            self._callbacks.set_pre_tick(self._nodes[uid], None)
        self._changed.notify_all()

    def _look(self) -> None:
        with self._changed:
            self._changed.notify_all()
