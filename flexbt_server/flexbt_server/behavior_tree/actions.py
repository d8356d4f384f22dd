# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of the engine: constant results, and changes of the blackboard."""

from __future__ import annotations

from .blackboard import EMPTY
from .errors import BlackboardError, ConversionError
from .leaves import LeafNode, SyncAction
from .port_types import STRING
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

    __slots__ = ()

    ports = {
        'value': input_port(description='text, or {key} of the entry to be copied'),
        'output_key': inout_port(STRING, description='key to be written'),
    }

    def tick(self) -> NodeStatus:
        key: str = self.get_input('output_key')
        source = self.port_key('value')
        board = self.blackboard
        if source is None:
            self._write_text(key, self.port_text('value') or '')
            return SUCCESS
        entry = board.entry(source)
        if entry is None:
            raise self._port_error('value', 'the blackboard has no such entry')
        with board.lock:
            value, kind = entry.value, entry.type
            if board.entry(key) is None:
                board.declare(key, kind)
        if value is EMPTY:
            return self.fail(f'the entry [{source}] that is to be copied was never written')
        if isinstance(value, str):
            self._write_text(key, value)
        else:
            board.copy(key, value, kind)
        return SUCCESS

    def _write_text(self, key: str, text: str) -> None:
        board = self.blackboard
        with board.lock:
            entry = board.entry(key)
            if entry is None:
                entry = board.declare(key, STRING)
                entry.write(text)
                return
            kind = entry.type
            if kind is None or kind.category == 'text':
                entry.write(text)
                return
            if kind.from_text is None:
                raise BlackboardError(f'entry [{key}] of type {kind.name} cannot be written as text')
            try:
                entry.write(kind.parse(text))
            except ConversionError as error:
                raise BlackboardError(f'entry [{key}]: {error}') from error


class UnsetBlackboard(SyncAction):
    """Removes the entry ``key`` from the scope of the node itself. SUCCESS also when there was none."""

    __slots__ = ()

    ports = {'key': input_port(STRING, description='key of the entry to be removed')}

    def tick(self) -> NodeStatus:
        self.blackboard.unset(self.get_input('key'))
        return SUCCESS
