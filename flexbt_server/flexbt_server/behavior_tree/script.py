# SPDX-License-Identifier: BSD-3-Clause
"""Scripts: parsed once, compiled once for all nodes that have the same one, and bound to the blackboard of a node."""

from __future__ import annotations

import re
import weakref
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from .blackboard import EMPTY, Blackboard
from .errors import ConversionError, RegistrationError, ScriptError
from .port_types import PortType
from .script_closures import ClosureCompiler, Scope
from .script_parser import Comparison, Expression, parse_script
from .script_specialization import Factory, NotSpecializable, Variable, specialize, variable_of
from .script_values import Value, truth

WARM_UP: Final = 8
_MOST_FACTORIES: Final = 16
_ENUM_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


class CompiledScript:
    """A script, independent of nodes and blackboards. Made by :class:`ScriptLibrary`."""

    __slots__ = ('__weakref__', '_closures', '_enums', '_factories', '_names', '_statements', 'text', 'warm_up')

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        """Raises ScriptError when the text is no script. The empty text is one that does nothing."""
        self.text = text
        self.warm_up = warm_up
        self._enums = enums
        self._statements = parse_script(text)
        compiler = ClosureCompiler(text, enums)
        self._closures = tuple(map(compiler.compile, self._statements))
        self._names = compiler.names
        self._factories: dict[tuple[bool, tuple[Variable, ...]], Factory | None] = {}

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
        return Scope(board, len(self._names))

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

    def factory(self, variables: tuple[Variable, ...], condition: bool) -> Factory | None:
        """What makes the code for entries of these kinds; None when that is for the closures."""
        key = condition, variables
        if key not in self._factories:
            if len(self._factories) >= _MOST_FACTORIES:
                self._factories.clear()
            named = dict(zip(self._names, variables, strict=True))
            try:
                made: Factory | None = specialize(self._statements, named, self._enums, condition=condition)
            except NotSpecializable:
                made = None
            self._factories[key] = made
        return self._factories[key]


SCRIPT: Final = PortType('script', CompiledScript)
"""The type of a literal that is a script. Only the reader of a file can make it, since it knows the enum constants."""
CONDITION: Final = PortType('condition', CompiledScript)
"""As SCRIPT, for scripts of which the truth is asked, and that cannot be empty."""


class BoundScript:
    """A script on a blackboard. ``run()`` runs it; of a condition it gives the truth, otherwise None.

    It raises ScriptError. What the script has done before that stays done.
    """

    __slots__ = ('_condition', '_countdown', '_scope', '_script', 'run')

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        self._script = script
        self._condition = condition
        self._scope = script.scope(board)
        self._countdown = script.warm_up
        self.run: Callable[[], bool | None] = self._warm_up

    @property
    def text(self) -> str:
        return self._script.text

    def _evaluate(self) -> bool | None:
        value = self._script.evaluate(self._scope)
        return self._script.truth(value) if self._condition else None

    def _warm_up(self) -> bool | None:
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self._script.warm_up
            self._specialize()
        return self._evaluate()

    def _specialize(self) -> None:
        """Makes the code for what the entries hold, if there is such code; otherwise it is tried again some time."""
        entries = self._scope.entries
        variables = tuple(variable for entry in entries if (variable := variable_of(entry)) is not None)
        # Two names of one entry: a local variable of the code could not stand for it.
        if len(variables) < len(entries) or len(set(map(id, entries))) < len(entries):
            return
        factory = self._script.factory(variables, self._condition)
        if factory is not None:
            self.run = factory(self._slow, entries, [entry.type for entry in entries])

    def _slow(self) -> bool | None:
        """What the code calls when it is not made for what it finds."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self._script.warm_up
            self.run = self._warm_up
        return self._evaluate()


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
            script = self._scripts[text] = CompiledScript(text, dict(self._enums), self._warm_up)
        return script


def _offset(statement: Expression) -> int:
    return statement.offsets[0] if isinstance(statement, Comparison) else statement.offset
