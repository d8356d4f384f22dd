# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the behavior-tree engine, and where they are: the place in a file, the nodes from the fault to the root.

::

    BehaviorTreeError
    ├── RegistrationError      a node class that cannot be registered
    ├── TreeLoadError          XML that is refused; carries every LoadError that was found
    ├── ElementError           attributes of an element that a node class cannot use
    ├── ConversionError        a value that does not fit a type
    ├── BlackboardError        an entry that is missing, empty, or of another type
    ├── PortError              a port that cannot be read or written; names node, port and key
    ├── ScriptError            a script that cannot be parsed, or that fails when it runs; has the place in it
    └── NodeExecutionError     an error inside a node while ticking or halting; names the node
        └── TickAbandoned      a callback has ended the tick, because the tree is to be stopped
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

from flexbt_core.values.text import truncate_middle


class BehaviorTreeError(Exception):
    """Base of all errors of the engine.

    ``is_absent``: the entry is not on the blackboard, or was never written.
    """

    def __init__(self, *args: object, is_absent: bool = False) -> None:
        super().__init__(*args)
        self.is_absent = is_absent


class RegistrationError(BehaviorTreeError):
    """A node class cannot be registered: its ID or one of its port names is taken or not allowed."""


class ConversionError(BehaviorTreeError):
    """A value cannot be converted to the required type."""


class BlackboardError(BehaviorTreeError):
    """A blackboard entry is missing, was never written, or has another type."""


@dataclass(frozen=True, slots=True)
class LoadError:
    """One reason why a document is rejected, or one warning about it.

    ``line`` and ``column`` count from 1 in the text as the user wrote it; both are 0 when the error concerns the whole
    file. ``end`` is the line and column behind the last character; (0, 0) if only the start is known. ``node`` is the
    element: its tag, and its ``name`` if it has one; '' without an element. ``unknown`` is the node type that is not
    registered, if that is the reason and no similar type is known.
    """

    file: str
    line: int
    column: int
    node: str
    message: str
    unknown: str = ''
    end: tuple[int, int] = (0, 0)

    def __str__(self) -> str:
        where = f'{self.file}:{self.line}:{self.column}' if self.line else self.file
        return f'{where}: {self.node}: {self.message}' if self.node else f'{where}: {self.message}'


class TreeLoadError(BehaviorTreeError):
    """XML, or a set of documents, that is rejected. ``errors`` lists every problem, in order of position."""

    def __init__(self, errors: Iterable[LoadError]) -> None:
        self.errors: tuple[LoadError, ...] = tuple(errors)
        super().__init__('\n'.join(str(error) for error in self.errors))


class ElementError(BehaviorTreeError):
    """Attributes of an XML element that its node class cannot use: ``problems`` are pairs of attribute and reason."""

    def __init__(self, problems: Iterable[tuple[str, str]]) -> None:
        self.problems = tuple(problems)
        super().__init__('; '.join(f'[{attribute}] {reason}' for attribute, reason in self.problems))


class PortError(BehaviorTreeError):
    """A port of a node cannot be read or written.

    ``key`` is the blackboard key that the port points to; None if it holds a literal or is not given.
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

    ``script`` is its text, ``offset`` the position of the error, counted from 0, and ``reason`` the description.
    """

    def __init__(self, script: str, offset: int, reason: str, *, is_absent: bool = False) -> None:
        self.script = script
        self.offset = offset
        self.reason = reason
        before = script[:offset]
        line = before.count('\n') + 1
        column = offset - (before.rfind('\n') + 1) + 1
        where = f'line {line}, column {column}' if '\n' in script else f'column {column}'
        super().__init__(f'{reason} ({where} of the script [{truncate_middle(script, 200)}])', is_absent=is_absent)


class NodeExecutionError(BehaviorTreeError):
    """A node raised, or broke the rules of ticking. The cause is in ``__cause__`` and ``cause``.

    ``uid`` identifies the node; 0 if it is unknown. ``trace`` lists the nodes from the failing one up to the root. It
    is set once the error has left the tree.

    As in BehaviorTree.CPP, the tree stays in the state of that moment: halt it before you use it again.
    """

    def __init__(self, node_path: str, node_id: str, cause: BaseException | str, uid: int = 0) -> None:
        self.node_path = node_path
        self.node_id = node_id
        self.uid = uid
        self.cause: BaseException | None = cause if isinstance(cause, BaseException) else None
        self.reason = text_of_cause(cause)
        self.trace = FailureTrace((FailureStep(node_path, self.reason),))
        super().__init__(f'exception in node [{node_path}] ({node_id}): {self.reason}')


class TickAbandoned(NodeExecutionError):
    """A callback ended a tick to stop the tree; the rest of the tick must not start any work."""


def text_of_cause(cause: BaseException | str) -> str:
    """Return an exception of a node's code as text, with its class; a text unchanged."""
    if isinstance(cause, str):
        return cause
    name = type(cause).__name__
    try:
        text = str(cause)
    except Exception:  # also from user code
        text = 'its text cannot be made'
    return f'{name}: {text}' if text else name


# Traces: why a tree failed, or where a node raised. They list the nodes from the one at fault up to the root.
#
# Ticking records no trace. Until its next tick, a node knows which child made it fail and what it did itself; the trace
# is built on request.

MOST_LINES: Final = 100


class FailureStep(NamedTuple):
    """The path of a node, and its part in the failure."""

    path: str
    reason: str

    def __str__(self) -> str:
        return f'{self.path}: {self.reason}'


class FailureTrace(NamedTuple):
    """The nodes from the one at fault up to the root, each with its reason."""

    steps: tuple[FailureStep, ...]

    @property
    def path(self) -> str:
        """Path of the node at fault."""
        return self.steps[0].path

    @property
    def reason(self) -> str:
        """Reason why the node at fault failed."""
        return self.steps[0].reason

    @property
    def chain(self) -> tuple[str, ...]:
        """The paths from the root to the node at fault."""
        return tuple(step.path for step in reversed(self.steps))

    def lines(self, most: int = MOST_LINES) -> list[str]:
        """Return the steps as ``path: reason``. Above ``most`` steps, one line replaces those in the middle."""
        steps = self.steps
        if len(steps) <= most:
            return [str(step) for step in steps]
        head = most // 2
        tail = most - head - 1
        between = f'({len(steps) - head - tail} nodes in between)'
        return [*map(str, steps[:head]), between, *map(str, steps[len(steps) - tail :])]


# The source text of definitions, and the positions of errors in it.

_SPAN: Final = re.compile(
    r"""<(?:[^<>"']|"[^"]*"|'[^']*')*>?|[\w:.-]+\s*=\s*(?:"[^"]*"|'[^']*')|[^\s<>"'=]+|.""", re.DOTALL
)
"""What an error at an offset is about: a tag, an attribute with its value, or a word."""


class Source:
    """The text of one file. It converts offsets to lines and columns."""

    def __init__(self, file: str, text: str) -> None:
        self.file = file
        self.text = text
        self._line_starts: list[int] | None = None

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and column, from 1, of the character at ``offset``."""
        if self._line_starts is None:
            self._line_starts = [0, *(match.end() for match in re.finditer('\n', self.text))]
        line = bisect.bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def error(self, offset: int, message: str, node: str = '') -> LoadError:
        """Return an error at this offset. ``node`` is the element, in the form shown to users."""
        line, column = self.position(offset)
        span = _SPAN.match(self.text, offset)
        end = self.position(offset if span is None else span.end())
        return LoadError(self.file, line, column, truncate_middle(node, 200), truncate_middle(message, 500), end=end)
