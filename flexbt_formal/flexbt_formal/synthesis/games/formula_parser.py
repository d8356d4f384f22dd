# SPDX-License-Identifier: BSD-3-Clause
"""Formulas as they are written in specifications of Slugs: ``a & !b' -> (c | next(item=2))``.

What binds strongest comes first: ``!``, comparison, ``&``, ``|``, ``^``, ``->``, ``<->``. ``<-->`` is ``<->``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Final

from flexbt_core.values.text import did_you_mean, short_repr

from .formula import FALSE, TRUE, Compare, Formula, Join, Not, Number, Sum, Term, VariableName

MAX_LENGTH: Final = 20_000
"""Characters of a formula that are read at most."""

MAX_DEPTH: Final = 50
"""Parentheses and negations in each other that are read at most."""

Ranges = Mapping[str, tuple[int, int] | None]
"""The variables that a formula may have: the least and the greatest value of an integer, None for a Boolean."""

Labels = Mapping[str, Mapping[int, str]]
"""What the values of integers are called."""

_TOKEN: Final = re.compile(r"\s*(?:(\d+)|([A-Za-z_]\w*)|(<-->|<->|->|<=|>=|!=|[-+<>=!&|^()']))")
_WORD: Final = re.compile(r'[A-Za-z_]\w*')
_LEVELS: Final = ('<->', '->', '^', '|', '&')
_WORDS: Final = {'and': '&', 'or': '|', 'not': '!', 'implies': '->', 'AND': '&', 'OR': '|', 'NOT': '!'}
_COMPARISONS: Final = ('=', '!=', '<', '>', '<=', '>=')


class FormulaError(ValueError):
    """A text is no formula over the variables that there are; the text says what is wrong, and with what. ``reason``
    is that without the formula."""

    def __init__(self, formula: str, reason: str) -> None:
        self.reason = reason
        super().__init__(f"'{formula.strip():.100}': {reason}")


def parse_formula(
    text: str, variables: Ranges, labels: Labels = MappingProxyType({}), names: Collection[str] | None = None
) -> Formula:
    """Return the formula in a text, in which all values are numbers. ``labels``, and ``names`` as users know those of
    the variables, are for messages. Raises FormulaError."""
    if len(text) > MAX_LENGTH:
        raise FormulaError(text, f'it has {len(text)} characters; a formula may have {MAX_LENGTH}')
    return _Parser(text, variables, labels, variables if names is None else names).whole()


class _Parser:
    def __init__(self, text: str, variables: Ranges, labels: Labels, names: Collection[str]) -> None:
        self._text = text
        self._names = names
        self._variables = variables
        self._labels = labels
        self._tokens: list[str] = []
        self._at = 0
        self._depth = 0
        self._primed = False
        position, end = 0, len(text.rstrip())
        while position < end:
            found = _TOKEN.match(text, position)
            if found is None:
                sign = text[position:].strip()[:1]
                temporal = '; it speaks of one moment, without always and eventually' if sign in '[◇□' else ''
                raise self._error(f"'{sign}' cannot be in a formula{temporal}")
            token = '<->' if found[3] == '<-->' else found[0].strip()
            if token in _WORDS and token not in variables:
                raise self._error(f"'{token}' is no word of formulas: write {_WORDS[token]}")
            self._tokens.append(token)
            position = found.end()

    def whole(self) -> Formula:
        if not self._tokens:
            raise self._error('the formula is empty')
        formula = self._joined(0)
        if self._at < len(self._tokens):
            raise self._error(f"'{self._tokens[self._at]}' is not expected there")
        return formula

    def _joined(self, level: int) -> Formula:
        if level == len(_LEVELS):
            return self._unary()
        op = _LEVELS[level]
        parts = [self._joined(level + 1)]
        while self._taken(op):
            if op in ('->', '<->'):
                if len(parts) > 1:
                    break
                self._deeper(1)
                parts.append(self._joined(level))
                self._depth -= 1
            else:
                parts.append(self._joined(level + 1))
        return parts[0] if len(parts) == 1 else Join(op, tuple(parts))

    def _unary(self) -> Formula:
        self._deeper(1)
        try:
            if self._taken('!'):
                return Not(self._unary())
            if self._peek() == '(':
                return self._parenthesis()
            if self._peek() == 'next' and self._peek(1) == '(':
                self._at += 1
                before, self._primed = self._primed, True
                inside = self._parenthesis()
                self._primed = before
                return inside
            return self._atom()
        finally:
            self._depth -= 1

    def _parenthesis(self) -> Formula:
        self._expect('(')
        inside = self._joined(0)
        self._expect(')')
        return inside

    def _atom(self) -> Formula:
        word = self._peek()
        if word.lower() in ('true', 'false') and word not in self._variables:
            self._at += 1
            return TRUE if word.lower() == 'true' else FALSE
        left = self._sum()
        op = self._peek()
        if op in _COMPARISONS:
            self._at += 1
            if isinstance(left, VariableName) and left.name in self._labels:
                self._check_label(left.name, self._labels[left.name].values())
            right = self._sum()
            for term in (left, right):
                if isinstance(term, VariableName) and self._variables[term.name] is None:
                    raise self._error(f"'{term.name}' is true or false, and is not compared: write {term} or !{term}")
            return Compare(op, left, right)
        if isinstance(left, VariableName):
            bounds = self._variables[left.name]
            if bounds is not None:
                low, high = bounds
                raise self._error(f"'{left.name}' is a number from {low} to {high}: write {left.name}=VALUE")
            return left
        if isinstance(left, Number) and left.value in (0, 1):
            return TRUE if left.value else FALSE
        raise self._error(f"'{left}' is a number, and says nothing by itself: compare it")

    def _sum(self) -> Term:
        term = self._term()
        while (op := self._peek()) in ('+', '-'):
            self._at += 1
            self._deeper(0)
            term = Sum(op, term, self._term())
        return term

    def _term(self) -> Term:
        token = self._peek()
        if token.isdigit():
            self._at += 1
            if len(token) > 9:
                raise self._error(f'{token[:12]}… is too great a number')
            return Number(int(token))
        if not (token[:1].isalpha() or token[:1] == '_'):
            raise self._error(self._missing(token))
        if token not in self._variables:
            raise self._error(f'there is no variable {short_repr(token)}{did_you_mean(token, list(self._names))}')
        self._at += 1
        return VariableName(token, self._taken("'") or self._primed)

    def _check_label(self, variable: str, known: Collection[str]) -> None:
        value = self._peek()
        if _WORD.fullmatch(value) and value not in self._variables:
            raise self._error(f"'{variable}' has no value {short_repr(value)}{did_you_mean(value, known)}")

    def _missing(self, instead: str) -> str:
        """Why there is no term: ``instead`` is there instead."""
        if not instead:
            return 'it ends too early'
        if instead == ')' and self._at:
            return f"a variable is missing after '{self._tokens[self._at - 1]}'"
        return f"a variable is expected, not '{instead}'"

    def _peek(self, ahead: int = 0) -> str:
        place = self._at + ahead
        return self._tokens[place] if place < len(self._tokens) else ''

    def _taken(self, token: str) -> bool:
        taken = self._peek() == token
        self._at += taken
        return taken

    def _expect(self, token: str) -> None:
        if not self._taken(token):
            raise self._error(
                f"'{token}' is missing" + (f" before '{self._peek()}'" if self._peek() else ' at the end')
            )

    def _deeper(self, levels: int) -> None:
        self._depth += levels
        if self._depth > MAX_DEPTH:
            raise self._error(f'it is nested more than {MAX_DEPTH} levels deep')

    def _error(self, reason: str) -> FormulaError:
        return FormulaError(self._text, reason)
