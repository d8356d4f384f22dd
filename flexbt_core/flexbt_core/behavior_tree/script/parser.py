# SPDX-License-Identifier: BSD-3-Clause
"""Lexer and parser of the scripting language of BehaviorTree.CPP 4.10: from text to a syntax tree.

A script is a list of expressions; the semicolons between them may be left out or repeated. Operators, from those that
bind loosest to those that bind tightest::

    := = += -= *= /=     assignment; the right side is any expression, so x := y := 3 assigns both
    a ? b : c
    ||
    &&
    == != < > <= >=      a < b < c means that both hold
    | ^
    &
    + - ..
    * /
    - ~ !                before an operand
"""

from __future__ import annotations

import re
from enum import Enum
from typing import Final, NamedTuple, TypeAlias

from flexbt_core.behavior_tree.model.errors import ConversionError, ScriptError
from flexbt_core.behavior_tree.model.ports import decimal

MAX_SCRIPT_DEPTH: Final = 200
"""Maximum nesting of expressions: each level is one nested call when a script runs."""


MAX_TOKENS: Final = 10_000
"""Maximum number of tokens of a script.

Scripts have no loops, so this bounds their operations: each tick ends, and a stopped run ends too.
"""


class Constant(NamedTuple):
    """A number or a text. ``true`` and ``false`` are 1.0 and 0.0."""

    offset: int
    value: int | float | str


class Name(NamedTuple):
    """The value of an enum constant or, if none has this name, of a blackboard entry."""

    offset: int
    name: str


class Unary(NamedTuple):
    offset: int
    operator: str
    operand: Expression


class Binary(NamedTuple):
    offset: int
    operator: str
    left: Expression
    right: Expression


class Comparison(NamedTuple):
    """Operands with the operators between them; ``offsets`` are those of the operators."""

    offsets: tuple[int, ...]
    operators: tuple[str, ...]
    operands: tuple[Expression, ...]


class Conditional(NamedTuple):
    offset: int
    condition: Expression
    then: Expression
    otherwise: Expression


class Assignment(NamedTuple):
    """An assignment. ``target`` is a blackboard key, even if an enum constant has the same name."""

    offset: int
    operator: str
    target: str
    value: Expression


Expression: TypeAlias = Constant | Name | Unary | Binary | Comparison | Conditional | Assignment

_ASSIGNMENT: Final = 2
_CONDITIONAL: Final = 4
_COMPARISON: Final = 10
_UNARY: Final = 20
# Precedence of each operator between two operands.
_BINDING: Final = {
    **dict.fromkeys((':=', '=', '+=', '-=', '*=', '/='), _ASSIGNMENT),
    '?': _CONDITIONAL,
    '||': 6,
    '&&': 8,
    **dict.fromkeys(('==', '!=', '<', '>', '<=', '>='), _COMPARISON),
    **dict.fromkeys('|^', 12),
    '&': 14,
    **dict.fromkeys(('+', '-', '..'), 16),
    **dict.fromkeys('*/', 18),
}


def parse_script(script: str) -> tuple[Expression, ...]:
    """Return the statements of a script; none for the empty string.

    Raises ScriptError at the first error, and for a script of blanks only.
    """
    return _Parser(script).parse() if script else ()


def is_assigning(script: str) -> bool:
    """Return whether a script assigns to an entry, also within an expression. Raises ScriptError, as tokenize does."""
    return any(
        token.kind is TokenKind.OPERATOR and _BINDING.get(str(token.value)) == _ASSIGNMENT for token in tokenize(script)
    )


