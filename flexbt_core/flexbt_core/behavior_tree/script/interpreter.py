# SPDX-License-Identifier: BSD-3-Clause
"""Scripts as nested closures: compiled once for all nodes that share a script, and bound to a node's blackboard."""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from flexbt_core.behavior_tree.model.blackboard import EMPTY, MISSING, Blackboard, Entry
from flexbt_core.behavior_tree.model.errors import (
    BehaviorTreeError,
    BlackboardError,
    ConversionError,
    RegistrationError,
    ScriptError,
)
from flexbt_core.behavior_tree.model.ports import PortType

from .code_writer import Factory, NotSpecializable, Variable, specialize, variable_of
from .parser import Assignment, Binary, Comparison, Conditional, Constant, Expression, Name, Unary, parse_script
from .values import BINARY, SMALL_TEXT, UNARY, Value, assigned, check_room, choose, compare, truth

WARM_UP: Final = 0 if os.environ.get('FLEXBT_ACCELERATION') == '0' else 8
"""Number of runs of a script on a blackboard before code is generated for it; 0: never."""
_MOST_FACTORIES: Final = 16
_ENUM_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


class CompiledScript:
    """A script, independent of nodes and blackboards. Made by :class:`ScriptLibrary`.

    ``names`` are the keys of the entries that it uses.
    """

    __slots__ = ('__weakref__', '_closures', '_enums', '_factories', '_statements', 'names', 'text', 'warm_up')

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        """Compile the text. Raises ScriptError if it is not a script; an empty text does nothing."""
        self.text = text
        self.warm_up = warm_up
        self._enums = enums
        self._factories: dict[tuple[object, ...], Factory | None] = {}
        self._statements = parse_script(text)
        compiler = ClosureCompiler(text, enums)
        self._closures = tuple(map(compiler.compile, self._statements))
        self.names = compiler.names

    def __repr__(self) -> str:
        return f'CompiledScript({self.text!r})'

    @property
    def empty(self) -> bool:
        """True if the script does nothing."""
        return not self._statements

    def bind(self, board: Blackboard, *, condition: bool = False) -> BoundScript:
        """Return the script on ``board``. Raises ScriptError for an empty ``condition``."""
        if condition and self.empty:
            raise ScriptError(self.text, 0, 'the script is empty, and an empty script is not a condition')
        return BoundScript(self, board, condition=condition)

    def scope(self, board: Blackboard) -> ScriptScope:
        """Return the entries of the script on ``board``."""
        return ScriptScope(board, len(self.names))

    def evaluate(self, scope: ScriptScope) -> Value:
        """Run the closures; return the value of the last statement, EMPTY if the script has none."""
        value: Value = EMPTY
        for closure in self._closures:
            value = closure(scope)
        return value

    def truth(self, value: Value) -> bool:
        """Return whether the value of the last statement is true. Raises ScriptError if it is neither."""
        try:
            return truth(value)
        except ConversionError as error:
            raise ScriptError(self.text, _offset(self._statements[-1]), str(error), is_absent=error.is_absent) from None

    def factory(self, variables: Mapping[str, Variable], condition: bool) -> Factory | None:
        """Return a factory of code for entries of these kinds; None if only closures can run the script."""
        key = (condition, *variables.values())
        if key not in self._factories:
            if len(self._factories) >= _MOST_FACTORIES:
                self._factories.clear()
            try:
                self._factories[key] = specialize(self._statements, variables, self._enums, condition=condition)
            except NotSpecializable:
                self._factories[key] = None
        return self._factories[key]


SCRIPT: Final = PortType('script', CompiledScript)
"""Type of a literal that is a script. Only the file reader can make it, because it knows the enum constants."""
CONDITION: Final = PortType('condition', CompiledScript)
"""Like SCRIPT, for conditions: a condition cannot be empty."""


