# SPDX-License-Identifier: BSD-3-Clause
"""Types of data and their values: numbers, truth values, texts, arrays (``int32[]``, ``float32[3]``), and structs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import did_you_mean

from .source_text import SourceElement, read_text, read_xml

_NUMBERS: Final = {
    **{f'{sign}int{bits}': int for sign in ('', 'u') for bits in (8, 16, 32, 64)},
    'float32': float,
    'float64': float,
}
_BASE: Final[Mapping[str, type[Any]]] = {'bool': bool, 'string': str, **_NUMBERS}
_JSON_BASE: Final = {'boolean': 'bool', 'integer': 'int32', 'number': 'float32', 'string': 'string'}
_ARRAY: Final = re.compile(r'(.*)\[(\d{0,9})\]', re.DOTALL)
MAX_NESTING: Final = 20


class DataTypeError(ValueError):
    """An unknown type, or a value that does not match its type."""


@dataclass(frozen=True)
class DataType:
    """A data type. ``plain``: the Python type of a number, Boolean or text. ``members``: the members of a struct.
    ``inner``: the element type of an array with at most ``most`` elements."""

    name: str
    plain: type[Any] | None = None
    members: Mapping[str, DataType] = field(default_factory=dict)
    inner: DataType | None = None
    most: int = 0

    @property
    def zero(self) -> Any:
        """Value of a variable that was never set."""
        if self.inner is not None:
            return ()
        if self.plain is not None:
            return self.plain()
        return Record((name, kind.zero) for name, kind in self.members.items())

    def checked(self, value: Any) -> Any:
        """Return the value, with members in the order of the struct. Raises DataTypeError if it is not of this type."""
        if self.inner is not None:
            if not isinstance(value, tuple) or isinstance(value, Record):
                raise DataTypeError(f'{value!r} is not an array, as {self.name} is')
            if len(value) > self.most:
                raise DataTypeError(f'{len(value)} elements are more than the {self.most} of {self.name}')
            return tuple(map(self.inner.checked, value))
        if self.plain is None:
            if not isinstance(value, Record) or {key for key, _ in value} != set(self.members):
                raise DataTypeError(f'{value!r} does not have the members of {self.name}: {", ".join(self.members)}')
            return Record((name, kind.checked(value.get(name))) for name, kind in self.members.items())
        if self.plain is float and type(value) is int:
            return float(value)
        if type(value) is not self.plain:
            raise DataTypeError(f'{value!r} is not of type {self.name}')
        return value

    def from_text(self, text: str) -> Any:
        """Return the value of a port from the text of an attribute in a behavior tree. Raises DataTypeError."""
        try:
            if self.plain is str:
                return text
            if self.plain is bool and text.strip() in ('true', 'false'):
                return text.strip() == 'true'
            if self.plain is int:
                return int(text)
            if self.plain is float:
                return float(text)
        except ValueError:
            pass
        raise DataTypeError(f'{text!r} is not of type {self.name}')

    def replaced(self, value: Any, path: Sequence[Any], new: Any) -> Any:
        """Return ``value`` (of this type) with ``new`` at the end of a path of members (strings) and indexes.

        An index beyond the end extends the array. Raises DataTypeError, also for an index that is out of bounds.
        """
        if not path:
            return new
        step, rest = path[0], path[1:]
        if isinstance(step, str):
            return self._with_member(value, step, rest, new)
        if self.inner is None:
            raise DataTypeError(f'{self.name} is not an array, so it has no element {step!r}')
        if not 0 <= step < self.most or step != int(step):
            raise DataTypeError(f'there is no element {step!r}: {self.name} has {self.most} at most')
        at = int(step)
        if at >= len(value):
            value = (*value, *(self.inner.zero,) * (at + 1 - len(value)))
        return (*value[:at], self.inner.replaced(value[at], rest, new), *value[at + 1 :])

    def _with_member(self, value: Any, name: str, rest: Sequence[Any], new: Any) -> Any:
        if self.inner is None:
            kind = self.members.get(name)
            if kind is None:
                raise DataTypeError(f'{self.name} has no member {name!r}')
            return Record((key, kind.replaced(held, rest, new) if key == name else held) for key, held in value)
        if name == 'length':
            if type(new) is not int or not 0 <= new <= self.most:
                raise DataTypeError(f'{self.name} cannot have {new!r} elements')
            return (*value[:new], *(self.inner.zero,) * (new - len(value)))
        # Set a member of all elements, from an array with one value per element.
        if not isinstance(new, tuple) or len(new) != len(value):
            raise DataTypeError(f'{new!r} are not the {len(value)} values that {name} of {self.name} needs')
        return tuple(self.inner.replaced(held, (name, *rest), one) for held, one in zip(value, new, strict=True))


class DataTypes:
    """The types of one model. ``most`` is the maximum length of arrays that declare none."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._structs: dict[str, dict[str, str]] = {}

    def find(self, name: str, nested: int = 0) -> DataType:
        """Return the type of a name. Raises DataTypeError."""
        name = name.strip()
        if nested > MAX_NESTING:
            raise DataTypeError(f'{name} is nested more than {MAX_NESTING} deep, or contains itself')
        plain = _BASE.get(name)
        if plain is not None:
            return DataType(name, plain)
        array = _ARRAY.fullmatch(name)
        if array is not None:
            # In int32[][5], the last size is that of the innermost array.
            base, sizes = name[: name.index('[')], re.findall(r'\[(\d*)\]', name)
            if len(sizes) > MAX_NESTING:
                raise DataTypeError(f'an array has {len(sizes)} dimensions; {MAX_NESTING} are the most')
            kind = self.find(base, nested + 1)
            for size in reversed(sizes):
                kind = DataType(name, inner=kind, most=int(size) if size else self._most)
            return kind
        members = self._structs.get(name)
        if members is None:
            known = (*_BASE, *self._structs)
            raise DataTypeError(f'the type {name!r} is not known{did_you_mean(name, known)}')
        return DataType(name, members={key: self.find(kind, nested + 1) for key, kind in members.items()})

    def read(self, asked: SourceElement, path: str) -> None:
        """Add the structs of a file; the ``type`` of the element ``asked`` selects XML or JSON schema. Raises
        ModelError."""
        if asked.need('type') == 'xml':
            self._read_xml(path, asked)
        else:
            self._read_json(path, asked)
        for name in self._structs:
            try:
                self.find(name)
            except DataTypeError as error:
                asked.fail(f'{path}: {error}')

    def _read_xml(self, path: str, asked: SourceElement) -> None:
        root = read_xml(path, asked)
        if root.tag != 'types':
            root.fail('a file of structs begins with <types>')
        root.only(('struct',))
        for struct in root.children:
            struct.only(('member',))
            members = {one.need('id'): one.need('type') for one in struct.children}
            self._add(struct.need('id'), members, struct)

    def _read_json(self, path: str, asked: SourceElement) -> None:
        try:
            schema = load_json(read_text(path, asked))
        except ValueError as error:
            asked.fail(f'{path} is not JSON: {error}', 'src')
        if not isinstance(schema, dict) or schema.get('type') != 'object' or not isinstance(schema.get('title'), str):
            asked.fail(f'{path} is not a schema of an object with a title', 'src')
        self._from_schema(schema, schema, schema['title'], asked, 0)

    def _from_schema(self, root: Mapping[str, Any], schema: Any, name: str, asked: SourceElement, nested: int) -> str:
        """Return the name of the type that a schema describes, and add its structs."""
        if nested > MAX_NESTING or not isinstance(schema, dict):
            asked.fail(f'the schema of {name!r} is not an object, or is nested more than {MAX_NESTING} deep')
        reference = schema.get('$ref')
        if reference is not None:
            steps = str(reference).split('/')
            schema = root
            for step in steps[1:]:
                schema = schema.get(step) if isinstance(schema, dict) else None
            if steps[0] != '#' or not isinstance(schema, dict):
                asked.fail(f'the schema refers to {reference!r}, which is not there; write "#/$defs/NAME"')
            name = steps[-1]
        kind = schema.get('type')
        if kind == 'array':
            return f'{self._from_schema(root, schema.get("items"), name, asked, nested + 1)}[]'
        if kind == 'object':
            inner = schema.get('properties')
            if not isinstance(inner, dict) or not inner:
                asked.fail(f'the schema of {name!r} has no properties')
            members = {key: self._from_schema(root, one, key, asked, nested + 1) for key, one in inner.items()}
            self._add(name, members, asked)
            return name
        if kind not in _JSON_BASE:
            asked.fail(
                f'the schema of {name!r} has the type {kind!r}; there are object, array, {", ".join(_JSON_BASE)}'
            )
        return _JSON_BASE[kind]

    def _add(self, name: str, members: dict[str, str], asked: SourceElement) -> None:
        if name in _BASE or self._structs.get(name, members) != members:
            asked.fail(f'the type {name!r} is declared twice, and not in the same way')
        self._structs[name] = members


