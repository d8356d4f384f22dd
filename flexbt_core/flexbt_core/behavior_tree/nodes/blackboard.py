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
    inout_port,
    input_port,
    is_fixed,
)
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus


class AlwaysSuccess(LeafNode):
    """SUCCESS."""

    __slots__ = ()

    kind = NodeKind.ACTION
    outcomes = OneOf((SUCCESS,))
    example = Example('<AlwaysSuccess/>', ticks=(SUCCESS,))

    def execute(self) -> NodeStatus:
        self.status = SUCCESS
        return SUCCESS


class AlwaysFailure(LeafNode):
    """FAILURE."""

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
    value is written as text, converted when the entry has another type; a ``{pointer}`` copies that entry, text in the
    same way, anything else only to an entry of the same type: FAILURE when it was declared but never written.

    Text empties an entry that is there without a type, such as one that a script has made, and is an error the next
    time.
    """

    __slots__ = ('_class', '_copied', '_entry', '_source', '_text', '_type', '_value')

    ports = {
        'value': input_port(description='text, or {key} of the entry to be copied'),
        'output_key': inout_port(STRING, literal=KEY, description='key to be written'),
    }
    example = Example('<SetBlackboard value="dock" output_key="place"/>', ticks=(SUCCESS,), after={'place': 'dock'})

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        value = config.values.get('value')
        self._source = None if value is None else value.key
        self._text = '' if value is None else value.text
        # For a constant key, once it is known what is written there: the entry, and what constant text means in its
        # type, when that is fixed; or the entry that is copied, when it has the same type, and the class of its value.
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
        key: str = self.get_input('output_key')
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
        # The types of both are the same, or that of the one that is written is not fixed.
        if self.port_key('output_key') is None and (is_fixed(copied.type) or not is_fixed(entry.type)):
            self._entry, self._type = entry, entry.type
            self._copied, self._class = copied, value.__class__
        return SUCCESS

    def _converted(self, key: str, text: str) -> tuple[Any, PortType | None]:
        """Return what the text is as value of the entry that is to be written, and its type there."""
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
    """Removes the entry ``key`` from the scope of the node itself. SUCCESS also when there was none."""

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
# Each node remembers the number of writes that it saw last, at first none, and for as long as the tree lives. What is
# asked is whether there was a write, not whether the value is another one. An entry that was removed and made anew
# counts its writes from the beginning; as many as before go unnoticed, as in BehaviorTree.CPP.

_PORTS: Final[Mapping[str, Port]] = {'entry': input_port(ANY, literal=KEY, description='the entry: {key}, or just key')}


def _key(config: NodeConfig) -> str:
    given = config.values['entry']
    return given.text if given.key is None else given.key


def _updated(node: UpdateDecorator | WasEntryUpdated) -> bool:
    """Return whether the entry was written since the node has last seen so. One that is missing was not."""
    entry = node._entry
    if not entry.present:
        node._entry = entry = node.blackboard.entry(node._key) or MISSING
    writes = entry.sequence
    if writes == node._seen or entry is MISSING:
        return False
    node._seen = writes
    return True


class UpdateDecorator(DecoratorNode):
    """Ticks the child when the entry was written since the last time, and then until the child is no longer RUNNING."""

    __slots__ = ('_child_running', '_entry', '_key', '_seen')

    running_at_completion = None
    ports = _PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._key = _key(config)
        self._entry = MISSING
        # The number of writes that was seen last.
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
    """Runs the child when ``entry`` was written since the last time; SKIPPED otherwise. A halt does not undo that."""

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
        # Nothing new is what most ticks find; a call would take longer than that.
        if not self._child_running and (self._entry.sequence == self._seen or not _updated(self)):
            return SKIPPED
        return self._run()


class WaitValueUpdate(UpdateDecorator):
    """Waits, RUNNING, until ``entry`` is written, and then runs the child. A halt does not undo what was seen.

    The write itself asks for no wake-up: what makes it, a leaf of the tree or its host, has to tick the tree.
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
        # The number of writes that was seen last.
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
