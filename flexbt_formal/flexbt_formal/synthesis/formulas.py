# SPDX-License-Identifier: BSD-3-Clause
"""Formulas over the variables of this step and of the next one: parsing, printing and evaluation.

A primed variable is the value in the next step. In a valuation, the numbers 0 and 1 stand for false and true.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_formal.grammar import Grammar, GrammarError, SyntaxTree


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


def valuation(values: Mapping[str, int], *, primed: bool = False) -> dict[VariableName, int]:
    """Return the valuation of this step, or (``primed``) of the next one, from values by the names of the variables."""
    return {VariableName(name, primed): value for name, value in values.items()}


TRUE: Final = Truth(True)
FALSE: Final = Truth(False)

COMPARE: Final[Mapping[str, Callable[[int, int], bool]]] = {
    '=': operator.eq,
    '!=': operator.ne,
    '<': operator.lt,
    '>': operator.gt,
    '<=': operator.le,
    '>=': operator.ge,
}
"""Evaluation of each comparison operator."""


def names_in(formula: Formula | Term) -> Iterator[VariableName]:
    """Yield each occurrence of a variable in a formula."""
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
            return None if a is None or b is None else COMPARE[op](a, b)
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


# Formulas as they are written in specifications of Slugs: ``a & !b' -> (c | next(item=2))``.
#
# What binds strongest comes first: ``!``, comparison, ``&``, ``|``, ``^``, ``->``, ``<->``. ``<-->`` is ``<->``.

Ranges = Mapping[str, tuple[int, int] | None]
"""The variables that a formula may have: the least and the greatest value of an integer, None for a Boolean."""

Labels = Mapping[str, Mapping[int, str]]
"""Names of the values of integers."""

_GRAMMAR: Final = Grammar(
    r"""
    start: equal
    ?equal: implied (_EQUAL equal)?
    ?implied: exclusive ("->" implied)?
    ?exclusive: either ("^" either)*
    ?either: both ("|" both)*
    ?both: single ("&" single)*
    ?single: "!" single -> negation | _NEXT "(" equal ")" -> next | "(" equal ")" | sum (COMPARISON sum)? -> atom
    ?sum: term | sum SIGN term
    term: NUMBER | NAME PRIME?
    _NEXT.2: /next(?=\s*\()/
    COMPARISON: /[<>!]=|[=<>]/
    SIGN: /[-+]/
    NUMBER: /\d+/
    NAME: /[A-Za-z_]\w*/
    PRIME: "'"
    _EQUAL: /<--?>/
    %ignore /\s+/
    """,
    {'NAME': 'a variable'},
    'an operator',
    longest=20_000,
    deepest=50,
)
_JOINS: Final = {'equal': '<->', 'implied': '->', 'exclusive': '^', 'either': '|', 'both': '&'}
_WORDS: Final = {'and': '&', 'or': '|', 'not': '!', 'implies': '->', 'AND': '&', 'OR': '|', 'NOT': '!'}


class FormulaError(ValueError):
    """A text that is not a formula over the known variables; ``reason`` is the message without the formula."""

    def __init__(self, formula: str, reason: str) -> None:
        self.reason = reason
        super().__init__(f"'{formula.strip():.100}': {reason}")


def parse_formula(
    text: str, variables: Ranges, labels: Labels = MappingProxyType({}), names: Collection[str] | None = None
) -> Formula:
    """Return the formula in a text, in which all values are numbers. ``labels``, and ``names`` as users know those of
    the variables, are for messages. Raises FormulaError."""
    return _Reader(text, variables, labels, variables if names is None else names).whole()


class _Reader:
    """A reader of one text: from its syntax tree to a formula whose variables exist and have the type that it needs."""

    def __init__(self, text: str, variables: Ranges, labels: Labels, names: Collection[str]) -> None:
        self._text = text
        self._variables = variables
        self._labels = labels
        self._names = names

    def whole(self) -> Formula:
        for word in re.findall(r'[A-Za-z_]\w*', self._text):
            if word in _WORDS and word not in self._variables:
                raise self._error(f"'{word}' is not a word of formulas: write {_WORDS[word]}")
        if re.search(r'\[\]|<>|◇|□', self._text):
            raise self._error('a formula is about one step: [] (always) and <> (eventually) cannot be in it')
        try:
            return self._formula(_GRAMMAR.parse(self._text).children[0], primed=False)
        except GrammarError as error:
            raise self._error(error.reason) from None

    def _formula(self, tree: SyntaxTree, *, primed: bool) -> Formula:
        if tree.data == 'atom':
            return self._atom(*tree.children, primed=primed)
        parts = tuple(self._formula(part, primed=primed or tree.data == 'next') for part in tree.children)
        if tree.data in _JOINS:
            return Join(_JOINS[tree.data], parts)
        return Not(parts[0]) if tree.data == 'negation' else parts[0]

    def _atom(self, first: SyntaxTree, op: str | None = None, second: SyntaxTree = None, *, primed: bool) -> Formula:
        word = first.children[0]
        if op is None and str(word).lower() in ('true', 'false') and word not in self._variables:
            return TRUE if word.lower() == 'true' else FALSE
        left = self._term(first, primed)
        if op is not None:
            if isinstance(left, VariableName) and left.name in self._labels:
                self._check_label(left.name, next(second.scan_values(lambda _: True)))
            right = self._term(second, primed)
            for term in (left, right):
                if isinstance(term, VariableName) and self._variables[term.name] is None:
                    raise self._error(f"'{term.name}' is true or false, and is not compared: write {term} or !{term}")
            return Compare(str(op), left, right)
        if isinstance(left, VariableName):
            bounds = self._variables[left.name]
            if bounds is not None:
                low, high = bounds
                raise self._error(f"'{left.name}' is a number from {low} to {high}: write {left.name}=VALUE")
            return left
        if isinstance(left, Number) and left.value in (0, 1):
            return TRUE if left.value else FALSE
        raise self._error(f"'{left}' is a number, and says nothing by itself: compare it")

    def _term(self, tree: SyntaxTree, primed: bool) -> Term:
        if tree.data == 'sum':
            left, op, right = tree.children
            return Sum(str(op), self._term(left, primed), self._term(right, primed))
        token = str(tree.children[0])
        if token.isdigit():
            if len(token) > 9:
                raise self._error(f'{token[:12]}… is too great a number')
            return Number(int(token))
        if token not in self._variables:
            raise self._error(f'there is no variable {short_repr(token)}{did_you_mean(token, list(self._names))}')
        return VariableName(token, primed or len(tree.children) > 1)

    def _check_label(self, variable: str, value: Any) -> None:
        if value.type == 'NAME' and value not in self._variables:
            known = self._labels[variable].values()
            raise self._error(f"'{variable}' has no value {short_repr(str(value))}{did_you_mean(str(value), known)}")

    def _error(self, reason: str) -> FormulaError:
        return FormulaError(self._text, reason)
