# SPDX-License-Identifier: BSD-3-Clause
"""The behavior tree of a model: FlexBT's engine and nodes, with automata as plugins, which answer later.

A tick runs until it ticks or halts a plugin whose answer is not known yet. When the answer arrives, the tick runs
again from its beginning, with all answers so far. Results are cached, so a tree becomes a table that maps a situation
and an answer to the next situation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import (
    BehaviorTreeError,
    LoadError,
    NodeExecutionError,
    RegistrationError,
    Source,
)
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, INT64, STRING, PortType, inout_port, input_port
from flexbt_core.behavior_tree.model.status import IDLE, RUNNING, NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_formal.exploration.configuration import Configuration, StateSnapshotter
from flexbt_formal.exploration.tree_system import TREE_LAYOUT, remove_entries, removed_by
from flexbt_formal.exploration.virtual_time import VirtualClock

from .ascxml import Instance, is_pointer
from .data_types import DataType, DataTypeError
from .dialect import SET, Events, bt_event
from .source_text import ModelError, ModelFault

_STATUS: Final = {NodeStatus.SUCCESS: 1, NodeStatus.FAILURE: 2, NodeStatus.RUNNING: 3}
_FROM_STATUS: Final = {number: status for status, number in _STATUS.items()}

_OLD: Final = re.compile(
    r'\b(success_threshold|failure_threshold|BlackboardCheck\w+|RetryUntilSuccesful|SequenceStar)\b'
)
_FORMAT: Final = re.compile(r'(BTCPP_format\s*=\s*["\'])4(["\'])')
_MISMATCH: Final = re.compile(r'(return_on_mismatch\s*=\s*["\'])([123])(["\'])')

_SET_BLACKBOARD: Final = re.compile(r'<[^<>]*\bSetBlackboard\b[^<>]*>')
_KEY: Final = re.compile(r'(output_key\s*=\s*["\'])\s*\{([^{}]*)\}\s*(["\'])')

_PORT_TYPES: Final[Mapping[type[Any], PortType]] = {bool: BOOL, float: DOUBLE, int: INT64, str: STRING}

Ports = Mapping[str, tuple[bool, DataType]]
"""Ports by name: whether the port is an output, and its type."""


class PluginAnswer(NamedTuple):
    """An answer of a plugin; ``kind`` is response or halt_response, tick or halt of its child, or write, to a
    ``port``."""

    kind: str
    uid: int
    value: Any = None
    port: str = ''


class _Suspended(BaseException):
    """A plugin's answer is not known yet."""


class Conversation:
    """The requests to the plugins in a tick, with their answers. It serves as the services of the tree's nodes.

    ``removed`` are the keys that nodes may remove; None: any.
    """

    def __init__(self) -> None:
        self.nodes: dict[int, TreeNode] = {}
        self.removed: frozenset[str] | None = frozenset()
        self.answers: Iterator[PluginAnswer] = iter(())
        self.pending: tuple[int, str, tuple[Any, ...]] | None = None
        self.seen: list[tuple[int, tuple[Any, ...]]] = []

    def tell(self, node: TreeNode, uid: int, what: str, values: tuple[Any, ...] = ()) -> PluginAnswer:
        """Send the event ``what`` of the node ``uid``, and return the answer of ``node``. Raises _Suspended."""
        if self.pending is None:
            for answer in self.answers:
                if answer.kind != 'write':
                    return answer
                self.apply(answer)
            self.pending = (node.uid, bt_event(uid, what), values)
        raise _Suspended

    def apply(self, answer: PluginAnswer) -> None:
        """Write an output of a plugin."""
        self.nodes[answer.uid].set_output(answer.port, answer.value)


class _Plugin(TreeNode):
    """A node that is an automaton. It gets a halt whenever its parent resets it, even if it is not RUNNING.

    AS2FM's controls do this. BehaviorTree.CPP sends no halt to a node that is not RUNNING.
    """

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._is_told = False

    def execute(self) -> NodeStatus:
        self._is_told = False
        status = self.tell('tick')
        self.status = status
        return status

    def halt(self) -> None:
        if self.status is RUNNING:
            self.tell('halt')
            super().store_status(IDLE)
            # The parent has reset the node to IDLE.
            self._is_told = True

    def store_status(self, status: NodeStatus) -> None:
        if status is IDLE and self.uid != 1 and not self._is_told:
            self.tell('halt')
        self._is_told = False
        super().store_status(status)

    def tell(self, what: str) -> NodeStatus:
        conversation: Conversation = self.services
        answer = conversation.tell(self, self.uid, what)
        while answer.kind in ('tick', 'halt'):
            answer = conversation.tell(self, *self.serve(answer))
        return _FROM_STATUS.get(answer.value, NodeStatus.FAILURE)

    def serve(self, answer: PluginAnswer) -> tuple[int, str, tuple[Any, ...]]:
        """Tick or halt a child as the plugin requests, and return the event with the result."""
        assert isinstance(self, ControlNode)
        (child,) = (one for one in self.children if one.uid == answer.uid)
        if answer.kind == 'tick':
            status = self._ticks[self.children.index(child)]()
            return answer.uid, 'response_told', (_STATUS.get(status, 2),)
        halt_child(child)
        return answer.uid, 'halt_response_told', ()


