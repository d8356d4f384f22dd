# SPDX-License-Identifier: BSD-3-Clause
"""The expressions of the models: a subset of ECMAScript, compiled to Python.

Arithmetic, comparison, ``&& || !``, ``a ? b : c``, members and indexes, literals of arrays and objects, ``Math``. We
wrote this compiler because the JavaScript engines on PyPI keep values on a separate heap: one call of them costs
100 times as much as an expression here.

A number is an int or a float as in Python: ``/`` returns a float. ``%`` has the sign of the dividend, as in ECMAScript.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from typing import Any, Final, NamedTuple

from lark import Token, Tree

from flexbt_core.values.text import truncate_middle
from flexbt_formal.grammar import Grammar, GrammarError, SyntaxTree

from .data_types import Record, element, length, member

_DIGITS: Final = 20


class ExpressionError(ValueError):
    """An expression that cannot be read or compiled."""


class Reference(NamedTuple):
    """An identifier, with the members that follow it by dots: ``_msg.pose.x``."""

    parts: tuple[str, ...]


class Literal(NamedTuple):
    value: Any


class Call(NamedTuple):
    """A call of an operator or function with its operands; also an array, or an object with its ``keys``."""

    name: str
    operands: tuple[Any, ...]
    keys: tuple[str, ...] = ()


Expression = Reference | Literal | Call

_RANDOM: Final = Call('random', ())

_GRAMMAR: Final = Grammar(
    r"""
    start: choice
    ?choice: either | either "?" choice ":" choice
    ?either: both | either OR both -> binary
    ?both: equality | both AND equality -> binary
    ?equality: order | equality EQUALITY order -> binary
    ?order: sum | order ORDER sum -> binary
    ?sum: product | sum SIGN product -> binary
    ?product: unary | product FACTOR unary -> binary
    ?unary: postfix | (SIGN | NOT) unary
    ?postfix: primary | postfix "." NAME -> member | postfix "[" choice "]" -> index | postfix "(" _list? ")" -> call
    ?primary: "(" choice ")" | "[" _list? "]" -> array | "{" (_members ","?)? "}" -> object
        | NUMBER -> number | TEXT -> text | NAME -> name
    _list: _values ","?
    _values: choice | _values "," choice
    _members: _member | _members "," _member
    _member: key ":" choice
    key: NAME | TEXT
    OR: "||"
    AND: "&&"
    EQUALITY: /[=!]==?/
    ORDER: /[<>]=?/
    SIGN: /[-+]/
    FACTOR: /[*\/%]/
    NOT: "!"
    NUMBER: /(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?/
    NAME: /[A-Za-z_$][\w$]*/
    TEXT: /"([^"\\]|\\.)*"|'([^'\\]|\\.)*'/s
    %ignore /\s+/
    """,
    {'NUMBER': 'a value', 'NAME': 'a name'},
    'an operator',
    longest=20_000,
    deepest=150,
)
_ESCAPES: Final = {'n': '\n', 't': '\t', 'r': '\r', 'b': '\b', 'f': '\f', '0': '\0'}
_REAL: Final = ('cos', 'exp', 'log', 'sin', 'sqrt', 'tan')
_WHOLE: Final = ('ceil', 'floor', 'trunc')
_FUNCTIONS: Final = dict.fromkeys((*_REAL, *_WHOLE, 'abs', 'round'), 1) | {'max': 0, 'min': 0, 'pow': 2, 'random': -1}
"""Functions of ``Math`` with their number of operands; 0: one or more; -1: none."""


def parse_expression(text: str) -> Expression:
    """Parse an expression. Raises ExpressionError."""
    try:
        return _by_lot(_expression(_GRAMMAR.parse(text).children[0]))
    except GrammarError as error:
        shown = truncate_middle(text.strip())
        raise ExpressionError(f'{error} in the expression [{shown}]') from None


def _expression(tree: SyntaxTree) -> Any:
    """Return the expression, or the name of a member, for a part of a syntax tree."""
    parts: tuple[Any, ...] = tuple(_expression(part) if isinstance(part, Tree) else part for part in tree.children)
    match tree.data, parts:
        case 'number', (Token() as digits,):
            return Literal(_number(digits))
        case 'text', (text,):
            return Literal(_unquoted(text))
        case 'key', (Token(type='TEXT') as text,):
            return _unquoted(text)
        case 'key', (name,):
            return str(name)
        case 'name', ('true' | 'false' as word,):
            return Literal(word == 'true')
        case 'name', (Token('True' | 'False') as word,):
            raise GrammarError(word.start_pos + 1, f'{word} is not a value; write {word.lower()}')
        case 'name', (name,):
            return Reference((str(name),))
        case 'choice', _:
            return Call('?', parts)
        case 'binary', (left, sign, right):
            return Call(sign[:2] if '=' in sign else str(sign), (left, right))
        case 'unary', ('-', Literal(int() | float() as value)) if not isinstance(value, bool):
            return Literal(-value)
        case 'unary', (sign, operand):
            return Call(f'unary {sign}', (operand,))
        case 'member', (Reference(names), name):
            return Reference((*names, str(name)))
        case 'member', (value, name):
            return Call('member', (value, Literal(str(name))))
        case 'index' | 'array' as name, _:
            return Call(name, parts)
        case 'object', _:
            return Call('object', parts[1::2], parts[::2])
    place = next(tree.scan_values(lambda _: True)).start_pos + 1
    return _call(parts[0], parts[1:], place)


def _call(called: Expression, operands: tuple[Expression, ...], place: int) -> Call:
    """Return the call of a function whose name begins at ``place``."""
    name = '.'.join(called.parts) if isinstance(called, Reference) else 'of this value'
    function = name.removeprefix('Math.')
    if function == name or function not in _FUNCTIONS:
        known = ', '.join(f'Math.{one}' for one in _FUNCTIONS)
        raise GrammarError(place, f'there is no function {name}; there are {known}')
    count = _FUNCTIONS[function]
    if len(operands) != max(count, 0) if count else not operands:
        raise GrammarError(place, f'{name} does not take {len(operands)} operands')
    return Call(function, operands)


def _unquoted(text: str) -> str:
    return re.sub(r'\\(.)', lambda match: _ESCAPES.get(match[1], match[1]), text[1:-1], flags=re.DOTALL)


def _number(token: Any) -> int | float:
    is_whole = token.isdigit()
    if (is_whole and len(token) > _DIGITS) or not math.isfinite(float(token)):
        raise GrammarError(token.start_pos + 1, 'the number is too large')
    return int(token) if is_whole else float(token)


# -- compiling -------------------------------------------------------------------------------------------------------

Evaluated = Callable[[Any, Any, Any], Any]
"""A function that returns the value from the data of an automaton, the parameters of the event, and their context."""

Resolver = Callable[[tuple[str, ...]], str]
"""A function that returns the Python code for a name, in terms of ``d`` (data), ``e`` (parameters) and ``b`` (context).
It may raise ExpressionError."""


def _remainder(left: Any, right: Any) -> Any:
    found = math.fmod(left, right)
    return int(found) if isinstance(left, int) and isinstance(right, int) else found


def _power(left: Any, right: Any) -> Any:
    found = math.pow(left, right)
    return int(found) if isinstance(left, int) and isinstance(right, int) and found.is_integer() else found


def _element_or_0(value: Any, index: Any) -> Any:
    try:
        return element(value, index)
    except (IndexError, TypeError):
        return 0


def _same(left: Any, right: Any) -> bool:
    """Return whether two values are equal; a text equals the sequence of its bytes, the form that properties use."""
    if isinstance(left, str) and isinstance(right, tuple):
        left = tuple(left.encode())
    elif isinstance(left, tuple) and isinstance(right, str):
        right = tuple(right.encode())
    return bool(left == right)


_CALLED: Final = (Record, abs, bool, element, _element_or_0, int, length, max, member, min, _power, _remainder, _same)
_SCOPE: Final[dict[str, Any]] = {'__builtins__': {}, 'math': math}
_SCOPE.update((function.__name__.removeprefix('_'), function) for function in _CALLED)
_BINARY: Final = {
    '||': '({} or {})',
    '&&': '({} and {})',
    '==': 'same({}, {})',
    '!=': '(not same({}, {}))',
    '%': 'remainder({}, {})',
    'element or 0': 'element_or_0({}, {})',
    'index': 'element({}, {})',
    'member': 'member({}, {})',
    'pow': 'power({}, {})',
    'whole by lot': 'b[1].whole({}, {})',
    **{sign: f'({{}} {sign} {{}})' for sign in ('<', '>', '<=', '>=', '+', '-', '*', '/')},
}
_UNARY: Final = {
    'unary -': '(-{})',
    'unary +': '(+{})',
    'unary !': '(not {})',
    'abs': 'abs({})',
    'below by lot': 'b[1].below({})',
    'round': 'int(math.floor({} + 0.5))',
    **{name: f'int(math.{name}({{}}))' for name in _WHOLE},
    **{name: f'math.{name}({{}})' for name in _REAL},
}


def _by_lot(expression: Expression) -> Expression:
    """Return the expression with separate draws for integers and Booleans made from a random number: ``floor(random *
    width + least)`` and ``random < bound``."""
    if not isinstance(expression, Call):
        return expression
    name, operands = expression.name, expression.operands
    if name in ('floor', 'round'):
        width, least = _spread(operands[0])
        if width is not None:
            least = Call('+', (least, Literal(0.5))) if name == 'round' else least
            return Call('whole by lot', (_by_lot(width), _by_lot(least)))
    if name in ('<', '<=', '>', '>=') and _RANDOM in operands:
        bound = operands[1] if operands[0] == _RANDOM else operands[0]
        below = Call('below by lot', (_by_lot(bound),))
        return below if (operands[0] == _RANDOM) is name.startswith('<') else Call('unary !', (below,))
    return expression._replace(operands=tuple(map(_by_lot, operands)))


def _spread(expression: Expression) -> tuple[Expression | None, Expression]:
    """Return width and least value of ``random * width + least``, in any order; the width is None for other
    expressions."""
    if isinstance(expression, Call) and expression.name in ('+', '*') and len(expression.operands) == 2:
        for one, other in (expression.operands, expression.operands[::-1]):
            if expression.name == '*' and one == _RANDOM:
                return other, Literal(0)
            if expression.name == '+':
                width, least = _spread(one)
                if width is not None:
                    return width, (other if least == Literal(0) else Call('+', (least, other)))
    return None, expression


LOTS: Final = ('random', 'whole by lot', 'below by lot')
"""Calls that return random values."""


def is_random(expression: Expression, calls: Collection[str] = LOTS[:1]) -> bool:
    """Return whether an expression draws random values by one of ``calls``; by default real numbers, which are too many
    to follow each."""
    if not isinstance(expression, Call):
        return False
    return expression.name in calls or any(is_random(one, calls) for one in expression.operands)


def references_in(expression: Expression) -> list[tuple[str, ...]]:
    """Return all names in an expression."""
    if isinstance(expression, Reference):
        return [expression.parts]
    operands = expression.operands if isinstance(expression, Call) else ()
    return [name for one in operands for name in references_in(one)]


def python_of(expression: Expression, resolve: Resolver) -> str:
    """Return the expression as Python code. Raises ExpressionError for an unknown name."""
    if isinstance(expression, Literal):
        return repr(expression.value)
    if isinstance(expression, Reference):
        return resolve(expression.parts)
    operands = [python_of(one, resolve) for one in expression.operands]
    if expression.name == 'array':
        return f'({"".join(f"{one}, " for one in operands)})'
    if expression.name == 'object':
        members = (f'({key!r}, {one}), ' for key, one in zip(expression.keys, operands, strict=True))
        return f'Record(({"".join(members)}))'
    if expression.name == '?':
        return '({1} if {0} else {2})'.format(*operands)
    if expression.name in ('min', 'max'):
        return f'{expression.name}(({", ".join(operands)},))'
    if expression.name == 'random':
        return 'b[1].real()'
    return (_UNARY.get(expression.name) or _BINARY[expression.name]).format(*operands)


def compiled(expression: Expression, resolve: Resolver) -> Evaluated:
    """Return a function that evaluates the expression. Raises ExpressionError."""
    # Safe: the code consists of parsed parts only: operators, literals by their repr, and names as tuple indexes.
    text = f'lambda d, e, b: {python_of(expression, resolve)}'
    try:
        function: Evaluated = eval(compile(text, '<model>', 'eval'), _SCOPE)  # noqa: S307
    except SyntaxError as error:  # the only possible error: parentheses are nested too deeply
        raise ExpressionError(f'the expression cannot be compiled: {error.msg}') from None
    return function


def constant(expression: Expression) -> Any:
    """Return the value of an expression without names. Raises ExpressionError."""

    def resolve(parts: tuple[str, ...]) -> str:
        raise ExpressionError(f'{".".join(parts)} is not known here: only literals are allowed')

    try:
        return compiled(expression, resolve)((), (), ())
    except (ArithmeticError, TypeError, LookupError, ValueError) as error:
        raise ExpressionError(f'it has no value: {error}') from error
