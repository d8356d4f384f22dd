# SPDX-License-Identifier: BSD-3-Clause
"""Python code for scripts, specialized to the kinds of values that their entries currently hold.

The code first checks that the entries still hold values of these kinds. It then computes with local variables, and
writes the entries last. In any other case (another kind, an error, a number that is too large, a division by zero, a
sum for an entry that another thread has written meanwhile) it calls ``slow`` *before it writes anything*. The closures
then run the whole script, and raise the errors. So the code never defines what a script means; it only runs several
times as fast.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

from flexbt_core.behavior_tree.model.blackboard import Entry
from flexbt_core.behavior_tree.model.ports import INT64

from .parser import Assignment, Binary, Comparison, Conditional, Constant, Expression, Name, Unary
from .values import SAME_NUMBER, SMALL_TEXT

Factory = Callable[[Sequence[Entry], Callable[[], 'bool | None']], Callable[[], 'bool | None']]
"""A function that creates the code for the entries of one node, given the fallback for values that do not fit."""

Kind = Literal['integer', 'bool', 'real', 'text']

_KINDS: Final[Mapping[type[Any], Kind]] = {int: 'integer', bool: 'bool', float: 'real', str: 'text'}
_CLASSES: Final[Mapping[Kind, str]] = {kind: python_type.__name__ for python_type, kind in _KINDS.items()}
_INTEGERS: Final[tuple[Kind, ...]] = ('integer', 'bool')

_LARGEST: Final = 2**30 - 1
"""Largest integer in an entry that the code handles: sums of a few of these are still exact as doubles."""
_EXACT: Final = 2**53 - 1
_MAX_DEPTH: Final = 40
"""Maximum nesting of expressions, because Python's parser has a limit."""
_CALL: Final = re.compile(r'\b(int|len|format)\(')
"""Calls in the code: Python switches threads only there."""


class Variable(NamedTuple):
    """The known properties of an entry: the kind of its value, and its integer bounds (when they matter)."""

    kind: Kind
    minimum: int
    maximum: int


class NotSpecializable(Exception):
    """The script has no code for these kinds. The closures run it."""


def variable_of(entry: Entry) -> Variable | None:
    """Return the kind of an entry; None if no code can handle its values."""
    kind = _KINDS.get(entry.value.__class__)
    if kind is None:
        return None
    declared = entry.type if entry.type is not None and entry.type.category == 'integer' else INT64
    assert declared.minimum is not None
    assert declared.maximum is not None
    return Variable(kind, max(declared.minimum, -_LARGEST), min(declared.maximum, _LARGEST))


class _Code(NamedTuple):
    """Python code for an expression, and the properties of its value.

    ``bound`` is the maximum absolute value of an integer or bool. If ``integral`` is true, the scripting language
    treats the value as an integer. Otherwise it is a double, which the code keeps as int or bool (0.0 and 1.0) because
    that is faster. ``simple`` code is a name or a literal, and may be repeated.
    """

    text: str
    kind: Kind
    bound: int = 0
    integral: bool = False
    simple: bool = False

    @property
    def real(self) -> str:
        """Code of the number as a float."""
        return self.text if self.kind == 'real' else f'({self.text} * 1.0)'


