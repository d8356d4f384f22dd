# SPDX-License-Identifier: BSD-3-Clause
"""Scripts for which code is made when they run often; see ``script_specialization``."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, Final

from flexbt_core.behavior_tree.model import Blackboard, Entry
from flexbt_core.behavior_tree.script import BoundScript, CompiledScript

from .script_code import NotSpecializable, Variable, variable_of
from .script_specialization import Factory, specialize, specialize_post_conditions, specialize_pre_conditions

_MOST_FACTORIES: Final = 16


class SpecializedScript(CompiledScript):
    """A script with the code that was made of it, for the kinds of values that were met."""

    __slots__ = ('_factories',)

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        super().__init__(text, enums, warm_up)
        self._factories: dict[Hashable, Factory | None] = {}

    def factory(self, variables: Mapping[str, Variable], condition: bool) -> Factory | None:
        """What makes the code for entries of these kinds; None when that is for the closures."""

        def make() -> Factory:
            return specialize(self.statements, variables, self.enums, condition=condition)

        return self.made((condition, *variables.values()), make)

    def made(self, key: Hashable, make: Callable[[], Factory]) -> Factory | None:
        """What was made for this key."""
        if key not in self._factories:
            if len(self._factories) >= _MOST_FACTORIES:
                self._factories.clear()
            try:
                self._factories[key] = make()
            except NotSpecializable:
                self._factories[key] = None
        return self._factories[key]


def pre_conditions_factory(
    scripts: Sequence[SpecializedScript],
    decisive: Sequence[bool],
    variables: Mapping[str, Variable],
    *,
    ongoing: bool,
    forgetful: bool,
) -> Factory | None:
    """What makes the code that ticks a node with these pre-conditions, see ``specialize_pre_conditions``.

    None when that is for the closures. All scripts are of one library.
    """
    first = scripts[0]

    def make() -> Factory:
        conditions = [(script.statements, wanted) for script, wanted in zip(scripts, decisive, strict=True)]
        return specialize_pre_conditions(conditions, variables, first.enums, ongoing=ongoing, forgetful=forgetful)

    key = (*scripts[1:], *decisive, *variables.items(), ongoing, forgetful)
    return first.made(key, make)


def post_conditions_factory(
    sides: Sequence[Sequence[SpecializedScript] | None], variables: Mapping[str, Variable]
) -> Factory | None:
    """What makes the code that ticks a node with these post-conditions, see ``specialize_post_conditions``.

    None when that is for the closures. All scripts are of one library.
    """
    first = next(script for side in sides for script in side or ())

    def make() -> Factory:
        statements = [
            None if side is None else [statement for script in side for statement in script.statements]
            for side in sides
        ]
        return specialize_post_conditions(statements, variables, first.enums)

    key = (*(None if side is None else tuple(side) for side in sides), *variables.items())
    return first.made(key, make)


def kinds_of(entries: Mapping[str, Entry]) -> dict[str, Variable] | None:
    """The kinds of the entries that scripts use, by name; None when there is no code for one of them."""
    variables = {name: variable for name, entry in entries.items() if (variable := variable_of(entry)) is not None}
    return variables if len(variables) == len(entries) else None


class SpecializedBoundScript(BoundScript):
    """``run`` is the code for what the entries hold now, once it is made; before, and where it does not fit, the
    closures."""

    __slots__ = ('_countdown', 'run')

    script: Any

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        super().__init__(script, board, condition=condition)
        self._countdown = script.warm_up
        self.run: Callable[[], bool | None] = self._evaluate

    @property
    def entries(self) -> dict[str, Entry]:
        """The entries that the script uses, by name, as it found them in its last run."""
        return dict(zip(self.script.names, self.scope.entries, strict=True))

    def _evaluate(self) -> bool | None:
        """Runs the closures; also for the code that is made of them, when that does not fit."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self.script.warm_up
            self._specialize()
        return BoundScript.run(self)

    def _specialize(self) -> None:
        """Makes the code for what the entries hold now, if there is such code."""
        self.run = self._evaluate
        entries = self.scope.entries
        variables = kinds_of(self.entries)
        # Two names of one entry: a local variable of the code could not stand for it.
        if variables is not None and len(set(map(id, entries))) == len(entries):
            factory = self.script.factory(variables, self.condition)
            if factory is not None:
                self.run = factory(entries, [entry.type for entry in entries], self._evaluate)
