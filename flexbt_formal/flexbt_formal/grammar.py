# SPDX-License-Identifier: BSD-3-Clause
"""Grammars of the languages that people write goals, formulas and expressions in. The parser is lark's.

lark is imported when the first text is parsed: a BT server that can plan starts without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Final

SyntaxTree = Any
"""A lark.Tree, whose children are trees and tokens: the types that lark declares lack the tokens' places."""

_CLOSING: Final = {'(': ')', '[': ']', '{': '}', '?': ':'}


class GrammarError(ValueError):
    """A text that does not follow a grammar: the reason, and the number of the character where it fails, from 1."""

    def __init__(self, character: int, reason: str) -> None:
        self.character = character
        self.reason = reason
        super().__init__(f'character {character}: {reason}')


class Grammar:
    """A grammar in the notation of lark, with the words for its error messages.

    Args:
        rules: the grammar; a text is parsed by its rule ``start``.
        operands: what is missing where a terminal is expected, by the terminal; the first that fits is reported.
        operator: what is missing between two operands.
        longest: maximum number of characters in a text.
        deepest: maximum number of nodes from the root of a tree to a leaf, so that recursive readers are safe.
    """

    def __init__(self, rules: str, operands: Mapping[str, str], operator: str, *, longest: int, deepest: int) -> None:
        self._rules = rules
        self._operands = operands
        self._operator = operator
        self._longest = longest
        self._deepest = deepest

    @cached_property
    def _parser(self) -> Any:
        from lark import Lark

        return Lark(self._rules, parser='lalr', maybe_placeholders=False)

    def parse(self, text: str) -> SyntaxTree:
        """Return the syntax tree of a text. Raises GrammarError."""
        from lark.exceptions import UnexpectedCharacters, UnexpectedToken

        if len(text) > self._longest:
            raise GrammarError(self._longest, f'more than {self._longest:,} characters')
        try:
            tree: SyntaxTree = self._parser.parse(text)
        except UnexpectedCharacters as error:
            place = error.pos_in_stream
            raise GrammarError(place + 1, f'unexpected {text[place]!r}') from None
        except UnexpectedToken as error:
            raise self._problem(error, len(text.rstrip())) from None
        depths: dict[int, int] = {}
        for node in tree.iter_subtrees():  # children come before their parents
            depths[id(node)] = 1 + max((depths.get(id(child), 0) for child in node.children), default=0)
        if depths[id(tree)] > self._deepest:
            raise GrammarError(1, f'nested more than {self._deepest} levels deep')
        return tree

    def _problem(self, error: Any, end: int) -> GrammarError:
        found = str(error.token)
        place = (error.token.start_pos if found else end) + 1
        read = error.state.value_stack
        missing = next((what for terminal, what in self._operands.items() if terminal in error.expected), None)
        if missing is not None:
            where = f"after '{read[-1]}'" if read else 'at the beginning'
            return GrammarError(place, f'{missing} is missing {where}')
        opening: Any = next((one for one in reversed(read) if isinstance(one, str) and one in _CLOSING), None)
        if opening is not None and (not found or found in _CLOSING.values()):
            return GrammarError(opening.start_pos + 1, f"'{opening}' is not closed by '{_CLOSING[opening]}'")
        if found in _CLOSING.values():
            wanted = next(sign for sign, closing in _CLOSING.items() if closing == found)
            return GrammarError(place, f"'{found}' without '{wanted}'")
        return GrammarError(place, f"{self._operator} is missing before '{found}'")
