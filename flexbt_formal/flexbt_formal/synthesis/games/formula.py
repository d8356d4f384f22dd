# SPDX-License-Identifier: BSD-3-Clause
"""Formulas over variables of this step and of the next one: their form, their text, their value.

A primed variable is the value in the next step. Truth values are the numbers 0 and 1, as they are in a valuation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class VariableName:
    """A variable, now or (``primed``) in the next step."""

    name: str
    primed: bool = False

    def __str__(self) -> str:
        return f"{self.name}'" if self.primed else self.name


@dataclass(frozen=True, slots=True)
class Number:
    """A constant integer."""

    value: int

    def __str__(self) -> str:
        return str(self.value)


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum or difference (``op``) of ``left`` and ``right``."""

    op: str
    left: Term
    right: Term

    def __str__(self) -> str:
        return f'{self.left} {self.op} {self.right}'


Term = VariableName | Number | Sum


@dataclass(frozen=True, slots=True)
class Truth:
    """TRUE or FALSE."""

    value: bool

    def __str__(self) -> str:
        return 'TRUE' if self.value else 'FALSE'


@dataclass(frozen=True, slots=True)
class Compare:
    """Two terms compared by one of ``= != < > <= >=``."""

    op: str
    left: Term
    right: Term

    def __str__(self) -> str:
        return f'({self.left} {self.op} {self.right})'


@dataclass(frozen=True, slots=True)
class Not:
    """The negation."""

    part: Formula

    def __str__(self) -> str:
        return f'!{self.part}'


@dataclass(frozen=True, slots=True)
class Join:
    """Formulas joined by one of ``& | ^ -> <->``; the last two have two parts."""

    op: str
    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return f'({f" {self.op} ".join(map(str, self.parts))})'


Formula = Truth | VariableName | Compare | Not | Join
Valuation = Mapping[VariableName, int]

TRUE: Final = Truth(True)
FALSE: Final = Truth(False)

_COMPARE: Final = {
    '=': lambda a, b: a == b,
    '!=': lambda a, b: a != b,
    '<': lambda a, b: a < b,
    '>': lambda a, b: a > b,
    '<=': lambda a, b: a <= b,
    '>=': lambda a, b: a >= b,
}


def compare(op: str, left: int, right: int) -> bool:
    """Return what ``left op right`` says of two numbers."""
    return _COMPARE[op](left, right)


def names_in(formula: Formula | Term) -> Iterator[VariableName]:
    """Yield the variables of a formula, as often as it has them."""
    match formula:
        case VariableName():
            yield formula
        case Not(part):
            yield from names_in(part)
        case Join(_, parts):
            for part in parts:
                yield from names_in(part)
        case Compare(_, left, right) | Sum(_, left, right):
            yield from names_in(left)
            yield from names_in(right)


def value_of(formula: Formula, valuation: Valuation) -> bool | None:
    """Return whether a formula holds; None when that depends on variables without a value."""
    match formula:
        case VariableName():
            known = valuation.get(formula)
            return None if known is None else bool(known)
        case Truth(value):
            return value
        case Not(part):
            inner = value_of(part, valuation)
            return None if inner is None else not inner
        case Compare(op, left, right):
            a, b = _number(left, valuation), _number(right, valuation)
            return None if a is None or b is None else compare(op, a, b)
        case Join('&' | '|' as op, parts):
            found: bool | None = op == '&'
            for part in parts:
                one = value_of(part, valuation)
                if one is (op == '|'):
                    return one
                found = None if one is None else found
            return found
        case Join('->', (left, right)):
            return value_of(Join('|', (Not(left), right)), valuation)
        case Join(op, parts):
            values = [value_of(part, valuation) for part in parts]
            if None in values:
                return None
            odd = sum(map(bool, values)) % 2 == 1
            return odd if op == '^' else not odd


def _number(term: Term, valuation: Valuation) -> int | None:
    match term:
        case Number(value):
            return value
        case VariableName():
            return valuation.get(term)
        case Sum(op, left, right):
            a, b = _number(left, valuation), _number(right, valuation)
            return None if a is None or b is None else a + b if op == '+' else a - b
