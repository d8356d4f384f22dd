# SPDX-License-Identifier: BSD-3-Clause
"""The exceptions of the behavior-tree engine.

::

    BehaviorTreeError
    ├── RegistrationError      a node class that cannot be registered
    ├── TreeLoadError          XML that is refused; carries every LoadError that was found
    ├── ConversionError        a value that does not fit a type
    ├── BlackboardError        an entry that is missing, empty, or of another type
    ├── PortError              a port that cannot be read or written; names node, port and key
    ├── ScriptError            a script that cannot be parsed, or that fails when it runs; has the place in it
    └── NodeExecutionError     whatever went wrong inside a node while ticking or halting; names the node
        └── TickAbandoned      a callback has ended the tick, because the tree is to be stopped
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from flexbt_core.values import excerpt

from .failure_trace import FailureStep, FailureTrace


class BehaviorTreeError(Exception):
    """Base of all errors of the engine.

    ``is_absent``: what was to be read is not on the blackboard, or was never written.
    """

    def __init__(self, *args: object, is_absent: bool = False) -> None:
        super().__init__(*args)
        self.is_absent = is_absent


class RegistrationError(BehaviorTreeError):
    """A node class cannot be registered: its ID or one of its port names is taken or not allowed."""


class ConversionError(BehaviorTreeError):
    """A value cannot be converted to the type that is wanted."""


class BlackboardError(BehaviorTreeError):
    """A blackboard entry is missing, was never written, or has another type."""


@dataclass(frozen=True, slots=True)
class LoadError:
    """One reason why a document is refused (or, among the warnings of a document, one oddity).

    ``line`` and ``column`` count from 1 in the text as the user wrote it; both are 0 when it is about the file.
    ``node`` is the element: its tag, with its ``name`` when it has one; '' when there is none.
    ``unknown`` is the node type that is not registered, where that is the reason and no other type is similar.
    """

    file: str
    line: int
    column: int
    node: str
    message: str
    unknown: str = ''

    def __str__(self) -> str:
        where = f'{self.file}:{self.line}:{self.column}' if self.line else self.file
        return f'{where}: {self.node}: {self.message}' if self.node else f'{where}: {self.message}'


class TreeLoadError(BehaviorTreeError):
    """XML, or a set of documents, that is refused. ``errors`` has everything that is wrong, in order of position."""

    def __init__(self, errors: Iterable[LoadError]) -> None:
        self.errors: tuple[LoadError, ...] = tuple(errors)
        super().__init__('\n'.join(str(error) for error in self.errors))


class PortError(BehaviorTreeError):
    """A port of a node cannot be read or written.

    ``key`` is the blackboard key that the port points to, or None when it holds a literal or is not given.
    """

    def __init__(
        self,
        node_path: str,
        node_id: str,
        port: str,
        key: str | None,
        reason: str,
        uid: int = 0,
        *,
        is_absent: bool = False,
    ) -> None:
        self.node_path = node_path
        self.node_id = node_id
        self.uid = uid
        self.port = port
        self.key = key
        self.reason = reason
        pointer = f' (blackboard key [{key}])' if key is not None else ''
        super().__init__(f'port [{port}]{pointer} of {node_id} at [{node_path}]: {reason}', is_absent=is_absent)


class ScriptError(BehaviorTreeError):
    """A script cannot be parsed, or fails when it runs.

    ``script`` is its text, ``offset`` the place in it, counted from 0, and ``reason`` what is wrong there.
    """

    def __init__(self, script: str, offset: int, reason: str, *, is_absent: bool = False) -> None:
        self.script = script
        self.offset = offset
        self.reason = reason
        before = script[:offset]
        line = before.count('\n') + 1
        column = offset - (before.rfind('\n') + 1) + 1
        where = f'line {line}, column {column}' if '\n' in script else f'column {column}'
        super().__init__(f'{reason} ({where} of the script [{excerpt(script, 200)}])', is_absent=is_absent)


class NodeExecutionError(BehaviorTreeError):
    """A node raised, or broke the rules of ticking. The cause is in ``__cause__`` and ``cause``.

    ``uid`` is that of the node, 0 when it is not known. ``trace`` has the nodes from there up to the root, once the
    error has left the tree.

    The tree is left as it was at that moment, as in BehaviorTree.CPP: halt it before anything else is done with it.
    """

    def __init__(self, node_path: str, node_id: str, cause: BaseException | str, uid: int = 0) -> None:
        self.node_path = node_path
        self.node_id = node_id
        self.uid = uid
        self.cause: BaseException | None = cause if isinstance(cause, BaseException) else None
        self.reason = _text_of(cause)
        self.trace = FailureTrace((FailureStep(node_path, self.reason),))
        super().__init__(f'exception in node [{node_path}] ({node_id}): {self.reason}')


class TickAbandoned(NodeExecutionError):
    """A callback has ended a tick: the tree is to be stopped, and the rest of the tick must not begin anything."""


def _text_of(cause: BaseException | str) -> str:
    if isinstance(cause, str):
        return cause
    name = type(cause).__name__
    try:
        text = str(cause)
    except Exception:  # code of others as well
        text = 'its text cannot be made'
    return f'{name}: {text}' if text else name