def specialize(
    statements: Sequence[Expression],
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
    *,
    condition: bool,
) -> Factory:
    """Return a factory of the code of a script, for entries of these kinds, in this order.

    The code returns the truth of the last statement when the script is a ``condition``, otherwise None.

    Raises:
        NotSpecializable: these kinds have no code.
    """
    writer = _CodeWriter(variables, enums)
    result = writer.statements(statements)
    lines = writer.lines
    if condition:
        lines.append(f'result = {writer.truth(result)}')
    body = [
        *writer.guards(),
        'try:',
        *(f'    {line}' for line in lines or ['pass']),
        'except (ArithmeticError, ValueError):',
        '    return slow()',
        *writer.commits(),
        f'return {"result" if condition else None}',
    ]
    known = {'slow': 'slow'}
    for place in range(len(variables)):
        known |= {f'e{place}': f'entries[{place}]', f't{place}': f'entries[{place}].type'}
    words = set(re.findall(r'\w+', '\n'.join(body)))
    # As defaults of parameters that are never passed, they take less memory than as variables of a closure.
    parameters = ', '.join(f'{name}={value}' for name, value in known.items() if name in words)
    code = [
        'def bind(entries, slow):',
        f'    def run({parameters}):',
        *(f'        {line}' for line in body),
        '    return run',
    ]
    namespace: dict[str, Any] = {}
    exec(compile('\n'.join(code), '<script>', 'exec'), namespace)  # noqa: S102 - the writer made it; see there
    factory: Factory = namespace['bind']
    return factory


