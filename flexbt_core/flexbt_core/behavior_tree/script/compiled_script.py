# SPDX-License-Identifier: BSD-3-Clause
"""Scripts: parsed once, compiled once for all nodes that have the same one, and bound to the blackboard of a node."""

from __future__ import annotations

import re
import weakref
from collections.abc import Callable, Hashable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from flexbt_core.behavior_tree.acceleration.script_code import NotSpecializable, Variable, variable_of
from flexbt_core.behavior_tree.acceleration.script_specialization import (
    Factory,
    specialize,
    specialize_completion,
    specialize_gate,
)
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.errors import ConversionError, RegistrationError, ScriptError
from flexbt_core.behavior_tree.model.port_types import PortType

from .interpreter import ClosureCompiler, Scope
from .parser import Comparison, Expression, parse_script
from .values import Value, truth

WARM_UP: Final = 8
_MOST_FACTORIES: Final = 16
_ENUM_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


class CompiledScript:
    """A script, independent of nodes and blackboards. Made by :class:`ScriptLibrary`.

    ``names`` are the keys of the entries that it uses.
    """

    __slots__ = ('__weakref__', '_closures', '_enums', '_factories', '_statements', 'names', 'text', 'warm_up')

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        """Raises ScriptError when the text is no script. The empty text is one that does nothing."""
        self.text = text
        self.warm_up = warm_up
        self._enums = enums
        self._statements = parse_script(text)
        compiler = ClosureCompiler(text, enums)
        self._closures = tuple(map(compiler.compile, self._statements))
        self.names = compiler.names
        self._factories: dict[Hashable, Factory | None] = {}

    def __repr__(self) -> str:
        return f'CompiledScript({self.text!r})'

    @property
    def empty(self) -> bool:
        """Whether it does nothing."""
        return not self._statements

    def bind(self, board: Blackboard, *, condition: bool = False) -> BoundScript:
        """The script on ``board``. Raises ScriptError when it is to be a ``condition``, and is empty."""
        if condition and self.empty:
            raise ScriptError(self.text, 0, 'the script is empty, and so is no condition')
        return BoundScript(self, board, condition=condition)

    def scope(self, board: Blackboard) -> Scope:
        """The place of the script on ``board``."""
        return Scope(board, len(self.names))

    def evaluate(self, scope: Scope) -> Value:
        """Runs the closures; gives the value of the last statement, EMPTY when there is none."""
        value: Value = EMPTY
        for closure in self._closures:
            value = closure(scope)
        return value

    def truth(self, value: Value) -> bool:
        """Whether the value of the last statement is true. Raises ScriptError when it is neither."""
        try:
            return truth(value)
        except ConversionError as error:
            raise ScriptError(self.text, _offset(self._statements[-1]), str(error)) from None

    def factory(self, variables: Mapping[str, Variable], condition: bool) -> Factory | None:
        """What makes the code for entries of these kinds; None when that is for the closures."""

        def make() -> Factory:
            return specialize(self._statements, variables, self._enums, condition=condition)

        return self._made((condition, *variables.values()), make)

    def _made(self, key: Hashable, make: Callable[[], Factory]) -> Factory | None:
        if key not in self._factories:
            if len(self._factories) >= _MOST_FACTORIES:
                self._factories.clear()
            try:
                self._factories[key] = make()
            except NotSpecializable:
                self._factories[key] = None
        return self._factories[key]


def gate_factory(
    scripts: Sequence[CompiledScript],
    decisive: Sequence[bool],
    variables: Mapping[str, Variable],
    *,
    ongoing: bool,
    forgetful: bool,
) -> Factory | None:
    """What makes the code that ticks a node with these pre-conditions, see ``specialize_gate``.

    None when that is for the closures. All scripts are of one library.
    """
    first = scripts[0]

    def make() -> Factory:
        conditions = [(script._statements, wanted) for script, wanted in zip(scripts, decisive, strict=True)]
        return specialize_gate(conditions, variables, first._enums, ongoing=ongoing, forgetful=forgetful)

    key = (*scripts[1:], *decisive, *variables.items(), ongoing, forgetful)
    return first._made(key, make)


