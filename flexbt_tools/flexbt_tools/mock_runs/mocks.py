# SPDX-License-Identifier: BSD-3-Clause
"""Mocks: leaves that follow a script, in place of those that need a robot."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Final

from flexbt_core.behavior_tree.engine.leaf import LeafNode, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDefinition, TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ConversionError, LoadError
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortType, is_fixed
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus
from flexbt_core.values.text import did_you_mean
from flexbt_tools.trees.stand_ins import UNKNOWN_PORT, is_stand_in

from .mock_plan import PASS, REAL, MockPlan, MockRule, MockStep

_ENGINE: Final = 'flexbt_core.behavior_tree.'
_FOR_ROS: Final = ('flexbt_server.leaves.', 'flexbt_server.nav2.')
_LEAVES: Final = (NodeKind.ACTION, NodeKind.CONDITION)


class Mock(LeafNode):
    """A leaf that follows the steps of its class, one for each activation, and repeats the last one."""

    __slots__ = ('_activations', '_end')

    steps: ClassVar[tuple[MockStep, ...]]
    synchronous: ClassVar[bool]
    """True if every tick of a completed node is a new activation; otherwise it keeps its result."""
    needed: ClassVar[tuple[str, ...]]
    """Inputs that the mock reads when an activation begins, like the real node."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._activations = 0
        self._end = 0.0

    def execute(self) -> NodeStatus:
        before = self.status
        if not self.synchronous and (before is SUCCESS or before is FAILURE):
            return before
        try:
            status = self._go_on() if before is RUNNING else self._begin()
        except BehaviorTreeError as error:
            raise self.fault(error) from error
        if status is not SKIPPED:
            self.status = status
        return status

    def halt(self) -> None:
        self.cancel_wake()
        self.status = NodeStatus.IDLE

    def _begin(self) -> NodeStatus:
        self._reason = ''
        self._activations += 1
        for name in self.needed:
            self.get_input(name)
        step = self._step()
        if step.after > 0.0:
            self._end = self.clock.now() + step.after
            self.wake_at(self._end)
            return RUNNING
        return self._finish(step)

    def _go_on(self) -> NodeStatus:
        step = self._step()
        return RUNNING if step.gives is RUNNING or self.clock.now() < self._end else self._finish(step)

    def _step(self) -> MockStep:
        return self.steps[min(self._activations, len(self.steps)) - 1]

    def _finish(self, step: MockStep) -> NodeStatus:
        self.cancel_wake()
        for name, value in step.outputs.items():
            self.set_output(name, written(value, self.ports[name].type))
        return self.fail(step.reason) if step.gives is FAILURE else step.gives


def written(value: Any, kind: PortType | None) -> Any:
    """Return the value converted for an entry of this type. Write a message as a mapping, several as a list of
    mappings.

    Raises ConversionError.
    """
    of_messages = isinstance(value, dict) or (isinstance(value, list) and any(isinstance(one, dict) for one in value))
    if not of_messages or not is_fixed(kind) or kind.from_text is None:
        return value
    try:
        text = json.dumps(value)
    except (TypeError, ValueError) as error:
        raise ConversionError(f'{kind.name}: {error}') from error
    return kind.parse(f'json:{text}')


