# SPDX-License-Identifier: BSD-3-Clause
"""AlwaysSuccess and AlwaysFailure, and the nodes that write blackboard entries or react to their updates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from flexbt_core.behavior_tree.engine.leaf import LeafNode, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import DecoratorNode
from flexbt_core.behavior_tree.model.blackboard import EMPTY, MISSING
from flexbt_core.behavior_tree.model.errors import BlackboardError, ConversionError
from flexbt_core.behavior_tree.model.outcomes import Example, OneOf
from flexbt_core.behavior_tree.model.ports import (
    ANY,
    INT64,
    KEY,
    STRING,
    Port,
    PortType,
    cast,
    inout_port,
    input_port,
    is_fixed,
)
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus


class AlwaysSuccess(LeafNode):
    """Returns SUCCESS at every tick."""

    __slots__ = ()

    kind = NodeKind.ACTION
    outcomes = OneOf((SUCCESS,))
    example = Example('<AlwaysSuccess/>', ticks=(SUCCESS,))

    def execute(self) -> NodeStatus:
        self.status = SUCCESS
        return SUCCESS


class AlwaysFailure(LeafNode):
    """Returns FAILURE at every tick."""

    __slots__ = ()

    kind = NodeKind.ACTION
    outcomes = OneOf((FAILURE,))
    example = Example('<AlwaysFailure/>', ticks=(FAILURE,))

    def execute(self) -> NodeStatus:
        self.status = FAILURE
        return FAILURE


class SetBlackboard(SyncAction):
    """Writes ``value`` to the key named by ``output_key``.

    A literal ``output_key`` is the key itself; a ``{pointer}`` means the entry whose *content* is the key. A literal
    value is written as text, and converted if the entry has another type. A ``{pointer}`` copies that entry: text is
    converted in the same way, any other value needs an entry of the same type. FAILURE if the copied entry was declared
    but never written.

    If the entry exists without a type (a script created it), text empties it, and raises an error the next time.
    """

    __slots__ = ('_class', '_copied', '_entry', '_source', '_text', '_type', '_value')

    ports = {
        'value': input_port(description='text, or {key} of the entry to be copied'),
        'output_key': inout_port(literal=KEY, description='key to be written'),
    }
    example = Example('<SetBlackboard value="dock" output_key="place"/>', ticks=(SUCCESS,), after={'place': 'dock'})

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        value = config.values['value']
        self._source = value.key
        self._text = value.text
        # Caches for a constant key: the entry with the constant text converted to its fixed type; or the copied entry,
        # if it has the same type, with the class of its value.
        self._entry = MISSING
        self._value: Any = None
        self._copied = MISSING
        self._type: PortType | None = None
        self._class: type[Any] | None = None

    def execute(self) -> NodeStatus:
        entry = self._entry
        if entry.present:
            if self._source is None:
                value = self._value
            else:
                value = self._copied.value
                if value.__class__ is not self._class or entry.type is not self._type:
                    return super().execute()
            # As entry.write does.
            entry.value = value
            entry.sequence += 1
            self.status = SUCCESS
            return SUCCESS
        return super().execute()

    def tick(self) -> NodeStatus:
        try:
            key = cast(self.get_input('output_key'), STRING)
        except ConversionError as error:
            raise self._port_error('output_key', str(error)) from error
        with self.blackboard.lock:
            if self._source is None:
                return self._write_text(key)
            return self._copy(key, self._source)

    def _write_text(self, key: str) -> NodeStatus:
        board = self.blackboard
        value, kind = self._converted(key, self._text)
        board.put(key, value, kind)
        if is_fixed(kind) and kind.immutable and self.port_key('output_key') is None:
            self._entry = board.entry(key) or MISSING
            self._value = value
        return SUCCESS

    def _copy(self, key: str, source: str) -> NodeStatus:
        board = self.blackboard
        copied = board.entry(source)
        if copied is None:
            raise self._port_error('value', 'the blackboard has no such entry', is_absent=True)
        if board.entry(key) is None:
            board.declare(key, copied.type)
        value = copied.value
        if value is EMPTY:
            return self.fail(f'the entry [{source}] that is to be copied was never written')
        if isinstance(value, str):
            board.put(key, *self._converted(key, value))
            return SUCCESS
        kind = copied.type
        if kind is STRING:  # a value that is not text was assigned by a script, whose integers have 64 bits
            kind = INT64 if isinstance(value, int) else None
        board.put(key, value, kind)
        entry = board.entry(key)
        assert entry is not None
        # Both types are equal, or the written entry has no fixed type.
        if self.port_key('output_key') is None and (is_fixed(copied.type) or not is_fixed(entry.type)):
            self._entry, self._type = entry, entry.type
            self._copied, self._class = copied, value.__class__
        return SUCCESS

    def _converted(self, key: str, text: str) -> tuple[Any, PortType | None]:
        """Return the text converted for the entry to be written, and the type of the result."""
        entry = self.blackboard.entry(key)
        kind = STRING if entry is None else entry.type
        if kind is None:
            # What converts text is part of the type: nothing comes of it, and that is written.
            return EMPTY, None
        if kind.category == 'text':
            return text, kind
        if kind.from_text is None:
            raise BlackboardError(f'entry [{key}] of type {kind.name} cannot be written as text')
        try:
            return kind.parse(text), kind
        except ConversionError as error:
            raise BlackboardError(f'entry [{key}]: {error}') from error


class UnsetBlackboard(SyncAction):
    """Removes the entry ``key`` from the scope of the node itself. SUCCESS even if it does not exist."""

    __slots__ = ('_key',)

    ports = {'key': input_port(STRING, description='key of the entry to be removed')}
    outcomes = OneOf((SUCCESS,))
    example = Example(
        '<Sequence><UnsetBlackboard key="goal"/><WasEntryUpdated entry="goal"/></Sequence>',
        ticks=(FAILURE,),
        before={'goal': 'dock'},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        given = config.values['key']
        self._key: str | None = None if given.key is not None else given.text

    def execute(self) -> NodeStatus:
        key = self._key
        if key is None:
            return super().execute()
        self.blackboard.unset(key)
        self.status = SUCCESS
        return SUCCESS

    def tick(self) -> NodeStatus:
        self.blackboard.unset(self.get_input('key'))
        return SUCCESS


# SkipUnlessUpdated, WaitValueUpdate and WasEntryUpdated: has an entry of the blackboard been written?
#
# Each node remembers the last number of writes that it saw, for the life of the tree; it starts with none. A write
# counts even if the value does not change. An entry that is removed and created again restarts its count, so the nodes
# miss the update if both counts are equal, as in BehaviorTree.CPP.

_PORTS: Final[Mapping[str, Port]] = {'entry': input_port(ANY, literal=KEY, description='the entry: {key}, or just key')}


def _key(config: NodeConfig) -> str:
    given = config.values['entry']
    return given.text if given.key is None else given.key


def _updated(node: UpdateDecorator | WasEntryUpdated) -> bool:
    """Return True if the entry was written since the node last checked. False for a missing entry."""
    entry = node._entry
    if not entry.present:
        node._entry = entry = node.blackboard.entry(node._key) or MISSING
    writes = entry.sequence
    if writes == node._seen or entry is MISSING:
        return False
    node._seen = writes
    return True


class UpdateDecorator(DecoratorNode):
    """A decorator that ticks the child after a write of the entry, until the child is no longer RUNNING."""

    __slots__ = ('_child_running', '_entry', '_key', '_seen')

    running_at_completion = None
    ports = _PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._key = _key(config)
        self._entry = MISSING
        # Last number of writes that the node saw.
        self._seen = 0
        self._child_running = False

    def _run(self) -> NodeStatus:
        status = self._tick()
        self._child_running = status is RUNNING
        if status is not SKIPPED:
            self.status = status
            if status is not RUNNING:
                self.child.status = IDLE
        return status

    def halt(self) -> None:
        self._child_running = False
        super().halt()


class SkipUnlessUpdated(UpdateDecorator):
    """Runs the child when ``entry`` was written since the last time; SKIPPED otherwise. A halt does not reset this."""

    __slots__ = ()

    example = Example(
        """
        <Repeat num_cycles="2">
          <Fallback>
            <SkipUnlessUpdated entry="{goal}"><Script code="n += 1"/></SkipUnlessUpdated>
            <AlwaysSuccess/>
          </Fallback>
        </Repeat>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'n': 0, 'goal': 'dock'},
        after={'n': 1},
    )

    def execute(self) -> NodeStatus:
        # Most ticks find no write; a call would cost more than this check.
        if not self._child_running and (self._entry.sequence == self._seen or not _updated(self)):
            return SKIPPED
        return self._run()


