# SPDX-License-Identifier: BSD-3-Clause
"""The expressions of the models: a subset of ECMAScript, compiled to Python.

Arithmetic, comparison, ``&& || !``, ``a ? b : c``, members and indexes, literals of arrays and objects, ``Math``. Own
code: what there is on PyPI are whole engines for JavaScript, whose values live on a heap of their own (a call costs
100 times as much as an expression here), and parsers that have not been kept since 2018.

A number is an int or a float as in Python: ``/`` gives a float, ``%`` has the sign of the dividend, as in ECMAScript.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final, NamedTuple

from flexbt_core.values.text import truncate_middle

from .data_types import Record, element, length, member

MAX_LENGTH: Final = 20_000
MAX_DEPTH: Final = 60
_DIGITS: Final = 20


class ExpressionError(ValueError):
    """An expression that cannot be read; what is wrong, and where in it."""


class Reference(NamedTuple):
    """An identifier, with the members that follow it by dots: ``_msg.pose.x``."""

    parts: tuple[str, ...]


class Literal(NamedTuple):
    value: Any


class Call(NamedTuple):
    """An operator or a function, by its name, with its operands."""

    name: str
    operands: tuple[Any, ...]


class Array(NamedTuple):
    elements: tuple[Any, ...]


class Object(NamedTuple):
    members: tuple[tuple[str, Any], ...]


Expression = Reference | Literal | Call | Array | Object

_RANDOM: Final = Call('random', ())

_TOKEN: Final = re.compile(
    r'\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_$][\w$]*)'
    r'|(?P<text>"(?:[^"\\]|\\.)*"|\'(?:[^\'\\]|\\.)*\')'
    r'|(?P<sign>===|!==|==|!=|<=|>=|&&|\|\||[-+*/%<>!()\[\]{},.:?]))',
    re.DOTALL,
)
_ESCAPES: Final = {'n': '\n', 't': '\t', 'r': '\r', 'b': '\b', 'f': '\f', '0': '\0'}
_LEVELS: Final = (('||',), ('&&',), ('==', '!=', '===', '!=='), ('<', '>', '<=', '>='), ('+', '-'), ('*', '/', '%'))
_FUNCTIONS: Final = {
    'abs': 1,
    'ceil': 1,
    'cos': 1,
    'exp': 1,
    'floor': 1,
    'log': 1,
    'max': 0,
    'min': 0,
    'pow': 2,
    'random': -1,
    'round': 1,
    'sin': 1,
    'sqrt': 1,
    'tan': 1,
    'trunc': 1,
}
"""Of ``Math``, with the number of operands; 0: one or more; -1: none."""


def parse_expression(text: str) -> Expression:
    """Raise ExpressionError."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f'the expression has {len(text)} characters; the limit is {MAX_LENGTH}')
    return _by_lot(_Parser(text).whole())


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens: list[tuple[str, str, int]] = []
        position = 0
        end = len(text.rstrip())
        while position < end:
            match = _TOKEN.match(text, position)
            if match is None:
                at = position + len(text[position:]) - len(text[position:].lstrip())
                raise self._error(f'unexpected {text[at]!r}', at)
            kind = match.lastgroup or ''
            self._tokens.append((kind, match.group(kind), match.start(kind)))
            position = match.end()
        self._at = 0
        self._depth = 0

    def whole(self) -> Expression:
        if not self._tokens:
            raise ExpressionError('the expression is empty')
        found = self._choice()
        if self._at < len(self._tokens):
            raise self._error(f'unexpected {self._tokens[self._at][1]!r}', self._tokens[self._at][2])
        return found

    def _error(self, what: str, position: int) -> ExpressionError:
        return ExpressionError(
            f'{what} at character {position + 1} of the expression [{truncate_middle(self._text.strip())}]'
        )

    def _peek(self) -> str:
        """Return the sign that comes next; '' for anything else."""
        if self._at < len(self._tokens) and self._tokens[self._at][0] == 'sign':
            return self._tokens[self._at][1]
        return ''

    def _take(self, sign: str) -> bool:
        found = self._peek() == sign
        self._at += found
        return found

    def _need(self, sign: str) -> None:
        if not self._take(sign):
            found, position = ('the end', len(self._text))
            if self._at < len(self._tokens):
                found, position = repr(self._tokens[self._at][1]), self._tokens[self._at][2]
            raise self._error(f'{found} where {sign!r} is needed', position)

    def _choice(self) -> Expression:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionError(f'the expression is nested more than {MAX_DEPTH} deep')
        condition = self._binary(0)
        if self._take('?'):
            first = self._choice()
            self._need(':')
            condition = Call('?', (condition, first, self._choice()))
        self._depth -= 1
        return condition

    def _binary(self, level: int) -> Expression:
        if level == len(_LEVELS):
            return self._unary()
        left = self._binary(level + 1)
        while self._peek() in _LEVELS[level]:
            sign = self._peek()
            self._at += 1
            left = Call(sign[:2] if '=' in sign else sign, (left, self._binary(level + 1)))
        return left

    def _unary(self) -> Expression:
        signs = []
        while self._peek() in ('-', '+', '!'):
            signs.append(self._peek())
            self._at += 1
        found = self._postfix()
        for sign in reversed(signs):
            if isinstance(found, Literal) and sign == '-' and type(found.value) in (int, float):
                found = Literal(-found.value)
            else:
                found = Call(f'unary {sign}', (found,))
        return found

    def _postfix(self) -> Expression:
        found = self._primary()
        while True:
            if self._take('.'):
                if self._at >= len(self._tokens) or self._tokens[self._at][0] != 'name':
                    raise self._error('a name is missing after the dot', self._tokens[self._at - 1][2])
                name = self._tokens[self._at][1]
                self._at += 1
                if isinstance(found, Reference):
                    found = Reference((*found.parts, name))
                else:
                    found = Call('member', (found, Literal(name)))
            elif self._take('['):
                index = self._choice()
                self._need(']')
                found = Call('index', (found, index))
            elif self._peek() == '(' and isinstance(found, Reference):
                found = self._call(found)
            else:
                return found

    def _call(self, name: Reference) -> Expression:
        position = self._tokens[self._at][2]
        operands = self._list('(', ')')
        count = _FUNCTIONS.get(name.parts[1]) if len(name.parts) == 2 and name.parts[0] == 'Math' else None
        if count is None:
            known = ', '.join(f'Math.{one}' for one in _FUNCTIONS)
            raise self._error(f'there is no function {".".join(name.parts)}; there are {known}', position)
        if len(operands) != max(count, 0) if count else not operands:
            raise self._error(f'{".".join(name.parts)} does not take {len(operands)} operands', position)
        return Call(name.parts[1], operands)

    def _list(self, opening: str, closing: str) -> tuple[Expression, ...]:
        self._need(opening)
        found: list[Expression] = []
        while not self._take(closing):
            found.append(self._choice())
            if not self._take(','):
                self._need(closing)
                break
        return tuple(found)

    def _primary(self) -> Expression:
        if self._at >= len(self._tokens):
            raise self._error('the expression ends where a value is needed', len(self._text))
        kind, text, position = self._tokens[self._at]
        if kind == 'number':
            self._at += 1
            return Literal(self._number(text, position))
        if kind == 'text':
            self._at += 1
            return Literal(
                re.sub(r'\\(.)', lambda match: _ESCAPES.get(match[1], match[1]), text[1:-1], flags=re.DOTALL)
            )
        if kind == 'name':
            self._at += 1
            if text in ('True', 'False'):
                raise self._error(f'{text} is no value; write {text.lower()}', position)
            return Literal(text == 'true') if text in ('true', 'false') else Reference((text,))
        if text == '(':
            self._at += 1
            found = self._choice()
            self._need(')')
            # What stands in brackets takes members as any value does.
            return found
        if text == '[':
            return Array(self._list('[', ']'))
        if text == '{':
            return self._object()
        raise self._error(f'unexpected {text!r}', position)

    def _number(self, text: str, position: int) -> int | float:
        value = int(text) if text.isdigit() and len(text) <= _DIGITS else float(text)
        if not math.isfinite(value) or (text.isdigit() and len(text) > _DIGITS):
            raise self._error('the number is too large', position)
        return value

    def _object(self) -> Expression:
        self._need('{')
        members: list[tuple[str, Expression]] = []
        while not self._take('}'):
            kind, text, position = self._tokens[self._at] if self._at < len(self._tokens) else ('', 'the end', 0)
            if kind not in ('name', 'text'):
                raise self._error(f'{text!r} where the name of a member is needed', position)
            self._at += 1
            self._need(':')
            members.append((text[1:-1] if kind == 'text' else text, self._choice()))
            if not self._take(','):
                self._need('}')
                break
        return Object(tuple(members))