def completion_factory(
    sides: Sequence[Sequence[CompiledScript] | None], variables: Mapping[str, Variable]
) -> Factory | None:
    """What makes the code that ticks a node with these post-conditions, see ``specialize_completion``.

    None when that is for the closures. All scripts are of one library.
    """
    first = next(script for side in sides for script in side or ())

    def make() -> Factory:
        statements = [
            None if side is None else [statement for script in side for statement in script._statements]
            for side in sides
        ]
        return specialize_completion(statements, variables, first._enums)

    key = (*(None if side is None else tuple(side) for side in sides), *variables.items())
    return first._made(key, make)


def kinds_of(entries: Mapping[str, Entry]) -> dict[str, Variable] | None:
    """The kinds of the entries that scripts use, by name; None when there is no code for one of them."""
    variables = {name: variable for name, entry in entries.items() if (variable := variable_of(entry)) is not None}
    return variables if len(variables) == len(entries) else None


SCRIPT: Final = PortType('script', CompiledScript)
"""The type of a literal that is a script. Only the reader of a file can make it, since it knows the enum constants."""
CONDITION: Final = PortType('condition', CompiledScript)
"""As SCRIPT, for scripts of which the truth is asked, and that cannot be empty."""


class BoundScript:
    """A script on a blackboard. ``run()`` runs it; of a condition it gives the truth, otherwise None.

    It raises ScriptError. What the script has done before that stays done.
    """

    __slots__ = ('_condition', '_countdown', '_scope', 'run', 'script')

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        self.script = script
        self._condition = condition
        self._scope = script.scope(board)
        self._countdown = script.warm_up
        self.run: Callable[[], bool | None] = self._evaluate

    @property
    def entries(self) -> dict[str, Entry]:
        """The entries that the script uses, by name, as it found them in its last run."""
        return dict(zip(self.script.names, self._scope.entries, strict=True))

    def _evaluate(self) -> bool | None:
        """Runs the closures; also for the code that is made of them, when that does not fit."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self.script.warm_up
            self._specialize()
        value = self.script.evaluate(self._scope)
        return self.script.truth(value) if self._condition else None

    def _specialize(self) -> None:
        """Makes the code for what the entries hold now, if there is such code."""
        self.run = self._evaluate
        entries = self._scope.entries
        variables = kinds_of(self.entries)
        # Two names of one entry: a local variable of the code could not stand for it.
        if variables is not None and len(set(map(id, entries))) == len(entries):
            factory = self.script.factory(variables, self._condition)
            if factory is not None:
                self.run = factory(entries, [entry.type for entry in entries], self._evaluate)


class ScriptLibrary:
    """The enum constants that scripts know, and the scripts that are in use.

    In a script the name of a constant means its number, and is no blackboard entry. A script knows the constants that
    were there when it was made.
    """

    def __init__(self, warm_up: int = WARM_UP) -> None:
        """``warm_up`` is the number of runs of a script on a blackboard before code is made for what it finds there,
        and of runs for which the code did not fit before it is made anew: many scripts run only a few times."""
        self._warm_up = warm_up
        self._enums: dict[str, int] = {}
        self._scripts: weakref.WeakValueDictionary[str, CompiledScript] = weakref.WeakValueDictionary()

    @property
    def enums(self) -> Mapping[str, int]:
        return MappingProxyType(self._enums)

    def register_enum(self, name: str, value: int) -> None:
        """Makes ``name`` mean ``value``. Raises RegistrationError when it means another number, or is no name."""
        if not _ENUM_NAME.fullmatch(name) or name in ('true', 'false'):
            raise RegistrationError(f'enum constant [{name}]: a name consists of letters, digits and _')
        known = self._enums.setdefault(name, int(value))
        if known != value:
            raise RegistrationError(f'enum constant [{name}] is registered already, as {known}; it cannot be {value}')
        self._scripts = weakref.WeakValueDictionary()

    def script(self, text: str) -> CompiledScript:
        """The script of this text, shared by all who have it. Raises ScriptError when the text is no script."""
        script = self._scripts.get(text)
        if script is None:
            # Not all at the same moment: to make code takes time.
            warm_up = self._warm_up + len(self._scripts) % self._warm_up
            script = self._scripts[text] = CompiledScript(text, dict(self._enums), warm_up)
        return script


def _offset(statement: Expression) -> int:
    return statement.offsets[0] if isinstance(statement, Comparison) else statement.offset