class _CodeWriter:
    """A writer of the code of scripts, in parts.

    First come the :meth:`guards` of the entries. Then come the ``lines``, which raise ArithmeticError or ValueError in
    cases that the code does not handle. The :meth:`commits` come last. The entries are named e0, e1 and so on, in the
    order of ``variables``, and their types t0, t1. Local variables are v and x. The only parts of a script's text that
    enter the code are numbers and texts, written with repr().
    """

    def __init__(self, variables: Mapping[str, Variable], enums: Mapping[str, int]) -> None:
        self._variables = variables
        self._enums = enums
        self._locals = {name: f'v{index}' for index, name in enumerate(variables)}
        self.lines: list[str] = []
        self._used: set[str] = set()
        self._writes: dict[str, int] = {}
        self._changed: set[str] = set()
        self._temporaries = 0
        self._depth = 0

    def statements(self, statements: Sequence[Expression]) -> _Code:
        """Add the lines of a script; return the code of the value of its last statement."""
        result = _Code('False', 'bool')
        for statement in statements:
            result = self._assign(statement) if isinstance(statement, Assignment) else self._expression(statement)
        return result

    def guards(self) -> list[str]:
        """Return the lines that read the entries, and call ``slow`` unless kinds and bounds are as expected."""
        lines, checked = [], self._checked
        for place, (name, variable) in enumerate(self._variables.items()):
            if name not in self._used:
                continue
            before = f'b{place} = ' if name in checked else ''
            lines.append(f'v{place} = {before}e{place}.value')
            wrong = f'v{place}.__class__ is not {_CLASSES[variable.kind]}'
            if variable.kind == 'integer':
                wrong += f' or not {-_LARGEST} <= v{place} <= {_LARGEST}'
                if name in self._writes:
                    # The code contains the bounds of the type.
                    wrong += f' or e{place}.type is not t{place}'
            lines.append(f'if {wrong}: return slow()')
        return lines

    def commits(self) -> list[str]:
        """Write the entries."""
        # Stores without a call in between: no other thread runs between the values and their sequence numbers.
        places = [self._locals[name][1:] for name in self._checked]
        lines = [f'if e{place}.value is not b{place}: return slow()' for place in places]
        for name, count in self._writes.items():
            place = self._locals[name][1:]
            lines += [f'e{place}.value = v{place}', f'e{place}.sequence += {count}']
        return lines

    @property
    def _checked(self) -> list[str]:
        """The entries to which the script adds and the like, if another thread may run before they are written."""
        return sorted(self._changed) if any(map(_CALL.search, self.lines)) else []

    def _check(self, holds: str) -> None:
        self.lines.append(f'if not ({holds}): raise ValueError')

    def _name(self, code: _Code) -> str:
        """Return a name for the value of the code."""
        if code.simple:
            return code.text
        self._temporaries += 1
        name = f'x{self._temporaries}'
        self.lines.append(f'{name} = {code.text}')
        return name

    def _small_text(self, joined: str) -> _Code:
        """Return a text that an operator made. Leave large ones to the closures, which enforce the limit on texts."""
        text = self._name(_Code(joined, 'text'))
        self._check(f'len({text}) <= {SMALL_TEXT}')
        return _Code(text, 'text')

    # -- statements --------------------------------------------------------------------------------------------------

    def _assign(self, statement: Assignment) -> _Code:
        name = statement.target
        target = self._variables[name]
        self._used.add(name)
        code = self._expression(statement.value)
        if statement.operator not in (':=', '='):
            self._changed.add(name)
            code = self._operate(statement.operator[0], self._variable(name), code)
        local = self._locals[name]
        bounds = f'{target.minimum} <= {local} <= {target.maximum}'
        match target.kind, code.kind:
            case ('integer', 'integer'):
                self.lines.append(f'{local} = {code.text}')
                if not target.minimum <= -code.bound <= code.bound <= target.maximum:
                    self._check(bounds)
            case ('integer', 'bool'):
                self.lines.append(f'{local} = +{code.text}')
            case ('integer', 'real'):
                number = self._name(code)
                self.lines.append(f'{local} = int({number})')
                self._check(f'{local} == {number} and {bounds}')
            case ('real', 'integer' | 'bool' | 'real'):
                self.lines.append(f'{local} = {code.real}')
            case ('bool', 'bool') | ('text', 'text'):
                self.lines.append(f'{local} = {code.text}')
            case _:
                raise NotSpecializable
        self._writes[name] = self._writes.get(name, 0) + 1
        return self._variable(name)

    def truth(self, code: _Code) -> str:
        """Return the code as a condition."""
        match code.kind:
            case 'bool':
                return code.text
            case 'text':
                raise NotSpecializable
        number = self._name(code)
        self._check(f'0 <= {number} <= 1' if code.integral else f'{number} >= 0')
        return f'({number} != 0)'

    # -- expressions -------------------------------------------------------------------------------------------------

    def _expression(self, expression: Expression) -> _Code:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise NotSpecializable
        code = self._dispatch(expression)
        self._depth -= 1
        return code

    def _dispatch(self, expression: Expression) -> _Code:
        match expression:
            case Constant(_, value):
                return _constant(value)
            case Name(_, name):
                enum = self._enums.get(name)
                return self._variable(name) if enum is None else _integer(enum)
            case Unary(_, symbol, operand):
                return self._unary(symbol, operand)
            case Binary(_, symbol, left, right):
                return self._operate(symbol, self._expression(left), self._expression(right))
            case Comparison():
                return self._comparison(expression)
            case Conditional(_, condition, then, otherwise):
                return self._conditional(condition, then, otherwise)
        raise NotSpecializable  # an assignment inside an expression

    def _variable(self, name: str) -> _Code:
        self._used.add(name)
        kind = self._variables[name].kind
        bound = {'integer': _LARGEST, 'bool': 1}.get(kind, 0)
        return _Code(self._locals[name], kind, bound, integral=kind in _INTEGERS, simple=True)

    def _unary(self, symbol: str, operand: Expression) -> _Code:
        code = self._expression(operand)
        if code.kind == 'text':
            raise NotSpecializable
        match symbol:
            case '!':
                return _truth_value(f'(not {code.text})' if code.kind == 'bool' else f'({code.text} == 0)')
            case '~' if code.kind in _INTEGERS:
                return _Code(f'(-1 - {code.text})', 'integer', code.bound + 1)
            case '-' if isinstance(operand, Constant) and code.kind == 'integer' and operand.value:
                return _Code(f'(-{code.text})', 'integer', code.bound, simple=True)
            case '-':
                # Negate as a double, because of the negative zero.
                return _Code(f'(-{code.real})', 'real')
        raise NotSpecializable

    def _operate(self, symbol: str, left: _Code, right: _Code) -> _Code:
        if symbol in ('&&', '||'):
            # Compute both operands, as BehaviorTree.CPP does; neither has side effects.
            first, second = self.truth(left), self.truth(right)
            return _truth_value(f'({first} {"and" if symbol == "&&" else "or"} {second})')
        texts = (left.kind == 'text') + (right.kind == 'text')
        if symbol == '..' and texts:
            return self._small_text(f'{_text(left)} + {_text(right)}')
        if texts == 2 and symbol == '+':
            return self._small_text(f'{left.text} + {right.text}')
        if texts or symbol == '..':
            raise NotSpecializable
        integers = left.kind in _INTEGERS and right.kind in _INTEGERS
        text = f'({left.text} {symbol} {right.text})'
        if symbol in ('&', '|', '^'):
            if not integers:
                raise NotSpecializable
            if left.kind == right.kind == 'bool':
                return _truth_value(text)
            return _Code(text, 'integer', 1 << max(left.bound, right.bound).bit_length())
        if integers and symbol in ('+', '-') and left.bound + right.bound <= _EXACT:
            return _Code(text, 'integer', left.bound + right.bound)
        if symbol == '/' or not integers:
            return _Code(text, 'real')
        return _Code(f'({left.real} {symbol} {right.text})', 'real')

    def _comparison(self, expression: Comparison) -> _Code:
        codes = [self._expression(operand) for operand in expression.operands]
        # An operand between two operators is compared twice, so compute it once.
        codes[1:-1] = [code._replace(text=self._name(code)) for code in codes[1:-1]]
        links = map(_compared, expression.operators, codes, codes[1:])
        return _truth_value(f'({" and ".join(links)})')

    def _conditional(self, condition: Expression, then: Expression, otherwise: Expression) -> _Code:
        chosen, first, second = map(self._expression, (condition, then, otherwise))
        if chosen.kind == 'text' or first.integral is not second.integral:
            raise NotSpecializable
        holds = chosen.text if chosen.kind == 'bool' else f'{chosen.text} != 0'
        kinds = {first.kind, second.kind}
        if len(kinds) == 1:
            branches, kind = (first.text, second.text), first.kind
        elif kinds == {'integer', 'bool'}:
            branches, kind = (f'+{first.text}', f'+{second.text}'), 'integer'
        elif 'text' not in kinds:
            branches, kind = (first.real, second.real), 'real'
        else:
            raise NotSpecializable
        text = f'({branches[0]} if {holds} else {branches[1]})'
        return _Code(text, kind, max(first.bound, second.bound), first.integral)


