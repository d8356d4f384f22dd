# SPDX-License-Identifier: BSD-3-Clause
"""Scripts: parsed once, compiled once for all nodes that have the same one, and bound to the blackboard of a node."""

from __future__ import annotations

import re
import weakref
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from flexbt_core.behavior_tree.model import (
    EMPTY,
    Blackboard,
    ConversionError,
    PortType,
    RegistrationError,
    ScriptError,
    acceleration,
)

from .interpreter import ClosureCompiler, Scope
from .parser import Comparison, Expression, parse_script
from .values import Value, truth

WARM_UP: Final = 8
_ENUM_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


class CompiledScript:
    """A script, independent of nodes and blackboards. Made by :class:`ScriptLibrary`.

    ``names`` are the keys of the entries that it uses. ``warm_up`` is for what is installed as acceleration.
    """

    __slots__ = ('__weakref__', '_closures', 'enums', 'names', 'statements', 'text', 'warm_up')

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        """Raises ScriptError when the text is no script. The empty text is one that does nothing."""
        self.text = text
        self.warm_up = warm_up
        self.enums = enums
        self.statements = parse_script(text)
        compiler = ClosureCompiler(text, enums)
        self._closures = tuple(map(compiler.compile, self.statements))
        self.names = compiler.names

    def __repr__(self) -> str:
        return f'CompiledScript({self.text!r})'

    @property
    def empty(self) -> bool:
        """Whether it does nothing."""
        return not self.statements

    def bind(self, board: Blackboard, *, condition: bool = False) -> BoundScript:
        """The script on ``board``. Raises ScriptError when it is to be a ``condition``, and is empty."""
        if condition and self.empty:
            raise ScriptError(self.text, 0, 'the script is empty, and so is no condition')
        return acceleration().class_of(BoundScript)(self, board, condition=condition)

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
            raise ScriptError(self.text, _offset(self.statements[-1]), str(error), is_absent=error.is_absent) from None


SCRIPT: Final = PortType('script', CompiledScript)
"""The type of a literal that is a script. Only the reader of a file can make it, since it knows the enum constants."""
CONDITION: Final = PortType('condition', CompiledScript)
"""As SCRIPT, for scripts of which the truth is asked, and that cannot be empty."""


class BoundScript:
    """A script on a blackboard."""

    __slots__ = ('condition', 'scope', 'script')

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        self.script = script
        self.condition = condition
        self.scope = script.scope(board)

    def run(self) -> bool | None:
        """Runs the script; of a condition it gives the truth, otherwise None.

        Raises ScriptError. What the script has done before that stays done.
        """
        value = self.script.evaluate(self.scope)
        return self.script.truth(value) if self.condition else None


class ScriptLibrary:
    """The enum constants that scripts know, and the scripts that are in use.

    In a script the name of a constant means its number, and is no blackboard entry. A script knows the constants that
    were there when it was made.
    """

    def __init__(self, warm_up: int = WARM_UP) -> None:
        """``warm_up`` is the number of runs of a script on a blackboard before acceleration, if it is installed, makes
        code for what the script finds there, and of runs for which the code did not fit before it is made anew: many
        scripts run only a few times."""
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
            script = self._scripts[text] = acceleration().class_of(CompiledScript)(text, dict(self._enums), warm_up)
        return script


def _offset(statement: Expression) -> int:
    return statement.offsets[0] if isinstance(statement, Comparison) else statement.offset
