# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of the engine: constant results, and changes of the blackboard."""

from __future__ import annotations

from typing import Any, Final

from flexbt_core.behavior_tree.engine import LeafNode, NodeConfig, SyncAction
from flexbt_core.behavior_tree.model import (
    EMPTY,
    FAILURE,
    INT64,
    KEY,
    MISSING,
    STRING,
    SUCCESS,
    BlackboardError,
    ConversionError,
    Example,
    NodeKind,
    NodeStatus,
    OneOf,
    PortType,
    inout_port,
    input_port,
    is_fixed,
)


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
        if kind is STRING:  # what is no text was assigned by a script, whose integers have 64 bits
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
        """What the text is as value of the entry that is to be written, and its type there."""
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


NODES: Final = (AlwaysSuccess, AlwaysFailure, SetBlackboard, UnsetBlackboard)