# -- compiling -------------------------------------------------------------------------------------------------------

Evaluated = Callable[[Any, Any, Any], Any]
"""Gives the value, of the data of an automaton, the parameters of the event at hand, and what is around them."""

Resolver = Callable[[tuple[str, ...]], str]
"""Gives the Python that a name means, of ``d`` (data), ``e`` (parameters) and ``b`` (around). Raises
ExpressionError."""


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
    """Equality; a text equals the sequence of its bytes, as properties write it."""
    if isinstance(left, str) and isinstance(right, tuple):
        left = tuple(left.encode())
    elif isinstance(left, tuple) and isinstance(right, str):
        right = tuple(right.encode())
    return bool(left == right)


_SCOPE: Final[dict[str, Any]] = {
    '__builtins__': {},
    'Record': Record,
    'abs': abs,
    'bool': bool,
    'element': element,
    'element_or_0': _element_or_0,
    'int': int,
    'length': length,
    'math': math,
    'max': max,
    'member': member,
    'min': min,
    'power': _power,
    'remainder': _remainder,
    'same': _same,
}
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
    **{name: f'int(math.{name}({{}}))' for name in ('floor', 'ceil', 'trunc')},
    **{name: f'math.{name}({{}})' for name in ('cos', 'exp', 'log', 'sin', 'sqrt', 'tan')},
}