class PluginLeaf(_Plugin, LeafNode):
    """A leaf that is an automaton."""

    goes_on = ''


class PluginControl(_Plugin, ControlNode):
    """A node that is an automaton, which ticks and halts its children itself."""

    running_at_completion = None
    runs_several = True


@dataclass(frozen=True)
class Situation:
    """The position of a tree. ``pending``: the event that is being sent, and its plugin; None between ticks.

    ``accepts``: the events that lead on from here. ``inputs``: the values of the plugins' ports that point to the
    blackboard. ``status``: the result of the last tick (0 before the first).
    """

    base: Configuration
    time: float
    answers: tuple[PluginAnswer, ...]
    pending: tuple[int, int, tuple[Any, ...]] | None
    accepts: Mapping[int, PluginAnswer]
    inputs: Mapping[int, Mapping[str, Any]]
    status: int
    seen: int = 0
    at_blackboard: Mapping[str, int] = field(default_factory=dict)


Seen = tuple[tuple[int, tuple[Any, ...]], ...]
"""Events that need no receiver, in the order of their occurrence: results of nodes, and values on the blackboard."""


class TreePlayer:
    """The tree of a model as a table of numbered situations. Situation 0 is before the first tick."""

    def __init__(self, path: str, text: str, plugins: Mapping[str, Ports]) -> None:
        """Raise TreeLoadError."""
        self._types = plugins
        self._clock = _Clock()
        self._conversation = Conversation()
        library = _library(path, text, plugins)
        document = library.documents[path]
        if document.main is None:
            message = 'there are several trees, and none is the main one; add main_tree_to_execute'
            raise ModelError([LoadError(path, 1, 1, '<root>', message)])
        self.name = re.sub(r'.*/|\.xml$', '', path)
        self._tree = Tree(
            library,
            document.main,
            file=path,
            blackboard=Blackboard(),
            clock=self._clock,
            services=self._conversation,
        )
        # An observed tree stores statuses through calls, so plugins notice a reset.
        self._tree.observe(lambda node, before, after: None)
        self.nodes = self._tree.nodes
        self._conversation.nodes = {node.uid: node for node in self.nodes}
        self._conversation.removed = removed_by(self.nodes)
        self._plugins = [node for node in self.nodes if isinstance(node, _Plugin)]
        self.instances = [
            Instance(
                node.uid,
                node.name,
                {port: given for port in node.ports if (given := node.port_text(port)) is not None},
                tuple(child.uid for child in node.attached),
            )
            for node in self._plugins
        ]
        self._inputs = [
            (node, port, plugins[node.id][port][1])
            for node in self._plugins
            for port in node.ports
            if is_pointer(node.port_text(port) or '')
        ]
        self._events: Events
        self._situations: list[Situation] = []
        self._numbers: dict[Any, int] = {}
        self._steps: dict[Any, tuple[int, Seen]] = {}
        self._watched: dict[str, int] = {}
        self._memory: StateSnapshotter
        self._entries: list[tuple[TreeNode, str, DataType, Entry]] = []

    @property
    def keys(self) -> list[str]:
        """Blackboard entries that nodes use."""
        found = [node.port_key(port) for node in self.nodes for port in node.ports]
        found += [node.port_text('output_key') for node in self.nodes if node.id == 'SetBlackboard']
        return sorted({key for key in found if key})

    def plugin(self, uid: int) -> str:
        """Return the type of a node."""
        return self._conversation.nodes[uid].id

    def path(self, uid: int) -> str:
        """Return the path of a node, for messages."""
        return self._conversation.nodes[uid].path

    def begin(self, events: Events, watched: Sequence[int]) -> int:
        """Prepare the first tick; ``watched`` are the events that properties use. Call it once."""
        self._events = events
        for node in self.nodes:
            event = events.number(bt_event(node.uid, 'response'))
            if event in watched and node not in self._plugins:
                self._watch(node, event)
        names = {number: events.names[number] for number in watched}
        self._watched = {name.removeprefix(SET): number for number, name in names.items() if name.startswith(SET)}
        # Not earlier: the saved configuration of a tree contains the callables that tick it.
        self._tree.fetch_ticks()
        board = self._tree.blackboard
        for node in self._plugins:
            for port, (_, kind) in self._types[node.id].items():
                key = node.port_key(port)
                if key is not None:
                    self._give(node.blackboard, key, kind)
        whole = DataType('int32', int)
        for key in sorted({*_script_keys(self._tree), *_set_keys(self._tree), *self._watched}):
            self._give(board, key, whole)
        self._entries = [
            (node, port, kind, entry)
            for node, port, kind in self._inputs
            if (entry := node.blackboard.entry(node.port_key(port) or '')) is not None
        ]
        self._memory = StateSnapshotter(
            (
                self._tree,
                *self.nodes,
                *(subtree.blackboard for subtree in self._tree.subtrees),
                *(entry for subtree in self._tree.subtrees for entry in subtree.blackboard.entries().values()),
                self._tree.context,
                self._clock,
            ),
            VirtualClock(),  # of what is kept: times are kept as they are
            TREE_LAYOUT,
            (type(self),),
        )
        return self._at_rest(0.0, 0)

    @staticmethod
    def _give(board: Blackboard, key: str, kind: DataType) -> None:
        """Add an entry of a type, with the zero of that type as its first value."""
        entry = board.entry(key)
        if entry is None:
            entry = board.declare(key, _PORT_TYPES.get(kind.plain) if kind.plain is not None else None)
        if entry.value is EMPTY:
            entry.write(kind.zero)

    def _watch(self, node: TreeNode, number: int) -> None:
        def note(node: TreeNode, status: NodeStatus) -> NodeStatus:
            if status in _STATUS:
                self._conversation.seen.append((number, (_STATUS[status],)))
            return status

        self._tree.callbacks.set_post_tick(node, note)

    @property
    def asks_time(self) -> bool:
        """True if a node has ever read the time."""
        return self._clock.was_asked

    def __getitem__(self, number: int) -> Situation:
        return self._situations[number]

    # -- steps -------------------------------------------------------------------------------------------------------

    def tick(self, number: int, time: float) -> tuple[int, Seen]:
        """Begin a tick at a time in seconds, between ticks. Raises ModelFault."""
        situation = self._situations[number]
        step = (number, time if self._clock.was_asked else None)
        if step not in self._steps:
            result = self._play(situation.base, time, (), situation.at_blackboard, 0)
            step = (number, time if self._clock.was_asked else None)
            self._steps[step] = result
        return self._steps[step]

    def answer(self, number: int, answer: PluginAnswer) -> tuple[int, Seen]:
        """Continue a tick with an answer. Raises ModelFault."""
        step = (number, answer)
        if step not in self._steps:
            now = self._situations[number]
            self._steps[step] = self._play(now.base, now.time, (*now.answers, answer), now.at_blackboard, now.seen)
        return self._steps[step]

    def write(self, number: int, uid: int, port: str, value: Any) -> tuple[int, Seen]:
        """Set an output of a plugin. Raises ModelFault."""
        answer = PluginAnswer('write', uid, value, port)
        now = self._situations[number]
        seen: Seen = ()
        watched = self._watched.get(self._conversation.nodes[uid].port_key(port) or '')
        if watched is not None:
            seen = ((watched, (value,)),)
        if now.pending is not None:
            after, other = self.answer(number, answer)
            return after, seen + tuple(one for one in other if one[0] != watched)
        step = (number, answer)
        if step not in self._steps:
            self._restore(now.base, now.time)
            try:
                self._conversation.apply(answer)
            except BehaviorTreeError as error:
                raise ModelFault(str(error)) from error
            self._steps[step] = self._at_rest(now.time, now.status), ()
        return self._steps[step][0], seen

    def _restore(self, base: Configuration, time: float) -> None:
        remove_entries(self._tree)
        self._memory.restore(base)
        self._clock.time = time  # type: ignore[assignment]
        self._conversation.pending = None
        self._conversation.seen = []

    def _play(
        self, base: Configuration, time: float, answers: tuple[PluginAnswer, ...], before: Mapping[str, int], known: int
    ) -> tuple[int, Seen]:
        self._restore(base, time)
        conversation = self._conversation
        conversation.answers = iter(answers)
        tree = self._tree
        status = 0
        try:
            tree.take_wake()
            status = _STATUS.get(tree.tick_once(), 2)
        except _Suspended:
            pass
        except (NodeExecutionError, BehaviorTreeError) as error:
            if conversation.pending is None:
                raise ModelFault(f'the tree: {error}') from error
        pending = conversation.pending
        seen = conversation.seen[known:]
        changed = self._at_blackboard()
        seen += [(self._watched[key], (self._value_of(key),)) for key in changed if changed[key] != before.get(key)]
        if pending is None:
            for answer in conversation.answers:  # writes after the last pending request
                self._conversation.apply(answer)
            return self._at_rest(time, status), tuple(seen)
        uid, event, values = pending
        node = self._conversation.nodes[uid]
        accepts = {
            self._events.number(bt_event(uid, kind)): PluginAnswer(kind, uid) for kind in ('response', 'halt_response')
        }
        for child in node.attached:
            for kind in ('tick', 'halt'):
                accepts[self._events.number(bt_event(child.uid, f'{kind}_asked'))] = PluginAnswer(kind, child.uid)
        situation = Situation(
            base,
            time,
            answers,
            (self._events.number(event), uid, values),
            accepts,
            self._read(),
            0,
            len(conversation.seen),
            changed,
        )
        return self._add((base.key, answers, time if self._clock.was_asked else None), situation), tuple(seen)

    def _at_rest(self, time: float, status: int) -> int:
        base = self._memory.capture()
        situation = Situation(base, time, (), None, {}, self._read(), status, 0, self._at_blackboard())
        return self._add((base.key, status), situation)

    def _add(self, key: Any, situation: Situation) -> int:
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self._situations)
            self._situations.append(situation)
        return number

    def _read(self) -> Mapping[int, Mapping[str, Any]]:
        found: dict[int, dict[str, Any]] = {}
        for node, port, kind, entry in self._entries:
            value = entry.value
            if isinstance(value, str) and kind.plain is not str:
                try:
                    value = kind.from_text(value)
                except DataTypeError as error:
                    raise ModelFault(f'{node.path}: the input {port}: {error}') from error
            found.setdefault(node.uid, {})[port] = value
        return found

    def _at_blackboard(self) -> dict[str, int]:
        """Return the write counts of the entries that properties use."""
        board = self._tree.blackboard
        return {key: entry.sequence for key in self._watched if (entry := board.entry(key)) is not None}

    def _value_of(self, key: str) -> Any:
        value = self._tree.blackboard.get(key)
        if isinstance(value, str):
            for node, port, kind in self._inputs:
                if node.port_key(port) == key and kind.plain is str:
                    return value
            for plain in (int, float):
                try:
                    return plain(value)
                except ValueError:
                    pass
        return value