class BoundScript:
    """A script on a blackboard.

    ``run()`` runs it. It returns the truth of a condition, otherwise None. If it raises ScriptError, earlier writes of
    the script remain. At first closures run the script, later code for the kinds of values that the entries hold.
    """

    __slots__ = ('_condition', '_countdown', '_scope', '_script', 'run')

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        self._script = script
        self._condition = condition
        self._scope = script.scope(board)
        self._countdown = script.warm_up
        self.run: Callable[[], bool | None] = self._evaluate

    def _evaluate(self) -> bool | None:
        """Run the closures. Also the fallback when the code does not fit the values."""
        if self._countdown:
            self._countdown -= 1
            if not self._countdown:
                self._countdown = self._script.warm_up
                self._specialize()
        value = self._script.evaluate(self._scope)
        return self._script.truth(value) if self._condition else None

    def _specialize(self) -> None:
        """Generate code for the current kinds of values of the entries, if possible."""
        self.run = self._evaluate
        entries = self._scope.entries
        variables = [variable_of(entry) for entry in entries]
        known = {name: one for name, one in zip(self._script.names, variables, strict=True) if one is not None}
        # If two names mean the same entry, their local variables in the code would diverge.
        if len(known) == len(set(map(id, entries))) == len(entries):
            factory = self._script.factory(known, self._condition)
            if factory is not None:
                self.run = factory(entries, self._evaluate)


class ScriptLibrary:
    """The enum constants of scripts, and the scripts in use.

    In a script the name of a constant means its number, not a blackboard entry. A script uses the constants that
    existed when it was compiled.
    """

    def __init__(self, warm_up: int = WARM_UP) -> None:
        """Make an empty library.

        ``warm_up`` is the number of runs of a script on a blackboard before code is generated for it, and the number of
        runs that do not fit the code before it is generated again. Many scripts run only a few times. 0: no code.
        """
        self._warm_up = warm_up
        self._enums: dict[str, int] = {}
        self._scripts: weakref.WeakValueDictionary[str, CompiledScript] = weakref.WeakValueDictionary()

    @property
    def enums(self) -> Mapping[str, int]:
        return MappingProxyType(self._enums)

    def register_enum(self, name: str, value: int) -> None:
        """Make ``name`` mean ``value``. Raises RegistrationError if it means another number, or is not a name."""
        if not _ENUM_NAME.fullmatch(name) or name in ('true', 'false'):
            raise RegistrationError(f'enum constant [{name}]: a name consists of letters, digits and _')
        known = self._enums.setdefault(name, int(value))
        if known != value:
            raise RegistrationError(f'enum constant [{name}] is registered already, as {known}; it cannot be {value}')
        self._scripts = weakref.WeakValueDictionary()

    def script(self, text: str) -> CompiledScript:
        """Return the script of this text, shared by all its users. Raises ScriptError if the text is not a script."""
        script = self._scripts.get(text)
        if script is None:
            # Spread the warm-ups, because generating code takes time.
            warm_up = self._warm_up and self._warm_up + len(self._scripts) % self._warm_up
            script = self._scripts[text] = CompiledScript(text, dict(self._enums), warm_up)
        return script


def _offset(statement: Expression) -> int:
    return statement.offsets[0] if isinstance(statement, Comparison) else statement.offset


# Scripts as nested closures. They define the meaning of every expression for all values, and every error.
#
# The argument of a closure is the :class:`ScriptScope` to evaluate it in, so one set of closures serves all nodes with
# the same script. ``code_writer`` has a faster form for the most frequent kinds of values.


class ScriptScope:
    """The entries that the names of a script refer to on one blackboard. They are looked up on demand and cached."""

    __slots__ = ('board', 'entries')

    def __init__(self, board: Blackboard, count: int) -> None:
        self.board = board
        self.entries = [MISSING] * count


Closure = Callable[[ScriptScope], Value]


def _missing(key: str, remedy: str = '') -> BlackboardError:
    return BlackboardError(f'the blackboard has no entry [{key}]{remedy}', is_absent=True)


class ClosureCompiler:
    """A compiler from expressions to closures."""

    def __init__(self, script: str, enums: Mapping[str, int]) -> None:
        self._script = script
        self._enums = enums
        self._indices: dict[str, int] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Keys of the entries that the closures use, in the order of the entries in a ScriptScope."""
        return tuple(self._indices)

    def compile(self, expression: Expression) -> Closure:
        """Return the closure of an expression; it raises ScriptError when it cannot be evaluated."""
        match expression:
            case Constant(_, value):
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

        def read(scope: ScriptScope) -> Value:
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

        def evaluate(scope: ScriptScope) -> Value:
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

        def evaluate(scope: ScriptScope) -> Value:
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

        def evaluate(scope: ScriptScope) -> Value:
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

        def evaluate(scope: ScriptScope) -> Value:
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

        def assign(scope: ScriptScope) -> Value:
            board = scope.board
            # Create the entry first: it exists, empty, while the value is computed, and remains if that fails.
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
        """Return the entry to assign to; ``:=`` creates it if it is missing."""
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
