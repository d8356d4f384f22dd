# SPDX-License-Identifier: BSD-3-Clause
"""Scripts as nested closures: the meaning of every expression, whatever the values, and every error.

A closure takes the :class:`Scope` in which it is to be evaluated, so one set of closures serves all nodes with the same
script. ``script_specialization`` has a faster form for the values that are met most.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from flexbt_core.behavior_tree.model import (
    MISSING,
    BehaviorTreeError,
    Blackboard,
    BlackboardError,
    ConversionError,
    Entry,
    ScriptError,
)

from .parser import Assignment, Binary, Comparison, Conditional, Expression, Literal, Name, Unary
from .values import BINARY, SMALL_TEXT, UNARY, Value, assigned, check_room, choose, compare


class Scope:
    """The entries that the names of a script mean on one blackboard; found when they are needed, and remembered."""

    __slots__ = ('board', 'entries')

    def __init__(self, board: Blackboard, count: int) -> None:
        self.board = board
        self.entries = [MISSING] * count


Closure = Callable[[Scope], Value]


def _missing(key: str, remedy: str = '') -> BlackboardError:
    return BlackboardError(f'the blackboard has no entry [{key}]{remedy}', is_absent=True)


class ClosureCompiler:
    """Turns expressions into closures."""

    def __init__(self, script: str, enums: Mapping[str, int]) -> None:
        self._script = script
        self._enums = enums
        self._indices: dict[str, int] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The keys of the entries that the closures use, in the order of their place in a Scope."""
        return tuple(self._indices)

    def compile(self, expression: Expression) -> Closure:
        """The closure of an expression; it raises ScriptError when it cannot be evaluated."""
        match expression:
            case Literal(_, value):
                return lambda scope: value
            case Name():
                return self._name(expression)
            case Unary():
                return self._unary(expression)
            case Binary():
                return self._binary(expression)
            case Comparison():
                return self._comparison(expression)
            case Conditional():
                return self._conditional(expression)
            case Assignment():
                return self._assignment(expression)

    def _fault(self, offset: int, error: BehaviorTreeError, where: str = '') -> ScriptError:
        return ScriptError(self._script, offset, f'{where}{error}', is_absent=error.is_absent)

    def _index(self, key: str) -> int:
        return self._indices.setdefault(key, len(self._indices))

    def _name(self, expression: Name) -> Closure:
        offset, name = expression
        constant = self._enums.get(name)
        if constant is not None:
            number = float(constant)
            return lambda scope: number
        index = self._index(name)

        def read(scope: Scope) -> Value:
            entry = scope.entries[index]
            if not entry.present:
                found = scope.board.entry(name)
                if found is None:
                    raise self._fault(offset, _missing(name))
                scope.entries[index] = entry = found
            return entry.value

        return read

    def _unary(self, expression: Unary) -> Closure:
        offset = expression.offset
        operate = UNARY[expression.operator]
        operand = self.compile(expression.operand)

        def evaluate(scope: Scope) -> Value:
            value = operand(scope)
            try:
                return operate(value)
            except ConversionError as error:
                raise self._fault(offset, error) from None

        return evaluate

    def _binary(self, expression: Binary) -> Closure:
        offset = expression.offset
        operate = BINARY[expression.operator]
        left, right = self.compile(expression.left), self.compile(expression.right)

        def evaluate(scope: Scope) -> Value:
            first = left(scope)
            second = right(scope)
            try:
                return operate(first, second)
            except ConversionError as error:
                raise self._fault(offset, error) from None

        return evaluate

    def _comparison(self, expression: Comparison) -> Closure:
        enums = self._enums
        first, *others = map(self.compile, expression.operands)
        links = tuple(zip(expression.offsets, expression.operators, others, strict=True))

        def evaluate(scope: Scope) -> Value:
            left = first(scope)
            for offset, symbol, operand in links:
                right = operand(scope)
                try:
                    if not compare(symbol, left, right, enums):
                        return 0.0
                except ConversionError as error:
                    raise self._fault(offset, error) from None
                left = right
            return 1.0

        return evaluate

    def _conditional(self, expression: Conditional) -> Closure:
        offset = expression.offset
        condition = self.compile(expression.condition)
        then, otherwise = self.compile(expression.then), self.compile(expression.otherwise)

        def evaluate(scope: Scope) -> Value:
            value = condition(scope)
            try:
                holds = choose(value)
            except ConversionError as error:
                raise self._fault(offset, error) from None
            return then(scope) if holds else otherwise(scope)

        return evaluate

    def _assignment(self, expression: Assignment) -> Closure:
        enums = self._enums
        offset, symbol, key, _ = expression
        index = self._index(key)
        value_of = self.compile(expression.value)

        def assign(scope: Scope) -> Value:
            board = scope.board
            # The entry first: a new one is there, and empty, while the value is computed, and stays if that fails.
            entry = scope.entries[index]
            if not entry.present:
                scope.entries[index] = entry = self._target(board, expression)
            value = value_of(scope)
            with board.lock:
                try:
                    result = assigned(entry, symbol, value, enums)
                    if result.__class__ is str and len(result) > SMALL_TEXT:
                        check_room(board, result)
                except ConversionError as error:
                    raise self._fault(offset, error, f'entry [{key}]: ') from None
                entry.write(result)
            return result

        return assign

    def _target(self, board: Blackboard, expression: Assignment) -> Entry:
        """The entry that is assigned to; ``:=`` makes it when it is missing."""
        offset, symbol, key, _ = expression
        entry = board.entry(key)
        if entry is not None:
            return entry
        if symbol != ':=':
            raise self._fault(offset, _missing(key, '; create it by [:=]'))
        try:
            return board.declare(key, None)
        except BlackboardError as error:
            raise self._fault(offset, error) from error
