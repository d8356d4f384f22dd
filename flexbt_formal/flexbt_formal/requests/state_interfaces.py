# SPDX-License-Identifier: BSD-3-Clause
"""What installed state classes declare."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from typing import Any

from flexbt_core.state_machine import EventState
from flexbt_core.values import hint
from flexbt_formal.synthesis.inputs import Interface, Interfaces, UnknownParameterError
from flexbt_tools.errors import UsageError


class StateInterfaces:
    """The states of modules by their names; those of the last module count.

    A name may have the module before it: ``package/Name``. States that no module has are looked for in ``others``.
    """

    def __init__(self, modules: Sequence[str], others: Interfaces | None = None) -> None:
        self._others = others
        self._classes: dict[str, type[EventState]] = {}
        self._modules: dict[str, str] = {}
        for module in modules:
            try:
                found = importlib.import_module(module)
            except Exception as error:  # code of the module
                raise UsageError(f'--states {module}: {type(error).__name__}: {error}') from error
            for name, value in vars(found).items():
                if isinstance(value, type) and issubclass(value, EventState) and value is not EventState:
                    for known in (name, f'{module.partition(".")[0]}/{name}'):
                        self._classes[known] = value
                        self._modules[known] = module

    def module_of(self, name: str) -> str:
        """From where a state is imported."""
        return self._modules.get(name, 'my_states')

    def __call__(self, name: str, parameters: Mapping[str, Any]) -> Interface:
        """What a state declares that is made with these parameters."""
        if name not in self._classes:
            if self._others is not None:
                return self._others(name, parameters)
            known = [one for one in self._classes if '/' not in one]
            raise LookupError(f"there is no state '{name}'{hint(name, known)}; --states names modules with more")
        _refuse_unknown(name, self._classes[name], parameters)
        try:
            state = self._classes[name](**parameters)
        except Exception as error:  # code of the state
            raise ValueError(f'{name} cannot be made: {type(error).__name__}: {error}') from error
        return Interface(state.outcomes, state.input_keys, state.output_keys)


def _refuse_unknown(name: str, made: type[EventState], parameters: Mapping[str, Any]) -> None:
    """Raises UnknownParameterError, where the parameters of a class are known."""
    taken = inspect.signature(made).parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in taken):
        return
    known = [one.name for one in taken if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
    for parameter in parameters:
        if parameter not in known:
            raise UnknownParameterError(name, parameter, known)