class _Clock(VirtualClock):
    """Simulated time, which records whether a node has ever read it."""

    def __init__(self) -> None:
        super().__init__()
        self.was_asked = False

    def now(self) -> float:
        self.was_asked = True
        return super().now()


def _script_keys(tree: Tree) -> Iterator[str]:
    """Yield the entries that condition scripts read: in AS2FM they are 0 until they are set."""
    for definition in tree.definitions:
        if definition.manifest.id == 'Precondition':
            value = definition.values.get('if')
            if value is not None:
                yield from re.findall(r"(?<![\w'])[A-Za-z_]\w*(?![\w'])", value.text)


def _set_keys(tree: Tree) -> Iterator[str]:
    """Yield the entries that the tree itself sets to integers."""
    for definition in tree.definitions:
        if definition.manifest.id == 'SetBlackboard':
            value, key = definition.values.get('value'), definition.values.get('output_key')
            if value is not None and key is not None and re.fullmatch(r'-?\d+', value.text.strip()):
                yield key.text


def _all(element: Element) -> Iterator[Element]:
    yield element
    for child in element.children:
        yield from _all(child)


def _library(path: str, text: str, plugins: Mapping[str, Ports]) -> TreeLibrary:
    """Return the library of the file, with the plugins as node types. AS2FM accepts elements of version 3 whatever
    format the file declares."""
    if _OLD.search(text):
        text = _FORMAT.sub(r'\g<1>3\g<2>', text)
    text = _MISMATCH.sub(lambda match: match[1] + _FROM_STATUS[int(match[2])].name + match[3], text)
    # In AS2FM the port is a pointer to the entry; in BehaviorTree.CPP it contains the entry's name.
    text = _SET_BLACKBOARD.sub(lambda match: _KEY.sub(r'\1\2\3', match[0]), text)
    registry: NodeRegistry = builtin_registry()
    elements = list(_all(parse(Source(path, text))))
    for id, ports in plugins.items():
        if id in registry:
            continue  # the check is about FlexBT's own node
        uses = [element for element in elements if id in (element.tag, element.attributes.get('ID'))]
        is_control = any(element.children for element in uses)
        is_condition = any(element.tag == 'Condition' for element in uses)
        base = PluginControl if is_control else PluginLeaf
        kind = NodeKind.CONTROL if is_control else NodeKind.CONDITION if is_condition else NodeKind.ACTION
        declared = {
            name: inout_port(optional=True) if is_output else input_port(optional=True)
            for name, (is_output, _) in ports.items()
        }
        namespace = {'__slots__': (), '__module__': __name__, 'kind': kind, 'ports': declared}
        try:
            registry.register(id, type(base.__name__, (base,), namespace))
        except RegistrationError as error:
            raise ModelError([LoadError(path, 1, 1, f'<{id}>', f'its plugin cannot be used: {error}')]) from error
    return TreeLibrary().stage([load_xml(text, path, registry)])
