# SPDX-License-Identifier: BSD-3-Clause
"""The files that synthesis reads, and the interfaces of the installed states that they name."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.values.text import did_you_mean
from flexbt_formal.synthesis.capabilities import (
    Interfaces,
    Mappings,
    StateInterface,
    UnknownParameterError,
    read_capabilities,
    read_mappings,
)
from flexbt_formal.synthesis.hand_written import hand_written, is_whole
from flexbt_formal.synthesis.request_files import MachineRequest, read_specification
from flexbt_formal.synthesis.translation import Options, SynthesisProblem, translated
from flexbt_tools.errors import UsageError
from flexbt_tools.files import read_text_file

MAX_BYTES: Final = 4_000_000
"""Maximum size of a file of a synthesis, bytes."""

T = TypeVar('T')


@dataclass(frozen=True, slots=True)
class SynthesisFiles:
    """Names of files: capabilities, mappings (later ones count where several have an entry), specification.

    ``text`` are capabilities that are at hand, and how they are called; in place of a file of them.
    """

    capabilities: str | None
    mappings: Sequence[str] = ()
    specification: str | None = None
    text: tuple[str, str] | None = None


def read_problem(
    files: SynthesisFiles, request: MachineRequest, interfaces: Interfaces, options: Options
) -> SynthesisProblem:
    """Return what files and request ask for. A specification that is whole needs no capabilities.

    Raises:
        SynthesisError: with everything that is wrong in them, each with file and line.
        UsageError: a file cannot be read, or there is none.
    """
    given = None if files.specification is None else read(files.specification, read_specification)
    if files.capabilities is None and files.text is None:
        if given is None:
            raise UsageError('name a capability file, or a whole specification by --spec')
        return hand_written(given, request)
    mappings = _mappings(files.mappings)
    capabilities = (
        read(files.capabilities, lambda text, source: read_capabilities(text, source, mappings))
        if files.capabilities is not None
        else read_capabilities(*(files.text or ('', '')), mappings)
    )
    if given is not None and is_whole(given, capabilities):
        return hand_written(given, request, capabilities, interfaces)
    return translated(capabilities, interfaces, request, given, options)


def _mappings(names: Sequence[str]) -> Mappings:
    if not names:
        return Mappings(_USUAL, {'finished': 'finished'})
    mappings = Mappings()
    for name in names:
        mappings = mappings.updated(read(name, read_mappings))
    return mappings


_USUAL = {
    **dict.fromkeys(('done', 'finished', 'received', 'true'), 'completed'),
    **dict.fromkeys(
        ('aborted', 'canceled', 'data_error', 'empty', 'failed', 'false', 'no_connection', 'param_error', 'timeout'),
        'failure',
    ),
    'unavailable': 'failure',
}


def read(name: str, reader: Callable[[str, str], T]) -> T:
    """Return what a reader makes of a file. Raises UsageError when it cannot be read."""
    return reader(read_text_file(name, MAX_BYTES), name)


# What installed state classes declare.


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

    def __call__(self, name: str, parameters: Mapping[str, Any]) -> StateInterface:
        """Return what a state declares that is made with these parameters."""
        if name not in self._classes:
            if self._others is not None:
                return self._others(name, parameters)
            known = [one for one in self._classes if '/' not in one]
            raise LookupError(
                f"there is no state '{name}'{did_you_mean(name, known)}; --states names modules with more"
            )
        _refuse_unknown(name, self._classes[name], parameters)
        try:
            state = self._classes[name](**parameters)
        except Exception as error:  # code of the state
            raise ValueError(f'{name} cannot be made: {type(error).__name__}: {error}') from error
        return StateInterface(state.outcomes, state.input_keys, state.output_keys)


def _refuse_unknown(name: str, made: type[EventState], parameters: Mapping[str, Any]) -> None:
    """Raise UnknownParameterError, where the parameters of a class are known."""
    taken = inspect.signature(made).parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in taken):
        return
    known = [one.name for one in taken if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
    for parameter in parameters:
        if parameter not in known:
            raise UnknownParameterError(name, parameter, known)
