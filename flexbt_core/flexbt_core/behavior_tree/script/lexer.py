# SPDX-License-Identifier: BSD-3-Clause
"""The tokens of the scripting language of BehaviorTree.CPP 4.10."""

from __future__ import annotations

import re
from enum import Enum
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.model import ConversionError, ScriptError, decimal


class TokenKind(Enum):
    """What a token is; the value is how an error names it."""

    NUMBER = 'a number'
    TEXT = 'a text'
    NAME = 'a name'
    OPERATOR = 'an operator'
    END = 'the end of the script'


class Token(NamedTuple):
    """``value`` is what a literal means, otherwise the characters of the token. ``offset`` counts from 0."""

    kind: TokenKind
    value: int | float | str
    offset: int

    def __str__(self) -> str:
        return self.kind.value if self.kind is TokenKind.END else f"'{self.value}'"


_BLANKS = re.compile(r'[ \t\r\n]*')
_TOKEN = re.compile(
    r"""
    (?P<hexadecimal> 0[xX][0-9a-fA-F]* )
  | (?P<real>        [0-9]+ (?: \.[0-9]+ (?:[eE][+-]?[0-9]+)? | [eE][+-]?[0-9]+ ) )
  | (?P<decimal>     [0-9]+ )
  | (?P<name>        [A-Za-z_@][A-Za-z0-9_]* )
  | (?P<text>        '[^']*' )
  | (?P<operator>    \.\. | && | \|\| | [=!<>:+\-*/]= | [+\-*/&|^~!<>=?:();] )
    """,
    re.VERBOSE,
)
# What cannot follow a number directly. Two dots are an operator, but not after a hexadecimal number, as there.
_AFTER_DECIMAL = re.compile(r'[A-Za-z0-9_@]|\.(?!\.)')
_AFTER_REAL = re.compile(r'[A-Za-z0-9_@]')
_AFTER_HEXADECIMAL = re.compile(r'[A-Za-z0-9_@.]')
_WORD = re.compile(r'[\w.@]+')

_LARGEST: Final = 2**63 - 1
_BOOLEANS: Final = {'true': 1.0, 'false': 0.0}


def tokenize(script: str) -> list[Token]:
    """The tokens of a script, the last of which is its end.

    Raises ScriptError at the first place where there is no token.
    """
    tokens: list[Token] = []
    position = 0
    while True:
        blanks = _BLANKS.match(script, position)
        assert blanks is not None
        position = blanks.end()
        if position == len(script):
            tokens.append(Token(TokenKind.END, '', position))
            return tokens
        match = _TOKEN.match(script, position)
        if match is None:
            raise ScriptError(script, position, _why_no_token(script, position))
        tokens.append(_token(script, match))
        position = match.end()


def _token(script: str, match: re.Match[str]) -> Token:
    characters = match.group()
    offset = match.start()
    match match.lastgroup:
        case 'name':
            truth = _BOOLEANS.get(characters)
            if truth is not None:
                return Token(TokenKind.NUMBER, truth, offset)
            return Token(TokenKind.NAME, characters, offset)
        case 'text':
            return Token(TokenKind.TEXT, characters[1:-1], offset)
        case 'operator':
            return Token(TokenKind.OPERATOR, characters, offset)
        case 'real':
            _check_end(script, match, _AFTER_REAL)
            return Token(TokenKind.NUMBER, _real(script, match), offset)
        case 'decimal':
            _check_end(script, match, _AFTER_DECIMAL)
            return Token(TokenKind.NUMBER, _integer(script, match, characters, 10), offset)
        case _:
            _check_end(script, match, _AFTER_HEXADECIMAL)
            if len(characters) == 2:
                raise ScriptError(script, offset, f"'{characters}' has no digits")
            return Token(TokenKind.NUMBER, _integer(script, match, characters[2:], 16), offset)


def _check_end(script: str, match: re.Match[str], forbidden: re.Pattern[str]) -> None:
    if forbidden.match(script, match.end()) is not None:
        word = _WORD.match(script, match.start())
        assert word is not None
        raise ScriptError(script, match.start(), f"'{word.group()}' is no number; write 12, 0.5, 1e3 or 0x1F")


def _integer(script: str, match: re.Match[str], digits: str, base: int) -> int:
    # int() refuses, or takes long for, very many digits.
    significant = digits.lstrip('0') or '0'
    value = int(significant, base) if len(significant) <= 20 else _LARGEST + 1
    if value > _LARGEST:
        raise ScriptError(script, match.start(), f'the number {digits[:40]} does not fit into 64 bits')
    return value


def _real(script: str, match: re.Match[str]) -> float:
    try:
        return decimal(match.group())
    except ConversionError as error:
        raise ScriptError(script, match.start(), str(error)) from None


def _why_no_token(script: str, position: int) -> str:
    character = script[position]
    if character == "'":
        return "this text is not closed by another '"
    if character == '"':
        return "text is written between single quotes, as in 'text'"
    if character.isalpha():
        return f"names consist of ASCII letters, digits and _; '{character}' is none of them"
    return f"'{character}' means nothing in a script"
