# SPDX-License-Identifier: BSD-3-Clause
"""Messages made of named values: templates whose fields are constants, values and expressions, and the expressions."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import ScriptFactory
from flexbt_core.behavior_tree.model.errors import ScriptError
from flexbt_core.behavior_tree.model.ports import ANY
from flexbt_core.behavior_tree.script.parser import is_assigning, parse_script
from flexbt_core.values.text import short_repr

from .fields import Field, constants_of
from .value_types import PRIMITIVES, FieldError

_NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})
_VALUE: Final = '_value'
"""Key of an expression's value on its private blackboard."""
_NAMES: Final = re.compile(r'(?<![\w.])@?[A-Za-z_]\w*')
_PRIVATE: Final = re.compile(r"(?<![\w.'])_\w+")
_PARTS: Final = re.compile(r"'[^']*'|(?<![\w.])(@?[A-Za-z_]\w*)((?:\.\w+)+)")
"""A text of a script, or a name with the path of a field."""
_CONSTANTS: Final = frozenset(('true', 'false'))


class Expression:
    """An expression in the language of scripts that also reads fields of messages, as ``name.field``.

    Names are entries of the blackboard. A name with a field is a message in an entry, unless it is one of ``roots``:
    the messages that a leaf has received, by what they are called in its expressions.
    """

    def __init__(self, text: str, roots: Mapping[str, type[Any]]) -> None:
        """Raise ScriptError or FieldError if this is no expression, or reads a field that a root does not have."""
        self.text = text
        self._roots = roots
        self._constants: dict[str, Any] = {}
        self._fields: dict[str, tuple[str, str, Field | None]] = {}
        """By placeholder in the script: name and path, and the field of a root."""
        self._placeholders: dict[str, str] = {}
        self.script = _PARTS.sub(self._placeholder, text)
        if len(parse_script(self.script)) != 1:
            raise ScriptError(text, 0, 'expected one expression')
        if is_assigning(self.script):
            raise ScriptError(text, 0, 'an expression assigns nothing; write == to compare')
        self.names = frozenset(_NAMES.findall(re.sub(r"'[^']*'", '', text))) - _CONSTANTS
        """Names in the text, also those of roots."""
        self._private = [name for name in _PRIVATE.findall(self.script) if name not in self._placeholders.values()]

    def _placeholder(self, match: re.Match[str]) -> str:
        whole, name, path = match[0], match[1], match[2]
        if name is None:
            return whole
        known = self._placeholders.get(whole)
        if known is not None:
            return known
        placeholder = self._placeholders[whole] = f'_field{len(self._placeholders)}'
        path = path[1:]
        root = self._roots.get(name)
        if root is not None and path in constants_of(root):
            self._constants[placeholder] = getattr(root, path)
            return placeholder
        field = None if root is None else Field(root, path)
        if field is not None and (field.slot is None or field.type_name not in PRIMITIVES):
            raise FieldError(whole, f'it is a {field.type_name}; an expression reads numbers, bools and texts')
        self._fields[placeholder] = name, path, field
        return placeholder

    def value(self, scripts: ScriptFactory, board: Blackboard, values: Mapping[str, Any] = _NOTHING) -> Any:
        """Return the value; ``values`` are named values in front of the blackboard.

        Raises:
            ValueError, BlackboardError: an entry is missing, or has no such field.
            ScriptError: the values cannot be combined so.
        """
        own = self._own_board(board, _NOTHING, values)
        own.declare(_VALUE, ANY)
        scripts.script(f'{_VALUE} := ({self.script})').bind(own).run()
        return own.get(_VALUE)

    def holds(
        self,
        scripts: ScriptFactory,
        board: Blackboard,
        messages: Mapping[str, Any],
        values: Mapping[str, Any] = _NOTHING,
    ) -> bool:
        """Return whether the condition is true of these messages and named values. Raises as :meth:`value`."""
        own = self._own_board(board, messages, values)
        return bool(scripts.script(self.script).bind(own, condition=True).run())

    def described(self, board: Blackboard, messages: Mapping[str, Any], values: Mapping[str, Any] = _NOTHING) -> str:
        """Return the expression and the values of the fields that it reads, for a person."""
        shown = [f'{name} = {short_repr(value)}' for name, value in values.items() if name in self.names]
        for name, path, field in self._fields.values():
            shown.append(f'{name}.{path} = {short_repr(_read(board, name, path, field, messages, values))}')
        return f'{self.text} ({", ".join(shown)})' if shown else self.text

    def _own_board(self, board: Blackboard, messages: Mapping[str, Any], values: Mapping[str, Any]) -> Blackboard:
        own = Blackboard(board)
        own.enable_autoremap()
        for name in self._private:
            own.remap(name, name)
        for name, value in (*self._constants.items(), *values.items()):
            own.put(name, value, None)
        for placeholder, (name, path, field) in self._fields.items():
            own.put(placeholder, _read(board, name, path, field, messages, values), None)
        return own


def _read(
    board: Blackboard,
    name: str,
    path: str,
    field: Field | None,
    messages: Mapping[str, Any],
    values: Mapping[str, Any],
) -> Any:
    if field is not None:
        return field.get(messages[name])
    message = values[name] if name in values else board.get(name)
    if not hasattr(type(message), 'get_fields_and_field_types'):
        raise ValueError(f'[{name}] holds no message with a field {path!r}, but {short_repr(message)}')
    return Field(type(message), path).get(message)


def is_expression(text: object) -> bool:
    """Return whether the value of a field is written as ``${expression}``."""
    return isinstance(text, str) and text.strip().startswith('${') and text.rstrip().endswith('}')


def embedded(text: str) -> Expression:
    """Return the expression of ``${expression}``. Raises ScriptError or FieldError."""
    return Expression(text.strip()[2:-1], _NOTHING)


# Messages made of named values.


class Source(NamedTuple):
    """The value of a field: a named value, or else a constant or an Expression."""

    name: str
    value: Any = None


class MessageTemplate:
    """A template of a message that sets some of its fields."""

    def __init__(self, message: type[Any], fields: Mapping[str, tuple[Field, Source]]) -> None:
        """``fields`` are by path; the path '' is the whole message."""
        self.message = message
        self.fields = dict(sorted(fields.items(), key=lambda one: one[1][0].steps))

    def make(self, read: Callable[[str], Any], evaluate: Callable[[Field, Expression], Any]) -> Any:
        """Return the message. ``read`` returns a named value, or None for an optional one that is missing.

        Values are copied if other fields change parts of them.

        Raises:
            ValueError: a value does not fit; it names the field.
        """
        message = None
        for path, (field, source) in self.fields.items():
            value = read(source.name) if source.name else source.value
            try:
                if isinstance(value, Expression):
                    value = evaluate(field, value)
                if value is None:
                    continue
                if len(self.fields) > 1 and any(other != path and _is_within(other, path) for other in self.fields):
                    value = copy.deepcopy(value)
                if not path:
                    message = value
                    continue
                if message is None:
                    message = self.message()
                field.set(message, value)
            except ValueError as error:
                reason = error.reason if isinstance(error, FieldError) else error
                raise ValueError(f'[{path or source.name}]: {reason}') from error
        return self.message() if message is None else message


def _is_within(path: str, outer: str) -> bool:
    return not outer or path.startswith(f'{outer}.')
