# SPDX-License-Identifier: BSD-3-Clause
"""The hooks that Groot2 puts on nodes of a tree: breakpoints, which hold up its ticking thread, and replacements.

Rules: Groot2Publisher of BehaviorTree.CPP 4.10.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from typing import Any, Final

from flexbt_core.behavior_tree import NodeStatus, TickAbandoned, Tree, TreeNode

from . import json_requests as read
from .json_requests import RequestError

UNKNOWN_NODE: Final = 'Node ID not found'


class Mode(IntEnum):
    """What a hook does when its node is reached. Other numbers are as REPLACE."""

    BREAKPOINT = 0
    REPLACE = 1


@dataclass
class Settings:
    """A hook as the client sees it. ``position`` is 0 before the tick, otherwise after it."""

    enabled: bool
    uid: int
    mode: int
    once: bool
    desired_status: str
    position: int

    @classmethod
    def read(cls, document: Any) -> Settings:
        """From the JSON of a request. Raises RequestError."""
        status = read.string(read.member(document, 'desired_status'))
        if status not in NodeStatus.__members__:
            raise RequestError(f'Cannot convert this to NodeStatus: {status}')
        return cls(
            enabled=read.boolean(read.member(document, 'enabled')),
            uid=read.unsigned_16(read.member(document, 'uid')),
            mode=read.signed_32(read.member(document, 'mode')),
            once=read.boolean(read.member(document, 'once')),
            desired_status=status,
            position=read.signed_32(read.member(document, 'position')),
        )


class _Hook:
    """A hook in use. ``ready``: the next time that it is reached, or now when it is, it does not hold up the tick."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.ready = False


class Breakpoints:
    """The hooks of one tree; the requests of Groot2 about them. From any thread.

    ``on_reached(uid)`` is called when a hook that is enabled is reached, ``on_held(held)`` when a breakpoint holds the
    tree up and when it lets go; both on the ticking thread.
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
        """Whether a breakpoint holds the tree up, and nothing has let it go yet."""
        with self._changed:
            return self._holding is not None and not self._goes_on(self._holding)

    def take_over(self, older: Breakpoints) -> None:
        """Places the hooks of an earlier run of the same tree."""
        for settings in older.all():
            self._place(settings)

    def take_over_from(self, older: Breakpoints) -> None:
        """Takes the hooks of the same run from before it had other nodes: those of nodes that it has still."""
        for settings in older.end():
            if self._nodes.get(settings.uid) is older._nodes[settings.uid]:
                self._place(settings)

    def end(self) -> list[Settings]:
        """Removes all hooks, and gives their settings; from now on none is placed: a request may have come late."""
        with self._changed:
            self._ended = True
            settings = self.all()
            self.remove_all()
            return settings

    def all(self) -> list[Settings]:
        """Copies of the settings of all hooks, those before ticks first, by uid."""
        with self._changed:
            return [replace(hook.settings) for _, hook in sorted(self._placed.items(), key=lambda item: item[0])]

    def mute(self, muted: bool) -> None:
        """While muted, hooks have no effect, and hold nothing up. They are as they were afterwards."""
        with self._changed:
            self._muted = muted
            self._changed.notify_all()

    # -- requests ----------------------------------------------------------------------------------------------------

    def insert(self, document: Any) -> None:
        """Places one hook or several; one that is there gets other settings. Raises RequestError.

        Hooks of nodes that do not exist are dropped.
        """
        for item in document if isinstance(document, list) else [document]:
            self._place(Settings.read(item))

    def _place(self, settings: Settings) -> None:
        place = (settings.position != 0, settings.uid)
        with self._changed:
            if self._ended:
                return
            hook = self._placed.get(place)
            if hook is not None:
                if hook.settings.mode == Mode.BREAKPOINT and settings.mode == Mode.REPLACE:
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
        """Removes the hook of a node. Raises RequestError."""
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
        """Lets a breakpoint go, with the result that the node is to have. Raises RequestError."""
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
            if settings.mode == Mode.BREAKPOINT:
                hook.ready = True
                self._changed.notify_all()

    def dump(self) -> str:
        """All hooks, as JSON."""
        return json.dumps([asdict(settings) for settings in self.all()], separators=(',', ':'), sort_keys=True)

    # -- on the ticking thread -----------------------------------------------------------------------------------------

    def _reach(self, hook: _Hook, node: TreeNode) -> NodeStatus:
        if not hook.settings.enabled or self._muted:
            return NodeStatus.SKIPPED
        self._on_reached(node.uid)
        with self._changed:
            if hook.settings.mode == Mode.BREAKPOINT:
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
