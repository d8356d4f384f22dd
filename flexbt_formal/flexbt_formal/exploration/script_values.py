# SPDX-License-Identifier: BSD-3-Clause
"""The values of blackboard entries that affect the scripts of a tree: those next to the constants in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple

from flexbt_core.behavior_tree.model.errors import ConversionError, ScriptError
from flexbt_core.behavior_tree.script.parser import (
    Assignment,
    Binary,
    Comparison,
    Conditional,
    Constant,
    Expression,
    Name,
    Unary,
    parse_script,
)
from flexbt_core.behavior_tree.script.values import BINARY, UNARY


class Compared(NamedTuple):
    """Keys that are compared with each other, or assigned, and the constants (numbers, texts) among them. ``meant`` are
    values that are of use as they are."""

    keys: tuple[str, ...]
    constants: tuple[Any, ...] = ()
    meant: tuple[Any, ...] = ()


_NOTHING = Compared(())


def compared_in(script: str, enums: Mapping[str, int]) -> list[Compared]:
    """Return the separate parts of a script; nothing for a text that is no script. ``enums`` are constants by name."""
    try:
        statements = parse_script(script)
    except ScriptError:
        return []
    reader = _Reader(script, enums)
    for statement in statements:
        reader.add(statement)
    return reader.found


class _Reader:
    def __init__(self, script: str, enums: Mapping[str, int]) -> None:
        self._script = script
        self._enums = enums
        self.found: list[Compared] = []

    def add(self, expression: Expression) -> None:
        """Add an expression as a part of its own."""
        self.found.append(self._read(expression))

    def _read(self, expression: Expression) -> Compared:
        """Return what the value of an expression consists of, and add the parts in it that are apart from that."""
        match expression:
            case Constant(offset, value):
                is_truth = self._script.startswith(('true', 'false'), offset)
                constants = constants_of([value]) if isinstance(value, str) else (value,)
                return _NOTHING if is_truth else Compared((), tuple(constants))
            case Name(_, name):
                name = name.removeprefix('@')
                return Compared((), (self._enums[name],)) if name in self._enums else Compared((name,))
            case Unary(_, '!', operand):
                self.add(operand)
            case Unary(_, sign, operand):
                return self._calculated(UNARY[sign], operand)
            case Binary(_, '&&' | '||', left, right):
                self.add(left)
                self.add(right)
            case Binary(_, sign, left, right):
                return self._calculated(BINARY[sign], left, right)
            case Comparison(_, _, operands):
                self.found.append(_together(map(self._read, operands)))
            case Conditional(_, condition, then, otherwise):
                self.add(condition)
                return _together((self._read(then), self._read(otherwise)))
            case Assignment(_, _, target, value):
                assigned = _together((Compared((target.removeprefix('@'),)), self._read(value)))
                self.found.append(assigned)
                return assigned
        return _NOTHING

    def _calculated(self, operation: Any, *operands: Expression) -> Compared:
        """Return the result of an operation on constants; otherwise its keys and constants."""
        whole = _together(map(self._read, operands))
        if not whole.keys and len(whole.constants) == len(operands):
            with suppress(ConversionError):
                result = operation(*whole.constants)
                return Compared((), (result,)) if isinstance(result, int | float | str) else whole
        return whole


def _together(parts: Iterable[Compared]) -> Compared:
    known = [*parts]
    return Compared(
        tuple(key for one in known for key in one.keys), tuple(value for one in known for value in one.constants)
    )


def tested_values(compared: Iterable[Compared], copied: Iterable[Compared] = ()) -> dict[str, tuple[Any, ...]]:
    """Return the values that affect comparisons, by key: each constant that the key is compared with, its neighbors,
    and what is between two constants.

    Keys that are compared share their values: ``a`` and ``b`` in ``a > 3 && b == a``, also if another script has the
    constant. Each of them can be above the others there: in ``a > b && b > 3`` also. ``copied`` are keys and constants
    of one value, as in a sub-tree and outside of it. A copy alone compares nothing.
    """
    given = [*compared]
    names = {key for one in given for key in one.keys}
    groups: list[tuple[set[str], list[Any], list[Any]]] = []
    for one in (*given, *copied):
        keys, values, meant = set(one.keys), [*one.constants], [*one.meant]
        for group in [other for other in groups if not other[0].isdisjoint(keys)]:
            groups.remove(group)
            keys, values, meant = group[0] | keys, group[1] + values, group[2] + meant
        groups.append((keys, values, meant))
    found: dict[str, tuple[Any, ...]] = {}
    for keys, values, meant in groups:
        rivals = {key for one in given if not keys.isdisjoint(one.keys) for key in one.keys if len({*one.keys}) > 1}
        near = [] if names.isdisjoint(keys) else _near(values, max(1, len(rivals)))
        # 1, 1.0 and True are equal, but must stay distinct here.
        distinct = dict.fromkeys((type(value), value) for value in (*meant, True, False, *near))
        found |= dict.fromkeys(sorted(keys), tuple(value for _, value in distinct))
    return found


def _near(constants: Iterable[Any], rivals: int) -> list[Any]:
    """Return constants and their neighbors, of numbers those of both kinds, so many on each side and between two of
    them that each of ``rivals`` keys can have one of its own."""
    found: list[Any] = []
    numbers: list[float] = []
    steps = sorted(range(-rivals, rivals + 1), key=abs)
    for constant in constants:
        if isinstance(constant, str):
            found += [constant, '' if constant else 'text']
        elif math.isfinite(constant):
            numbers.append(float(constant))
            if float(constant).is_integer():
                found += [one for step in steps for one in (int(constant) + step, float(constant) + step)]
            else:
                found += [constant + step for step in steps]
                found += [whole(constant) + step for whole in (math.floor, math.ceil) for step in steps]
    for low, high in pairwise(sorted({*numbers})):
        if len({one for one in found if type(one) is float and low < one < high}) < rivals:
            found += [low + (high - low) * place / (rivals + 1) for place in range(1, rivals + 1)]
    return found if numbers or rivals <= 2 else [*found, *range(rivals)]  # true and false are enough for two


def constants_of(texts: Iterable[str]) -> Iterator[float | str]:
    """Yield texts that nodes write to an entry, and the numbers that scripts take them for."""
    for text in texts:
        yield text
        with suppress(ValueError):
            yield float(text)
