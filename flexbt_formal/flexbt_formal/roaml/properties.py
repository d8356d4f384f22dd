# SPDX-License-Identifier: BSD-3-Clause
"""Properties in JANI: the least or greatest probability that a path satisfies F, G, U or W on values of events.

https://jani-spec.org. A name is ``EVENT.valid`` (whether it was ever sent), ``EVENT__PARAMETER`` (with
``ros_fields__`` before the field of a message, and ``__`` before a member), or ``....d1_len``, the length of an array.
Models of before 2025 write ``EVENT.PARAMETER``.
A value that was never sent is 0.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.values.json_data import finite_number, load_json
from flexbt_core.values.text import short_repr

from .data_types import Record, length
from .dialect import Events
from .expressions import Call, Expression, ExpressionError, Literal, Reference, compiled, references_in
from .source_text import ModelError, ModelFault, SourceElement, read_text

_SIGNS: Final = ('&&', '||', '==', '!=', '<', '<=', '>', '>=', '+', '-', '*', '/', '%', 'min', 'max', 'pow')
_ALIASES: Final = {'∧': '&&', 'and': '&&', '∨': '||', 'or': '||', '=': '==', '≠': '!=', '≤': '<=', '≥': '>='}
_OPERATORS: Final = {sign: sign for sign in _SIGNS} | _ALIASES
_FUNCTIONS: Final = ('abs', 'floor', 'ceil', 'sin', 'cos', 'log', 'exp', 'round')
_UNARY: Final = dict.fromkeys(('¬', '!', 'not'), 'unary !') | {name: name for name in _FUNCTIONS}
_LENGTH: Final = re.compile(r'(.+)\.d(\d+)_len')
_ROUNDING: Final = 1e-9
"""Relative error of a calculated probability."""


class PropertyError(ValueError):
    """A property outside the supported subset of JANI."""


@dataclass(frozen=True)
class ModelProperty:
    """P(left U right), least or greatest over the orders; ``is_negated``: the result is 1 minus the other extreme.

    ``lower``, ``upper``: bounds on the steps after which ``right`` counts. ``demand``: the comparison that the
    probability has to meet; without one the property holds if the probability is 1.
    """

    name: str
    text: str
    is_least: bool
    left: Expression
    right: Expression
    is_negated: bool = False
    lower: int = 0
    upper: int | None = None
    demand: tuple[str, float] | None = None

    @property
    def names(self) -> list[str]:
        """JANI names that the property uses."""
        return [parts[0] for one in (self.left, self.right) for parts in references_in(one)]

    @property
    def is_for_all(self) -> bool:
        """True if the least probability is asked: no order of the automata may miss it."""
        return self.is_least is not self.is_negated

    @property
    def is_at_most(self) -> bool:
        """True if the demand limits the probability from above."""
        return self.demand is not None and self.demand[0] in ('<', '<=')

    @property
    def is_missed_where(self) -> bool:
        """True if a path that the demand does not want satisfies ``left U right``."""
        return self.is_negated is not self.is_at_most

    @property
    def is_of_all(self) -> bool:
        """True if a single path that the demand does not want misses it, however rare it is."""
        return self.demand in (None, ('>=', 1.0), ('<=', 0.0))

    def holds(self, value: float) -> bool:
        """Return whether a probability meets the demand. The tolerance for rounding is relative to the distance from 0
        or 1: a demand may be as small as 1e-9."""
        sign, wanted = self.demand or ('>=', 1.0)
        error = _ROUNDING * min(wanted, 1.0 - wanted)
        if sign in ('>', '<'):
            return value > wanted + error if sign == '>' else value < wanted - error
        error = error or _ROUNDING  # of 0 and 1: whether a single path misses it is known otherwise
        return value >= wanted - error if sign == '>=' else value <= wanted + error


def read_properties(path: str, asked: SourceElement | None) -> list[ModelProperty]:
    """Return the properties of a file. Raises ModelError."""

    def fail(message: str) -> ModelError:
        return ModelError([LoadError(path, 1, 1, '', message)])

    try:
        document = load_json(read_text(path, asked))
    except ValueError as error:
        raise fail(f'it is not JSON: {error}') from error
    rows = document.get('properties') if isinstance(document, dict) else None
    if not isinstance(rows, list) or not rows:
        raise fail('there is no list "properties" in it')
    found: list[ModelProperty] = []
    for row in rows:
        name = row.get('name') if isinstance(row, dict) else None
        if not isinstance(name, str) or any(name == one.name for one in found):
            raise fail(f'a property has no name, or one that another has: {short_repr(name)}')
        try:
            found.append(_property(name, row.get('expression')))
        except PropertyError as error:
            raise fail(f'the property {name!r}: {error}') from error
    return found


def _property(name: str, given: Any) -> ModelProperty:
    given = _mapping(given)
    if given.get('op') == 'filter':
        states = _mapping(given.get('states', {'op': 'initial'})).get('op')
        if states != 'initial' or given.get('fun') == 'count':
            raise PropertyError('a filter asks for the values in the initial states; write "states": {"op": "initial"}')
        given = _mapping(given.get('values'))
    demand = None
    if given.get('op') in ('≥', '>=', '>', '≤', '<=', '<'):
        wanted = given.get('right')
        number = None if isinstance(wanted, str) else finite_number(wanted)
        if number is None:
            raise PropertyError('a probability is compared with a number on the right')
        demand = (_OPERATORS[given['op']], number)
        given = _mapping(given.get('left'))
    extreme = given.get('op')
    if extreme not in ('Pmin', 'Pmax'):
        raise PropertyError(f'{short_repr(extreme)} is not known where a probability is asked; there are Pmin and Pmax')
    path = _mapping(given.get('exp'))
    lower, upper = _bounds(path)
    operator = path.get('op')
    is_negated = operator in ('G', 'W')
    left: Expression = Literal(True)
    if operator in ('F', 'G'):
        right = _expression(path.get('exp'))
        text = f'{operator} {_text(right)}'
        if is_negated:
            right = Call('unary !', (right,))
    elif operator in ('U', 'W'):
        left, right = _expression(path.get('left')), _expression(path.get('right'))
        text = f'{_text(left)} {operator} {_text(right)}'
        if is_negated and 'step-bounds' in path:
            raise PropertyError('W has no bounds here; write it with U')
        if is_negated:  # the negation of: not right, until neither
            neither = Call('&&', (Call('unary !', (left,)), Call('unary !', (right,))))
            left, right = Call('unary !', (right,)), neither
    else:
        raise PropertyError(f'{short_repr(operator)} is not known of a path; there are F, G, U and W')
    is_least = (extreme == 'Pmin') is not is_negated
    return ModelProperty(name, f'{extreme}({text})', is_least, left, right, is_negated, lower, upper, demand)


def _bounds(path: Mapping[str, Any]) -> tuple[int, int | None]:
    for other in ('time-bounds', 'reward-bounds'):
        if other in path:
            raise PropertyError(f'{other} are not known here; use step-bounds')
    given = path.get('step-bounds')
    if given is None:
        return 0, None
    found: list[int | None] = []
    for key in ('lower', 'upper'):
        value = _mapping(given).get(key)
        if value is not None and (type(value) is not int or value < 0):
            raise PropertyError(f'the {key} bound {value!r} is not a whole number')
        found.append(
            None if value is None else value - bool(given.get(f'{key}-exclusive')) * (1 if key == 'upper' else -1)
        )
    return found[0] or 0, found[1]


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise PropertyError(f'{json.dumps(value)[:80]} where an object of JANI is needed')
    return value


def _expression(given: Any, depth: int = 0) -> Expression:
    if depth > 60:
        raise PropertyError('it is nested more than 60 deep')
    if isinstance(given, bool | int | float):
        if not isinstance(given, bool) and finite_number(given) is None:
            raise PropertyError(f'{short_repr(given)} is not a number')
        return Literal(given)
    if isinstance(given, str):
        return Reference((given,))
    given = _mapping(given)

    def inner(key: str) -> Expression:
        if key not in given:
            raise PropertyError(f'{key!r} is missing of the operator {operator!r}')
        return _expression(given[key], depth + 1)

    operator = given.get('op')
    if operator in _OPERATORS:
        return Call(_OPERATORS[operator], (inner('left'), inner('right')))
    if operator in _UNARY:
        return Call(_UNARY[operator], (inner('exp'),))
    if operator in ('⇒', '=>'):
        return Call('||', (Call('unary !', (inner('left'),)), inner('right')))
    if operator == 'ite':
        return Call('?', (inner('if'), inner('then'), inner('else')))
    if operator == 'aa':
        # In JANI all arrays have their full length, so elements beyond the end are 0.
        return Call('element or 0', (inner('exp'), inner('index')))
    if operator == 'av':
        elements = given.get('elements')
        if not isinstance(elements, list):
            raise PropertyError('the elements of an array are missing')
        return Call('array', tuple(_expression(one, depth + 1) for one in elements))
    raise PropertyError(f'the operator {short_repr(operator)} is not known')


def _text(expression: Expression) -> str:
    """Return the expression as text for messages."""
    if isinstance(expression, Reference):
        return expression.parts[0].replace('__ros_fields__', '.')
    if isinstance(expression, Literal):
        return str(expression.value)
    parts = [_text(one) for one in expression.operands]
    if expression.name == 'array':
        return f'[{", ".join(parts)}]'
    if len(parts) == 1:
        return f'{expression.name.removeprefix("unary ")}({parts[0]})'
    if expression.name == 'element or 0':
        return f'{parts[0]}[{parts[1]}]'
    return f'({f" {expression.name} ".join(parts)})' if len(parts) == 2 else f'{expression.name}({", ".join(parts)})'


# -- on the events of a model -----------------------------------------------------------------------------------------


def event_of(name: str, events: Events) -> tuple[str, str]:
    """Return the event and the rest of a JANI name: ``valid``, or parameters. Raises PropertyError."""
    if name.endswith('.valid'):
        return name.removesuffix('.valid'), 'valid'
    best, rest = '', ''
    for one in events.names:
        for separator in ('__', '.'):
            if name.startswith(one + separator) and len(one) > len(best):
                best, rest = one, name.removeprefix(one + separator)
    if not best:
        raise PropertyError(f'{name!r} is not a parameter of an event of this model')
    return best, rest


Judge = Callable[[Sequence[tuple[Any, ...] | None]], bool]
"""A function that returns whether an expression is true for the observed values of the watched events. It raises
ModelFault for values with which the expression has none, as for a division by 0."""


def judge_of(expression: Expression, events: Events, watched: Sequence[int]) -> Judge:
    """Return the judge of an expression. Raises PropertyError for a name that the model does not know."""

    def resolve(parts: tuple[str, ...]) -> str:
        name = parts[0]
        length = _LENGTH.fullmatch(name)
        base = name if length is None else length.group(1)
        event, rest = event_of(base, events)
        number = events.find(event)
        if number is None:
            raise ExpressionError(f'there is no event {event!r} in this model')
        place = watched.index(number)
        if rest == 'valid':
            return f'(d[{place}] is not None)'
        path = _parameter(events.parameters[number], rest)
        if path is None:
            known = ', '.join(events.parameters[number]) or 'nothing'
            raise ExpressionError(f'{name!r} is not there: {event} carries {known}')
        at, members = path
        found = f'e(d[{place}], {at}, {members!r})'
        return f'b({found})' if length is not None else found

    try:
        function = compiled(expression, resolve)
    except ExpressionError as error:
        raise PropertyError(str(error)) from error

    def judge(seen: Sequence[tuple[Any, ...] | None]) -> bool:
        try:
            return bool(function(seen, _carried, _length))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise ModelFault(f'{_text(expression)} has no value: {error.args[0]}') from error

    return judge


def _carried(values: tuple[Any, ...] | None, at: int, members: tuple[str, ...]) -> Any:
    if values is None:
        return 0
    value = values[at]
    for name in members:
        value = value.get(name) if isinstance(value, Record) else tuple(one.get(name) for one in value)
    return value


def _length(value: Any) -> int:
    return length(value) if isinstance(value, tuple | str) else 0


def _parameter(names: Sequence[str], rest: str) -> tuple[int, tuple[str, ...]] | None:
    """Return the index of a parameter, and the members that follow it."""
    for at, name in enumerate(names):
        if name == rest:
            return at, ()
    for at, name in enumerate(names):
        if rest.startswith(f'{name}__'):
            return at, tuple(rest[len(name) + 2 :].split('__'))
    return None