def _by_lot(expression: Expression) -> Expression:
    """Return the expression, in which whole numbers and truths that are made of a random number are draws of their own:
    ``floor(random * width + least)`` and ``random < bound``."""
    if isinstance(expression, Array):
        return Array(tuple(map(_by_lot, expression.elements)))
    if isinstance(expression, Object):
        return Object(tuple((key, _by_lot(value)) for key, value in expression.members))
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
    return Call(name, tuple(map(_by_lot, operands)))


def _spread(expression: Expression) -> tuple[Expression | None, Expression]:
    """Width and least value of what is ``random * width + least``, in any order; no width: it is something else."""
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
"""Calls that draw by lot."""


def is_random(expression: Expression, calls: Collection[str] = LOTS[:1]) -> bool:
    """Return whether it draws by lot: real numbers, of which there are too many to follow each, or by one of
    ``calls``."""
    inner: tuple[Any, ...] = ()
    if isinstance(expression, Call):
        if expression.name in calls:
            return True
        inner = expression.operands
    elif isinstance(expression, Array):
        inner = expression.elements
    elif isinstance(expression, Object):
        inner = tuple(value for _, value in expression.members)
    return any(is_random(one, calls) for one in inner)


def references_in(expression: Expression) -> list[tuple[str, ...]]:
    """Return all names of an expression."""
    if isinstance(expression, Reference):
        return [expression.parts]
    inner: tuple[Any, ...] = ()
    if isinstance(expression, Call):
        inner = expression.operands
    elif isinstance(expression, Array):
        inner = expression.elements
    elif isinstance(expression, Object):
        inner = tuple(value for _, value in expression.members)
    return [name for one in inner for name in references_in(one)]


def python_of(expression: Expression, resolve: Resolver) -> str:
    """Return the expression as Python. Raises ExpressionError for a name that means nothing."""
    if isinstance(expression, Literal):
        return repr(expression.value)
    if isinstance(expression, Reference):
        return resolve(expression.parts)
    if isinstance(expression, Array):
        return f'({"".join(python_of(one, resolve) + ", " for one in expression.elements)})'
    if isinstance(expression, Object):
        return f'Record(({"".join(f"({key!r}, {python_of(value, resolve)}), " for key, value in expression.members)}))'
    operands = [python_of(one, resolve) for one in expression.operands]
    if expression.name == '?':
        return '({1} if {0} else {2})'.format(*operands)
    if expression.name in ('min', 'max'):
        return f'{expression.name}(({", ".join(operands)},))'
    if expression.name == 'random':
        return 'b[1].real()'
    return (_UNARY.get(expression.name) or _BINARY[expression.name]).format(*operands)


def compiled(expression: Expression, resolve: Resolver) -> Evaluated:
    """Return a function that gives its value. Raises ExpressionError."""
    # The text is made of what was parsed: operators, literals by their repr, and names as places in tuples.
    text = f'lambda d, e, b: {python_of(expression, resolve)}'
    function: Evaluated = eval(compile(text, '<model>', 'eval'), _SCOPE)  # noqa: S307
    return function


def constant(expression: Expression, names: Mapping[str, Any] | None = None) -> Any:
    """Return the value of an expression without names, or with these. Raises ExpressionError."""
    known = dict(names or {})

    def resolve(parts: tuple[str, ...]) -> str:
        if parts[0] in known and len(parts) == 1:
            return repr(known[parts[0]])
        raise ExpressionError(f'{".".join(parts)} is not known here: only literals are allowed')

    try:
        return compiled(expression, resolve)((), (), ())
    except (ArithmeticError, TypeError, LookupError, ValueError) as error:
        raise ExpressionError(f'it has no value: {error}') from error
