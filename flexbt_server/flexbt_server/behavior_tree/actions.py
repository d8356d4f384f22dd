# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of the engine: constant results, and changes of the blackboard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .blackboard import EMPTY, Entry
from .errors import BlackboardError, ConversionError
from .leaves import LeafNode, SyncAction
from .node import NodeConfig
from .port_types import KEY, STRING, PortType
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
    value is written as text (converted when the entry has another type); a ``{pointer}`` copies that entry, text in the
    same way, anything else only to an entry of the same type: FAILURE when it was declared but never written.
    """

    __slots__ = ('_ready', '_source', '_text')

    ports = {
        'value': input_port(description='text, or {key} of the entry to be copied'),
        'output_key': inout_port(STRING, literal=KEY, description='key to be written'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        value = config.values.get('value')
        self._source = None if value is None else value.key
        self._text = '' if value is None else value.text
        # For constant text and key: the entry, its type, what the text means in that type, and what writes it there.
        self._ready: tuple[Entry, PortType | None, Any, Callable[[Any], None]] | None = None

    def execute(self) -> NodeStatus:
        ready = self._ready
        if ready is not None:
            entry, kind, value, write = ready
            if entry.present and entry.type is kind:
                write(value)
                self.status = SUCCESS
                return SUCCESS
        return super().execute()

    def tick(self) -> NodeStatus:
        key: str = self.get_input('output_key')
        source = self._source
        board = self.blackboard
        if source is None:
            entry, value = self._write_text(key, self._text)
            kind = entry.type
            if self.port_key('output_key') is None and (kind is None or kind.immutable):
                self._ready = entry, kind, value, board.writer(entry)
            return SUCCESS
        copied = board.entry(source)
        if copied is None:
            raise self._port_error('value', 'the blackboard has no such entry')
        with board.lock:
            value, kind = copied.value, copied.type
            if board.entry(key) is None:
                board.declare(key, kind)
        if value is EMPTY:
            return self.fail(f'the entry [{source}] that is to be copied was never written')
        if isinstance(value, str):
            self._write_text(key, value)
        else:
            board.copy(key, value, kind)
        return SUCCESS

    def _write_text(self, key: str, text: str) -> tuple[Entry, Any]:
        """Gives the entry, and the value that it has now."""
        board = self.blackboard
        with board.lock:
            entry = board.entry(key)
            if entry is None:
                entry = board.declare(key, STRING)
            kind = entry.type
            value: Any = text
            if kind is not None and kind.category != 'text':
                if kind.from_text is None:
                    raise BlackboardError(f'entry [{key}] of type {kind.name} cannot be written as text')
                try:
                    value = kind.parse(text)
                except ConversionError as error:
                    raise BlackboardError(f'entry [{key}]: {error}') from error
            entry.write(value)
        return entry, value


class UnsetBlackboard(SyncAction):
    """Removes the entry ``key`` from the scope of the node itself. SUCCESS also when there was none."""

    __slots__ = ()

    ports = {'key': input_port(STRING, description='key of the entry to be removed')}

    def tick(self) -> NodeStatus:
        self.blackboard.unset(self.get_input('key'))
        return SUCCESS
