# SPDX-License-Identifier: BSD-3-Clause
"""A goal as somebody writes it, ``(on(cup, table) | on(mug, table)) & not open(door)``, as alternatives of literals."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from typing import Final, NamedTuple

from flexbt_core.values.text import short_repr, truncate_middle

from .problem import Condition, PlanningError

Alternatives = tuple[tuple[str, ...], ...]

_MOST: Final = 1000
"""Literals of a goal, and alternatives when it is written out. What can be planned for has some tens."""
_DEEPEST: Final = 100
_LONGEST: Final = 100_000
"""Characters."""

_WORD: Final = r'(?<![^\s()&|!]){}(?![^\s()&|!])'
_AND, _OR, _NOT = (_WORD.format(word) for word in ('and', 'or', 'not'))
_TOKEN: Final = re.compile(
    rf'\s*(?:(?P<AND>&&?|{_AND})|(?P<OR>\|\|?|{_OR})|(?P<NOT>!(?!=)|{_NOT})|(?P<OPEN>\()|(?P<CLOSE>\))'
    rf'|(?P<LITERAL>(?:(?!{_AND}|{_OR}|{_NOT})(?:[^&|()!]|!=))+(?:\([^()]*\))?))'
)


class _Token(NamedTuple):
    kind: str
    text: str
    place: int
    """Of its first character, from 1."""


def parse_goal(text: str) -> Alternatives:
    """Return the alternatives of a goal, each with literals that have to hold at once.

    ``&`` (or ``and``), ``|`` (or ``or``), ``!`` (or ``not``) and parentheses, as ``(on(cup, table) | held) & !shut``;
    ``&`` before ``|``. Alternatives that say no less than another one are left out.

    Raises:
        PlanningError: it is no goal, or too long: 1000 literals, alternatives, or 100 parentheses within each other.
    """
    return _Reader(text).read()


def conditions(alternatives: Iterable[Iterable[str]]) -> tuple[Condition, ...]:
    """Alternatives as conditions."""
    return tuple(frozenset(one) for one in alternatives)


class _Reader:
    """Reads by descent. What is negated is read with the signs of literals, ``&`` and ``|`` turned round."""

    def __init__(self, text: str) -> None:
        self._text = text
        if len(text) > _LONGEST:
            raise self._error(_LONGEST, f'more than {_LONGEST:,} characters; ask for less at once')
        self._tokens = list(self._split())
        self._at = 0
        self._depth = 0

    def _split(self) -> Iterable[_Token]:
        text = self._text.rstrip()
        place = literals = 0
        while place < len(text):
            found = _TOKEN.match(text, place)
            kind = None if found is None else found.lastgroup
            if found is None or kind is None:
                raise self._error(place + 1, f'{text[place]!r} cannot stand here')
            literals += kind == 'LITERAL'
            if literals > _MOST:
                raise self._error(found.start(kind) + 1, f'more than {_MOST} literals; ask for less at once')
            yield _Token(kind, found[kind].strip(), found.start(kind) + 1)
            place = found.end()
        yield _Token('END', 'the end', len(text) + 1)

    def read(self) -> Alternatives:
        found = self._any(negated=False)
        token = self._tokens[self._at]
        if token.kind == 'CLOSE':
            raise self._error(token.place, "')' without '('")
        if token.kind == 'OPEN':
            raise self._error(token.place, "& or | is missing before '(', or what stands in it are no arguments")
        if token.kind != 'END':
            raise self._error(token.place, f'& or | is missing before {short_repr(token.text)}')
        return found

    def _any(self, *, negated: bool) -> Alternatives:
        """Return what stands between ``|``."""
        parts = [self._all(negated=negated)]
        while self._next('OR'):
            parts.append(self._all(negated=negated))
        return self._both(parts) if negated else self._either(parts)

    def _all(self, *, negated: bool) -> Alternatives:
        """Return what stands between ``&``."""
        parts = [self._one(negated=negated)]
        while self._next('AND'):
            parts.append(self._one(negated=negated))
        return self._either(parts) if negated else self._both(parts)

    def _one(self, *, negated: bool) -> Alternatives:
        while self._next('NOT'):
            negated = not negated
        token = self._tokens[self._at]
        if self._next('LITERAL'):
            return ((_opposite(token.text) if negated else token.text,),)
        if not self._next('OPEN'):
            raise self._error(
                token.place,
                f'a literal is missing before {token.text if token.kind == "END" else repr(token.text)}; write it as '
                '(on(cup, table) | on(mug, table)) & not open(door)',
            )
        self._depth += 1
        if self._depth > _DEEPEST:
            raise self._error(token.place, f'more than {_DEEPEST} parentheses within each other')
        inner = self._any(negated=negated)
        self._depth -= 1
        if not self._next('CLOSE'):
            raise self._error(token.place, "'(' is not closed")
        return inner

    def _next(self, kind: str) -> bool:
        """Return whether this comes next; then it is read."""
        is_next = self._tokens[self._at].kind == kind
        self._at += is_next
        return is_next

    def _either(self, parts: list[Alternatives]) -> Alternatives:
        return self._least(itertools.chain.from_iterable(parts))

    def _both(self, parts: list[Alternatives]) -> Alternatives:
        certain = tuple(literal for part in parts if len(part) == 1 for literal in part[0])
        found: Alternatives = (tuple(dict.fromkeys(certain)),)
        for part in parts:
            if len(part) > 1:
                found = self._least(tuple(dict.fromkeys(one + other)) for one in found for other in part)
        return found

    def _least(self, alternatives: Iterable[tuple[str, ...]]) -> Alternatives:
        """Without those of which another one says a part."""
        written = {frozenset(one): one for one in itertools.islice(alternatives, _MOST * _MOST)}
        kept: dict[frozenset[str], tuple[str, ...]] = {}
        for one in sorted(written, key=len):
            if not any(other <= one for other in kept):
                kept[one] = written[one]
            if len(kept) > _MOST:
                place = self._tokens[self._at].place
                raise self._error(place, f'more than {_MOST} alternatives when it is written out; ask for less at once')
        return tuple(one for key, one in written.items() if key in kept)

    def _error(self, place: int, what: str) -> PlanningError:
        return PlanningError(f'goal {truncate_middle(self._text, 200)!r}, character {place}: {what}')


def _opposite(literal: str) -> str:
    """Return what holds where a literal does not."""
    if '(' not in literal and '=' in literal:
        return literal.replace('!=', '=') if '!=' in literal else literal.replace('=', '!=')
    return f'not {literal}'
