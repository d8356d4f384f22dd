# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of the engine: constant results, and changes of the blackboard."""

from __future__ import annotations

from typing import Any

from .blackboard import EMPTY, MISSING
from .errors import BlackboardError, ConversionError
from .leaves import LeafNode, SyncAction
from .node import NodeConfig
from .port_types import KEY, STRING, PortType, is_fixed
from .ports import inout_port, input_port
from .status import FAILURE, SUCCESS, NodeKind, NodeStatus


class AlwaysSuccess(LeafNode):
    """SUCCESS."""

    __slots__ = ()

    kind = NodeKind.ACTION

    def execute(self) -> NodeStatus:
        self.status = SUCCESS
        return SUCCESS


class AlwaysFailure(LeafNode):
    """FAILURE."""

    __slots__ = ()

    kind = NodeKind.ACTION

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

    __slots__ = ('_entry', '_source', '_text', '_value')

    ports = {
        'value': input_port(description='text, or {key} of the entry to be copied'),
        'output_key': inout_port(STRING, literal=KEY, description='key to be written'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        value = config.values.get('value')
        self._source = None if value is None else value.key
        self._text = '' if value is None else value.text
        # For constant text and key: the entry, and what the text means in its type, when that is fixed.
        self._entry = MISSING
        self._value: Any = None

    def execute(self) -> NodeStatus:
        entry = self._entry
        if entry.present:
            # As entry.write does.
            entry.value = self._value
            entry.sequence += 1
            self.status = SUCCESS
            return SUCCESS
        return super().execute()

    def tick(self) -> NodeStatus:
        key: str = self.get_input('output_key')
        board = self.blackboard
        source = self._source
        with board.lock:
            if source is None:
                value, kind = self._converted(key, self._text)
            else:
                copied = board.entry(source)
                if copied is None:
                    raise self._port_error('value', 'the blackboard has no such entry')
                if board.entry(key) is None:
                    board.declare(key, copied.type)
                value, kind = copied.value, copied.type
                if value is EMPTY:
                    return self.fail(f'the entry [{source}] that is to be copied was never written')
                if isinstance(value, str):
                    value, kind = self._converted(key, value)
            board.put(key, value, kind)
            if source is None and self.port_key('output_key') is None:
                entry = board.entry(key)
                assert entry is not None
                if is_fixed(entry.type) and entry.type.immutable:
                    self._entry, self._value = entry, value
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

    __slots__ = ()

    ports = {'key': input_port(STRING, description='key of the entry to be removed')}

    def tick(self) -> NodeStatus:
        self.blackboard.unset(self.get_input('key'))
        return SUCCESS
