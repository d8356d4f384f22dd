# SPDX-License-Identifier: BSD-3-Clause
"""Goals as users write them, ``(on(cup, table) | on(mug, table)) & not open(door)``, as alternatives of literals."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Final

from flexbt_core.values.text import truncate_middle
from flexbt_formal.grammar import Grammar, GrammarError, SyntaxTree

from .problem import Condition, PlanningError

Alternatives = tuple[tuple[str, ...], ...]

_MOST: Final = 1000
"""Maximum number of literals of a goal, and of its expanded alternatives. Practical goals have some tens."""

_WORD: Final = r'(?<![^\s()&|!]){}(?![^\s()&|!])'
_AND, _OR, _NOT = (_WORD.format(word) for word in ('and', 'or', 'not'))
_GRAMMAR: Final = Grammar(
    rf"""
    start: either
    ?either: both (_OR both)*
    ?both: one (_AND one)*
    ?one: LITERAL -> literal | _NOT one -> opposite | "(" either ")"
    _AND: /&&?|{_AND}/
    _OR: /\|\|?|{_OR}/
    _NOT: /!(?!=)|{_NOT}/
    LITERAL: /(?!\s)(?:(?!{_AND}|{_OR}|{_NOT})(?:[^&|()!]|!=))+(?:\([^()]*\))?/
    %ignore /\s+/
    """,
    {'LITERAL': 'a literal, such as on(cup, table),'},
    '& or |',
    longest=100_000,
    deepest=200,
)


def parse_goal(text: str) -> Alternatives:
    """Return the alternatives of a goal, each a set of literals that must all hold.

    ``&`` (or ``and``), ``|`` (or ``or``), ``!`` (or ``not``) and parentheses, as ``(on(cup, table) | held) & !shut``;
    ``&`` before ``|``. An alternative that contains all literals of another one is omitted.

    Raises:
        PlanningError: the text is not a goal, or too large: 100,000 characters, 1000 literals or alternatives.
    """
    try:
        tree = _GRAMMAR.parse(text)
        literals = list(tree.scan_values(lambda token: token.type == 'LITERAL'))
        if len(literals) > _MOST:
            raise GrammarError(literals[_MOST].start_pos + 1, f'more than {_MOST} literals')
        return _alternatives(tree.children[0], negated=False)
    except GrammarError as error:
        raise PlanningError(f'goal {truncate_middle(text, 200)!r}, {error}') from None


def conditions(alternatives: Iterable[Iterable[str]]) -> tuple[Condition, ...]:
    """Return alternatives as conditions."""
    return tuple(frozenset(one) for one in alternatives)


def _alternatives(tree: SyntaxTree, *, negated: bool) -> Alternatives:
    """Return the alternatives of a syntax tree, or of its negation, which exchanges ``&`` and ``|``."""
    if tree.data == 'literal':
        literal = str(tree.children[0]).strip()
        return ((_opposite(literal) if negated else literal,),)
    if tree.data == 'opposite':
        return _alternatives(tree.children[0], negated=not negated)
    parts = [_alternatives(part, negated=negated) for part in tree.children]
    return _all_of(parts) if (tree.data == 'both') is not negated else _least(itertools.chain.from_iterable(parts))


def _all_of(parts: list[Alternatives]) -> Alternatives:
    certain = tuple(literal for part in parts if len(part) == 1 for literal in part[0])
    found: Alternatives = (tuple(dict.fromkeys(certain)),)
    for part in parts:
        if len(part) > 1:
            found = _least(tuple(dict.fromkeys(one + other)) for one in found for other in part)
    return found


def _least(alternatives: Iterable[tuple[str, ...]]) -> Alternatives:
    """Return the alternatives that contain no other one."""
    written = {frozenset(one): one for one in itertools.islice(alternatives, _MOST * _MOST)}
    kept: dict[frozenset[str], tuple[str, ...]] = {}
    for one in sorted(written, key=len):
        if not any(other <= one for other in kept):
            kept[one] = written[one]
        if len(kept) > _MOST:
            raise GrammarError(1, f'more than {_MOST} alternatives when it is written out; ask for less at once')
    return tuple(one for key, one in written.items() if key in kept)


def _opposite(literal: str) -> str:
    """Return the negation of a literal."""
    if '(' not in literal and '=' in literal:
        return literal.replace('!=', '=') if '!=' in literal else literal.replace('=', '!=')
    return f'not {literal}'
