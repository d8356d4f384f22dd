# SPDX-License-Identifier: BSD-3-Clause
"""The monitor of a tree's run: it watches leaves that take time, from their start to their end or halt.

These leaves get a derived class that reports the calls of ``on_start``, ``on_running`` and ``on_halted`` to the
monitor. Other nodes are unchanged, so monitoring costs time only for the leaves that run in a tick.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Final

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction, ThreadedAction
from flexbt_core.behavior_tree.engine.context import UnfinishedWork
from flexbt_core.behavior_tree.engine.leaf import LeafNode, StatefulAction
from flexbt_core.behavior_tree.engine.node import TreeNode, kept_by_class
from flexbt_core.behavior_tree.engine.parents import Control
from flexbt_core.behavior_tree.engine.registry import node_skill
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import NodeDefinition
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus

from .properties import Property, Violation, shared_actuators
from .requirement_text import Vocabulary, tree_vocabulary
from .requirements import NodeOrState, NodesOrStates, Requirement, Requirements

_ABSENT: Final = object()


class TreeMonitor:
    """A monitor of one run of a tree; ``found`` is called with each violation. Used on the ticking thread.

    It checks that a working leaf is ticked or was halted; that no leaf works, waits or acts after the end or a halt;
    that an actuator has one owner, also while a halted leaf ends; and, with ``is_woken_only``, that something wakes a
    RUNNING tree. ``requirements`` are those of the mission. ::

        monitor = TreeMonitor(found)
        tree = Tree(library, 'Main', substitute=monitor.watched)
        monitor.begins(tree)
        monitor.ticked(tree.tick_once())       # after each tick
        tree.halt()
        monitor.halted()
    """

    def __init__(
        self, found: Callable[[Violation], None], requirements: Iterable[Requirement] = (), is_woken_only: bool = False
    ) -> None:
        self.going_on: set[LeafNode] = set()
        """Leaves that were RUNNING in this tick."""
        self.answered: dict[Control, None] = {}
        """Controls of users that returned RUNNING in this tick; one that was skipped may still be RUNNING."""
        self._found = found
        self.requirements = Requirements(requirements, lambda: self._tree.context.clock.now(), found)
        self._has_requirements = bool(self.requirements.requirements)
        self._named = self.requirements.names
        self._is_woken_only = is_woken_only
        self._nodes: tuple[TreeNode, ...] = ()  # the nodes whose resources are known
        self._resources: dict[TreeNode, frozenset[str]] = {}
        self._aliases: dict[str, str] = {}  # by path: the path without the numbers of unnamed nodes
        self._called: dict[TreeNode, tuple[str, ...]] = {}  # the names of the leaves in requirements
        self._open: dict[LeafNode, None] = {}  # leaves that work
        self._acting: dict[LeafNode, None] = {}  # owners of actuators
        self._ending: dict[LeafNode, tuple[UnfinishedWork, ...]] = {}  # unfinished work of halted leaves
        self._answers: dict[TreeNode, NodeStatus] = {}  # results of conditions in this tick
        self._starting: LeafNode | None = None
        self._is_taken = False  # an actuator was taken: check the owners after the tick
        self._tree: Tree

    # -- for the host of the tree ------------------------------------------------------------------------------------

    def watched(self, definition: NodeDefinition, path: str) -> NodeDefinition:
        """Return the definition that replaces that of a node: see ``substitute`` of :class:`Tree`."""
        manifest = definition.manifest
        alias = self._alias(definition.tree_id or manifest.id, definition.name, path)
        if definition.tree_id is not None:
            return definition
        if issubclass(manifest.node_class, Control) and self._is_woken_only:
            made = _watched_control(manifest.node_class)
        elif not issubclass(manifest.node_class, LeafNode):
            return definition
        elif issubclass(manifest.node_class, StatefulAction):
            made = _watched_action(manifest.node_class)
        elif not self._named.isdisjoint((path, alias)):
            made = _watched_leaf(manifest.node_class)
        else:
            return definition
        return definition._replace(manifest=replace(manifest, node_class=made))

    def _alias(self, id: str, name: str, path: str) -> str:
        scope = (path.rpartition('::')[0] if name == id else path)[: -len(name) - 1]
        alias = self._aliases[path] = f'{self._aliases.get(scope, scope)}/{name}' if scope else name
        return alias

    def begins(self, tree: Tree) -> None:
        """Begin monitoring, after the nodes are created and before the first tick."""
        self._tree = tree
        tree.context.monitor = self
        self._learn()

    def _learn(self) -> None:
        """Collect the actuators of nodes and the names of leaves. A leaf is named by its path, an unnamed one also by
        its type unless another leaf has that as its name. Call it again when leaves get their own trees, whose nodes
        then belong to the tree."""
        tree = self._tree
        self._nodes = tree.nodes
        names = {node: self._names(node) for node in tree.nodes}
        own = {path for node, (path, *_) in names.items() if isinstance(node, LeafNode)}
        self._called = {
            node: (path, *(alias for alias in aliases if alias not in own))
            for node, (path, *aliases) in names.items()
            if isinstance(node, LeafNode)
        }
        for node, definition in zip(tree.nodes, tree.definitions, strict=True):
            skill = node_skill(definition.manifest) if isinstance(node, StatefulAction) else None
            if skill is not None and skill.resources:
                self._resources[node] = frozenset(skill.resources)

    @property
    def vocabulary(self) -> Vocabulary:
        """Names that requirements of this tree can use."""
        leaves = [node for node in self._tree.nodes if isinstance(node, LeafNode)]
        names = ((name, isinstance(leaf, StatefulAction)) for leaf in leaves for name in self._names_of(leaf))
        return tree_vocabulary(names, self._parts())

    def _parts(self) -> NodesOrStates:
        found: dict[str, list[NodeOrState]] = {}
        scopes = {one.blackboard: f'{one.path}/' if one.path else '' for one in self._tree.subtrees}
        for node, definition in zip(self._tree.nodes, self._tree.definitions, strict=True):
            values = {}
            for port, value in definition.values.items():
                if value.key is None:
                    values[port] = str(value.text)
                else:
                    board, key = node.blackboard.outermost(value.key)
                    values[port] = f'{{{scopes.get(board, "@")}{key}}}'
            for name in self._names_of(node):
                found.setdefault(name, []).append(NodeOrState(definition.tree_id or node.id, values))
        return found

    def _names_of(self, node: TreeNode) -> tuple[str, ...]:
        return self._called.get(node) or self._names(node)

    def _names(self, node: TreeNode) -> tuple[str, ...]:
        path = node.path
        return tuple(dict.fromkeys((path, self._alias(node.id, node.name, path))))

    def check_parts(self) -> None:
        """Check the parts of the tree against the requirements, before its first tick."""
        if self.requirements.are_about_parts:
            self.requirements.check_parts(self._parts())

    def ticked(self, status: NodeStatus) -> None:
        """Check the tree after a tick that returned ``status``."""
        opened = self._open
        if len(self.going_on) < len(opened):
            for path in [leaf.path for leaf in opened if leaf not in self.going_on]:
                text = f'{path} continues, but nothing ticks it any more: it was not halted'
                self._found(Violation(Property.HALTED, path, text))
        self.going_on.clear()
        if self._is_taken:
            self._check_owners()
        if self._has_requirements:
            self._check_requirements(status)
        if status is not RUNNING:
            for leaf in opened:
                text = f'{leaf.path} still works although the tree has ended with {status.name}: it was not halted'
                self._found(Violation(Property.HALTED, leaf.path, text))
        elif self._is_woken_only and not opened:
            self._check_wakes()
        self.answered.clear()

    def paused(self, is_paused: bool) -> None:
        """Record that the tree is paused or resumed: the time of requirements stops in between."""
        self.requirements.rests(is_paused)

    def halted(self) -> None:
        """Check that no leaf works after the tree was halted."""
        for leaf in self._open:
            text = f'{leaf.path} still works after the tree was halted'
            self._found(Violation(Property.STOP_STOPS, leaf.path, text))
        for node in self._tree.nodes:
            if node.status is not IDLE:
                text = f'{node.path} is {node.status.name} after the tree was halted'
                self._found(Violation(Property.HALTED, node.path, text))
        if self._tree.next_wake is not None:
            text = 'a node still waits for a time after the halt'
            self._found(Violation(Property.STOP_STOPS, self._tree.key.id, text))

    # -- reports of the leaves ---------------------------------------------------------------------------------------

    def starts(self, leaf: LeafNode) -> None:
        """Record that ``on_start`` of a leaf is about to be called."""
        self._starting = leaf
        if self._has_requirements:
            self._event(leaf)

    def began(self, leaf: LeafNode, status: NodeStatus) -> None:
        """Record that ``on_start`` of a leaf has returned a status."""
        self._starting = None
        if status is RUNNING:
            self._open[leaf] = None
            self.going_on.add(leaf)
            if not leaf.acts_later:
                self._own(leaf)
        else:
            self._acting.pop(leaf, None)
            self._tell_result(leaf, status)

    def went_on(self, leaf: LeafNode, status: NodeStatus) -> None:
        """Record a status of ``on_running`` other than RUNNING; :attr:`going_on` has the RUNNING leaves."""
        if leaf is self._starting:
            return  # its on_start calls on_running: it has not begun to work
        self.going_on.add(leaf)
        if status is not SUCCESS and status is not FAILURE:
            return  # a SKIPPED leaf keeps its state
        self._acting.pop(leaf, None)
        if self._open.pop(leaf, _ABSENT) is _ABSENT:
            text = f'{leaf.path} gives {status.name}, and it has ended before, or was halted'
            self._found(Violation(Property.BALANCED, leaf.path, text))
        self._tell_result(leaf, status)

    def halts(self, leaf: LeafNode, halt: Callable[[], None]) -> None:
        """Halt a leaf by calling ``halt``, and record its unfinished work."""
        context = self._tree.context
        before = context.works if leaf in self._acting else ()
        self._open.pop(leaf, None)
        if self._has_requirements:
            self._event(leaf, ' > halted')
        try:
            halt()
        finally:
            if leaf in self._acting:
                del self._acting[leaf]
                self._ending[leaf] = tuple(work for work in context.works if work not in before)

    def acts(self, leaf: LeafNode) -> None:
        """Record that the external work of a leaf begins."""
        if leaf not in self._open and leaf is not self._starting:
            text = f'{leaf.path} acts, and it has ended, or was halted'
            self._found(Violation(Property.STOP_STOPS, leaf.path, text))
        self._own(leaf)

    def done(self, leaf: TreeNode, before: NodeStatus, status: NodeStatus) -> None:
        """Record a tick of a leaf that is no StatefulAction, with its status before it and its result."""
        if isinstance(leaf, CoroutineAction | ThreadedAction) and (before is SUCCESS or before is FAILURE):
            return  # it keeps its result
        if before is not RUNNING:
            self._event(leaf)
        self._tell_result(leaf, status)
        if status is SUCCESS or status is FAILURE:
            self._answers[leaf] = status

    # -- checks after a tick -----------------------------------------------------------------------------------------

    def _own(self, leaf: LeafNode) -> None:
        if self._tree.nodes is not self._nodes:
            self._learn()
        if leaf in self._resources:
            self._acting[leaf] = None
            self._is_taken = True

    def _tell_result(self, leaf: TreeNode, status: NodeStatus) -> None:
        if self._has_requirements and (status is SUCCESS or status is FAILURE):
            self._event(leaf, f' > {status.name}')

    def _event(self, leaf: TreeNode, what: str = '') -> None:
        if self._tree.nodes is not self._nodes:
            self._learn()
        for name in self._names_of(leaf):
            self.requirements.event(name + what)

    def _check_owners(self) -> None:
        works = self._tree.context.works
        self._ending = {leaf: own for leaf, own in self._ending.items() if any(work in works for work in own)}
        owners = sorted({*self._acting, *self._ending}, key=lambda leaf: leaf.uid)
        for wrong in shared_actuators((leaf.path, self._resources[leaf]) for leaf in owners):
            self._found(wrong)
        self._is_taken = False  # until another leaf takes an actuator

    def _check_requirements(self, status: NodeStatus) -> None:
        requirements = self.requirements
        working = [self._names_of(leaf) for leaf in self._open]
        holding, failing = (
            {name for leaf, answer in self._answers.items() if answer is status for name in self._names_of(leaf)}
            for status in (SUCCESS, FAILURE)
        )
        requirements.works(working)
        requirements.unguarded(working, holding, failing)
        requirements.rests(self._tree.context.paused)
        self._answers.clear()
        if status is not RUNNING:
            requirements.event(f'={status.name}')
            requirements.ended()

    def _check_wakes(self) -> None:
        tree = self._tree
        if tree.next_wake is not None or tree.wake_pending or tree.unfinished:
            return
        if any(node.status is RUNNING and isinstance(node, LeafNode) for node in tree.nodes):
            return  # such as a thread, which wakes the tree when it ends
        for node in self.answered:
            is_last = node.status is RUNNING and all(child.status is not RUNNING for child in node.attached)
            if is_last and not node.awaits_request:
                text = f'{node.path} is RUNNING with no child that is, and nothing wakes the tree'
                self._found(Violation(Property.NO_DEADLOCK, node.path, text))


@kept_by_class
def _watched_action(plain: Any) -> type[Any]:
    def on_start(self: Any) -> NodeStatus:
        monitor = self.context.monitor
        monitor.starts(self)
        status: NodeStatus = plain.on_start(self)
        monitor.began(self, status)
        return status

    running = plain.on_running

    def on_running(self: Any) -> NodeStatus:
        status: NodeStatus = running(self)
        if status is RUNNING:
            self.context.monitor.going_on.add(self)
        else:
            self.context.monitor.went_on(self, status)
        return status

    def on_halted(self: Any) -> None:
        self.context.monitor.halts(self, lambda: plain.on_halted(self))

    return _derived(plain, {'on_start': on_start, 'on_running': on_running, 'on_halted': on_halted})


@kept_by_class
def _watched_leaf(plain: Any) -> type[Any]:
    def execute(self: Any) -> NodeStatus:
        before = self.stored_status
        status: NodeStatus = plain.execute(self)
        self.context.monitor.done(self, before, status)
        return status

    return _derived(plain, {'execute': execute})


@kept_by_class
def _watched_control(plain: Any) -> type[Any]:
    def execute(self: Any) -> NodeStatus:
        status: NodeStatus = plain.execute(self)
        if status is RUNNING:
            self.context.monitor.answered[self] = None
        return status

    return _derived(plain, {'execute': execute})


def _derived(plain: Any, members: dict[str, Any]) -> type[Any]:
    names = {'__module__': plain.__module__, '__qualname__': plain.__qualname__, '__doc__': plain.__doc__}
    namespace = {**members, **names, '__slots__': ()}
    return types.new_class(plain.__name__, (plain,), exec_body=lambda made: made.update(namespace))