class _Parser:
    def __init__(self, script: str) -> None:
        self._script = script
        self._tokens = tokenize(script)
        self._position = 0
        self._depth = 0

    def parse(self) -> tuple[Expression, ...]:
        if len(self._tokens) > MAX_TOKENS:
            raise ScriptError(
                self._script,
                self._tokens[MAX_TOKENS].offset,
                f'the script continues after {MAX_TOKENS} tokens, which is the limit; divide it',
            )
        if self._peek().kind is TokenKind.END:
            raise self._error('the script is empty')
        statements: list[Expression] = []
        while self._peek().kind is not TokenKind.END:
            statements.append(self._expression(0))
            while self._at(';'):
                self._position += 1
        return tuple(statements)

    # -- tokens ------------------------------------------------------------------------------------------------------

    def _peek(self) -> Token:
        return self._tokens[self._position]

    def _at(self, operator: str) -> bool:
        token = self._peek()
        return token.kind is TokenKind.OPERATOR and token.value == operator

    def _take(self) -> Token:
        token = self._peek()
        self._position += 1
        return token

    def _expect(self, operator: str, what: str) -> None:
        if not self._at(operator):
            raise self._error(f"'{operator}' is missing here, {what}; found {self._peek()}")
        self._position += 1

    def _error(self, reason: str, token: Token | None = None) -> ScriptError:
        return ScriptError(self._script, (token or self._peek()).offset, reason)

    # -- expressions -------------------------------------------------------------------------------------------------

    def _expression(self, least: int) -> Expression:
        """Return an expression whose operators have at least the precedence ``least``."""
        outer = self._depth
        self._deepen()
        left = self._operand()
        while True:
            token = self._peek()
            binding = _BINDING.get(str(token.value)) if token.kind is TokenKind.OPERATOR else None
            if binding is None or binding < least:
                break
            # The left side becomes part of the new expression, so every operator adds a level.
            self._deepen()
            if binding == _ASSIGNMENT:
                left = self._assignment(left)
                break
            if binding == _CONDITIONAL:
                left = self._conditional(left)
                break
            if binding == _COMPARISON:
                left = self._comparison(left)
            else:
                self._position += 1
                left = Binary(token.offset, str(token.value), left, self._expression(binding + 1))
        self._depth = outer
        return left

    def _deepen(self) -> None:
        self._depth += 1
        if self._depth > MAX_SCRIPT_DEPTH:
            raise self._error(f'the script is nested more than {MAX_SCRIPT_DEPTH} deep; use several statements')

    def _operand(self) -> Expression:
        token = self._take()
        if token.kind is TokenKind.NAME:
            return Name(token.offset, str(token.value))
        if token.kind in (TokenKind.NUMBER, TokenKind.TEXT):
            return Constant(token.offset, token.value)
        if token.kind is TokenKind.OPERATOR:
            if token.value == '(':
                inner = self._expression(0)
                self._expect(')', f'to close the parenthesis at column {token.offset + 1}')
                return inner
            if token.value in ('-', '~', '!'):
                return Unary(token.offset, str(token.value), self._expression(_UNARY))
        raise self._error(f'a value is missing here: a number, a name or a text; found {token}', token)

    def _assignment(self, left: Expression) -> Expression:
        token = self._take()
        if not isinstance(left, Name):
            raise self._error(f"'{token.value}' needs the name of a blackboard entry on its left; compare by ==", token)
        return Assignment(token.offset, str(token.value), left.name, self._expression(0))

    def _conditional(self, condition: Expression) -> Expression:
        token = self._take()
        then = self._expression(0)
        self._expect(':', f"to go with the '?' at column {token.offset + 1}")
        return Conditional(token.offset, condition, then, self._expression(_CONDITIONAL))

    def _comparison(self, first: Expression) -> Expression:
        offsets: list[int] = []
        operators: list[str] = []
        operands = [first]
        while self._peek().kind is TokenKind.OPERATOR and _BINDING.get(str(self._peek().value)) == _COMPARISON:
            token = self._take()
            offsets.append(token.offset)
            operators.append(str(token.value))
            operands.append(self._expression(_COMPARISON + 1))
        return Comparison(tuple(offsets), tuple(operators), tuple(operands))


# The tokens of the scripting language of BehaviorTree.CPP 4.10.


class TokenKind(Enum):
    """The kind of a token; the value is its name in errors."""

    NUMBER = 'a number'
    TEXT = 'a text'
    NAME = 'a name'
    OPERATOR = 'an operator'
    END = 'the end of the script'


class Token(NamedTuple):
    """A token. ``value`` is the value of a literal, otherwise the characters. ``offset`` counts from 0."""

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
# Characters that cannot follow a number directly. Two dots are an operator, but not after a hexadecimal number, as in
# BehaviorTree.CPP.
_AFTER_DECIMAL = re.compile(r'[A-Za-z0-9_@]|\.(?!\.)')
_AFTER_REAL = re.compile(r'[A-Za-z0-9_@]')
_AFTER_HEXADECIMAL = re.compile(r'[A-Za-z0-9_@.]')
_WORD = re.compile(r'[\w.@]+')

_LARGEST: Final = 2**63 - 1
_BOOLEANS: Final = {'true': 1.0, 'false': 0.0}


def tokenize(script: str) -> list[Token]:
    """Return the tokens of a script, the end token last.

    Raises ScriptError at the first position without a valid token.
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
        raise ScriptError(script, match.start(), f"'{word.group()}' is not a number; write 12, 0.5, 1e3 or 0x1F")


def _integer(script: str, match: re.Match[str], digits: str, base: int) -> int:
    # int() rejects numbers with very many digits, or is slow on them.
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