class _Pass(Decorator):
    """A decorator that only ticks its child."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        return self.tick_child()


class Mocking:
    """A builder that puts mocks into a tree. Afterwards :meth:`wrong` returns the problems of the plan for that tree.

    A rule matches leaves and sub-trees by path, name or type. It matches other nodes by type, unless they belong to the
    engine. Leaves of the engine need a rule that spells out their name.
    """

    def __init__(self, library: TreeLibrary, plan: MockPlan, *, read_inputs: bool = False) -> None:
        """Make mocks of a plan. With ``read_inputs`` mocks read the inputs that real nodes require."""
        self._plan = plan
        self._read_inputs = read_inputs
        self._owners: dict[int, TreeDefinition] = {
            id(node): tree
            for document in library.documents.values()
            for tree in document.trees.values()
            for node in tree.nodes()
        }
        self._names: set[str] = set()
        self._errors: dict[LoadError, None] = {}
        # Types without the mock that they need, with the first place of each.
        self._missing: dict[str, LoadError] = {}

    def substitute(self, node: NodeDefinition, path: str) -> NodeDefinition:
        """Return the replacement of a node, see Tree."""
        rule = self._rule(node, path)
        if rule is None:
            if needs_mock(node):
                result = PASS if len(node.children) == 1 else 'SUCCESS'
                message = f"it needs a robot; give it a mock, such as --mock '{node.manifest.id}={result}'"
                self._missing.setdefault(node.manifest.id, self._owners[id(node)].error(node, message))
            return node
        if isinstance(rule.does, tuple):
            return self._mock(node, rule, rule.does)
        if rule.does == PASS:
            return self._passing(node, rule)
        if is_stand_in(node.manifest):
            self._refuse(rule, node, f'it is not installed here, so it cannot be {REAL}')
        return node

    def wrong(self) -> list[LoadError]:
        """Return the problems: rules that do not fit their node or have no node, and nodes that lack a mock."""
        return list(self._errors) or list(self._meaningless_rules()) or list(self._missing.values())

    def _meaningless_rules(self) -> Iterator[LoadError]:
        for rule in self._plan.rules:
            if not rule.is_wildcard and rule.pattern not in self._names:
                remedy = did_you_mean(
                    rule.pattern, sorted(self._names), '; give the type, the name or the path of a leaf'
                )
                yield replace(rule.place, message=f'the mock {rule.pattern!r} means no node of this tree{remedy}')

    def _rule(self, node: NodeDefinition, path: str) -> MockRule | None:
        type = node.tree_id or node.manifest.id
        if not node.children:
            names: tuple[str, ...] = (path, node.name, type)
        elif _is_of_engine(node):
            return None
        else:
            # The name may belong to a leaf below it.
            names = (type,)
        self._names.update(names)
        for name in names:
            for rule in self._plan.rules:
                if not rule.is_wildcard and rule.matches(name):
                    return rule
        if not node.children and needs_mock(node):
            for rule in self._plan.rules:
                if rule.is_wildcard and any(map(rule.matches, names)):
                    return rule
        return None

    def _refuse(self, rule: MockRule, node: NodeDefinition, problem: str) -> None:
        self._errors[replace(rule.place, message=f'the mock {rule.pattern!r} of {node.label}: {problem}')] = None

    def _passing(self, node: NodeDefinition, rule: MockRule) -> NodeDefinition:
        if len(node.children) != 1:
            self._refuse(rule, node, f'only a node with one child can {PASS}')
            return node
        return node._replace(manifest=replace(node.manifest, node_class=_Pass))

    def _mock(self, node: NodeDefinition, rule: MockRule, steps: tuple[MockStep, ...]) -> NodeDefinition:
        manifest = node.manifest
        ports = manifest.ports if node.tree_id is None else dict.fromkeys(node.values, UNKNOWN_PORT)
        kind = NodeKind.CONDITION if manifest.kind is NodeKind.CONDITION else NodeKind.ACTION
        synchronous = is_instant(node)
        for step in steps:
            for name, value in step.outputs.items():
                problem = _output_problem(name, value, ports)
                if problem:
                    self._refuse(rule, node, problem)
            if synchronous and (step.after > 0.0 or step.gives is RUNNING):
                self._refuse(
                    rule, node, 'it answers within one tick: give it a mock that is never RUNNING, and takes no time'
                )
        needed = (
            name
            for name, port in ports.items()
            if self._read_inputs and port.readable and (port.required or port.default is not NO_DEFAULT)
        )
        namespace = {
            '__slots__': (),
            'needed': tuple(needed),
            'kind': kind,
            'ports': ports,
            'steps': steps,
            'synchronous': synchronous,
        }
        mock = replace(
            manifest,
            id=node.tree_id or manifest.id,
            kind=kind,
            ports=ports,
            children=(0, 0),
            node_class=type('Mock', (Mock,), namespace),
        )
        return node._replace(manifest=mock, tree_id=None, children=())


def _is_of_engine(node: NodeDefinition) -> bool:
    return node.manifest.node_class.__module__.startswith(_ENGINE)


def is_instant(node: NodeDefinition) -> bool:
    """Return whether the node answers within one tick."""
    return node.manifest.kind is NodeKind.CONDITION or issubclass(node.manifest.node_class, SyncAction)


def needs_mock(node: NodeDefinition) -> bool:
    """Return whether the node cannot work here as on a robot, as far as this is known.

    That applies to leaves of packages, and to nodes that use ROS.
    """
    if is_stand_in(node.manifest) or node.manifest.node_class.__module__.startswith(_FOR_ROS):
        return True
    return node.manifest.kind in _LEAVES and not _is_of_engine(node)


def _output_problem(name: str, value: Any, ports: Mapping[str, Port]) -> str:
    port = ports.get(name)
    if port is None or not port.writable:
        outputs = ', '.join(name for name, port in ports.items() if port.writable) or 'none'
        return f'there is no output {name!r}; its outputs are: {outputs}'
    try:
        written(value, port.type)
    except ConversionError as error:
        return f'output {name!r}: {error}'
    return ''