class WaitValueUpdate(UpdateDecorator):
    """Waits, RUNNING, until ``entry`` is written, and then runs the child. A halt does not reset this.

    A write does not wake the tree: the writer, a leaf of the tree or its host, has to request a tick.
    """

    __slots__ = ()

    example = Example('<WaitValueUpdate entry="{goal}"><AlwaysSuccess/></WaitValueUpdate>', ticks=(RUNNING, RUNNING))

    def execute(self) -> NodeStatus:
        if not self._child_running and (self._entry.sequence == self._seen or not _updated(self)):
            self.status = RUNNING
            return RUNNING
        return self._run()


class WasEntryUpdated(LeafNode):
    """SUCCESS when ``entry`` was written since the last tick of this node; FAILURE when not, or when it is missing."""

    __slots__ = ('_entry', '_key', '_seen')

    kind = NodeKind.ACTION
    ports = _PORTS
    example = Example('<WasEntryUpdated entry="{goal}"/>', ticks=(SUCCESS, FAILURE), before={'goal': 'dock'})

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._key = _key(config)
        self._entry = MISSING
        # Last number of writes that the node saw.
        self._seen = 0

    def execute(self) -> NodeStatus:
        status = SUCCESS if _updated(self) else FAILURE
        self.status = status
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: entry [{self._key}] was not written since the last tick'


NODES: Final = (
    AlwaysSuccess,
    AlwaysFailure,
    SetBlackboard,
    UnsetBlackboard,
    SkipUnlessUpdated,
    WaitValueUpdate,
    WasEntryUpdated,
)