def _truth_value(text: str) -> _Code:
    return _Code(text, 'bool', 1)


def _integer(value: int, integral: bool = False) -> _Code:
    if abs(value) > _EXACT:
        raise NotSpecializable
    return _Code(f'({value})', 'integer', abs(value), integral, simple=True)


def _constant(value: int | float | str) -> _Code:
    if isinstance(value, int):
        return _integer(value, integral=True)
    if isinstance(value, float):
        if value in (0.0, 1.0):
            return _Code(repr(value == 1.0), 'bool', 1, simple=True)
        return _Code(repr(value), 'real', simple=True)
    return _Code(repr(value), 'text', simple=True)


def _text(code: _Code) -> str:
    """Return a number or text as text, see text_of()."""
    if code.kind == 'text':
        return code.text
    return f"format({code.text}, '{'d' if code.integral else 'f'}')"


def _compared(symbol: str, left: _Code, right: _Code) -> str:
    """Return the code of a comparison, see compare() in ``values``."""
    if (left.kind == 'text') is not (right.kind == 'text'):
        raise NotSpecializable
    if 'real' not in (left.kind, right.kind):
        return f'{left.text} {symbol} {right.text}'
    if symbol in ('==', '!='):
        same = f'{-SAME_NUMBER} <= {left.text} - {right.text} <= {SAME_NUMBER}'
        return same if symbol == '==' else f'not {same}'
    opposite = {'<': '>=', '>': '<=', '<=': '>', '>=': '<'}[symbol]
    return f'not {left.text} {opposite} {right.text}'