# Values of models: numbers, Booleans, texts, arrays (tuples) and records. All are immutable.


class Record(tuple[tuple[str, Any], ...]):
    """A struct value: its members by name, in order."""

    __slots__ = ()

    def get(self, name: str) -> Any:
        """Raise KeyError."""
        for key, value in self:
            if key == name:
                return value
        raise KeyError(f'there is no member {name!r}; there are {", ".join(key for key, _ in self)}')


def length(value: Any) -> int:
    """Return the length of an array, of a text in bytes, or of the first member of a record that has one. Raises
    TypeError."""
    if isinstance(value, Record):
        for _, held in value:
            if isinstance(held, tuple | str):
                return length(held)
        raise TypeError('this record has no array, so it has no length')
    if isinstance(value, str):
        return len(value.encode())
    if isinstance(value, tuple):
        return len(value)
    raise TypeError(f'{value!r} has no length')


def member(value: Any, name: str) -> Any:
    """Return a member of a record; for an array of records, the array of that member. Raises KeyError or TypeError."""
    if isinstance(value, Record):
        if name == 'length' and all(key != name for key, _ in value):
            return length(value)
        return value.get(name)
    if name == 'length':
        return length(value)
    if isinstance(value, tuple):
        return tuple(member(one, name) for one in value)
    raise TypeError(f'{value!r} has no members, so no {name!r}')


def element(value: Any, index: Any) -> Any:
    """Return an element of an array, or a byte of a text. Raises IndexError or TypeError."""
    if isinstance(index, float) and index.is_integer():
        index = int(index)
    if isinstance(value, str):
        value = tuple(value.encode())
    if not isinstance(value, tuple) or isinstance(value, Record) or type(index) is not int:
        raise TypeError(f'{value!r} has no element {index!r}')
    if not 0 <= index < len(value):
        raise IndexError(f'there is no element {index}: the array has {len(value)}')
    return value[index]
