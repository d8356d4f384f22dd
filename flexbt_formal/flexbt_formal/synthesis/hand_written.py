# SPDX-License-Identifier: BSD-3-Clause
"""Complete specifications written by hand: only the formulas of the request are added.

Capabilities are the outputs ``NAME_a``, their outcomes the inputs ``NAME_c``, ``NAME_f`` and so on; or, where there is
an output ``capability``, its values, and the outcomes by their full names. A capability file says which states they
are; without one each is a state of the same name, with normalized outcomes.
"""

from __future__ import annotations

from typing import Final

from .capabilities import DEFAULT_OUTCOMES, Capability, CapabilityFile, Interfaces, Mappings, StateInterface
from .errors import SynthesisError
from .request_files import FAILURE_OUTCOMES, MachineRequest, SpecificationFile
from .specification import Section
from .translation import CAPABILITY, Options, SynthesisProblem, Translation, Vocabulary, suffixes

BEGIN: Final = 'begin_game'
"""A capability by which specifications begin; it is not a state."""


def is_whole(given: SpecificationFile, capabilities: CapabilityFile) -> bool:
    """Return whether a specification says what the system may do, and has activations with their outcomes, so that it
    needs no others. It need not have all capabilities."""
    inputs = {one.name for one in given.variables.values() if one.is_input}
    told = suffixes(capabilities.mappings.transition_outcomes).values()
    activated = {*_activated(given)} & capabilities.capabilities.keys()
    named = CAPABILITY in given.variables or any(f'{name}_{end}' in inputs for name in activated for end in told)
    return named and any(section is Section.SYS_TRANS and lines for section, lines in given.formulas.items())


def hand_written(
    given: SpecificationFile,
    request: MachineRequest,
    capabilities: CapabilityFile | None = None,
    interfaces: Interfaces | None = None,
) -> SynthesisProblem:
    """Return the problem of a complete specification.

    Raises:
        SynthesisError: with everything that does not fit together, each with its place.
    """
    if capabilities is None or interfaces is None:
        capabilities, interfaces = _states_of_their_own(given)
    return _HandWritten(capabilities, interfaces, request, given, Options()).made()


def _states_of_their_own(given: SpecificationFile) -> tuple[CapabilityFile, Interfaces]:
    ends = suffixes(DEFAULT_OUTCOMES)
    outcomes = {
        name: tuple(one for one in DEFAULT_OUTCOMES if f'{name}_{ends[one]}' in given.variables)
        for name in _activated(given)
    }
    if not outcomes:
        raise SynthesisError(
            [f'{given.source}: no output is called NAME_a: name activations so, or give a capability file with labels']
        )
    mappings = Mappings({one: one for one in DEFAULT_OUTCOMES}, {'finished': 'finished'}, DEFAULT_OUTCOMES)
    capabilities = {name: Capability(name, name, 1) for name in outcomes}
    file = CapabilityFile(given.source, given.name, capabilities, mappings)
    return file, lambda name, parameters: StateInterface(outcomes[name])


def _activated(given: SpecificationFile) -> list[str]:
    outputs = [variable.name for variable in given.variables.values() if not variable.is_input]
    return [name.removesuffix('_a') for name in outputs if name.endswith('_a') and name != f'{BEGIN}_a']


class _HandWritten(Translation):
    def _named(self) -> Vocabulary:
        file, variables = self._file, self._given.variables
        outcomes = file.mappings.transition_outcomes
        ends = suffixes(outcomes)
        numbers = self._numbers() if CAPABILITY in variables else None
        named = list(numbers) if numbers is not None else _activated(self._given)
        told: dict[str, tuple[str, ...]] = {}
        for name in named:
            if name not in file.capabilities:
                self._problems.append(
                    f"{self._given.source}: '{name}' is activated, and {file.source} has no capability of that name"
                )
                continue
            inputs = {one: one if numbers is not None else f'{name}_{ends[one]}' for one in outcomes}
            told[name] = tuple(one for one in outcomes if inputs[one] in variables)
            own = {file.mappings.state_outcomes[one] for one in self._interfaces[name].outcomes}
            for one in told[name] if numbers is None else ():
                if one not in own:
                    self._notes.append(
                        f"{name}: {file.capabilities[name].interface} has no outcome that counts as '{one}'; what the "
                        'specification says of that is without effect'
                    )
        for name in file.capabilities.keys() - set(named):
            self._notes.append(f'{name}: the specification does not activate it')
        if self._problems:
            raise SynthesisError(self._problems)
        return Vocabulary(told, ends, self._ends(), numbers)

    def _numbers(self) -> dict[str, int]:
        """Return which value of ``capability`` stands for which one: by labels, else in alphabetical order from 1."""
        labels = self._file.labels.get(CAPABILITY, {})
        known = {label: number for number, label in labels.items() if label in self._file.capabilities}
        return known or {name: number for number, name in enumerate(sorted(self._file.capabilities), 1)}

    def _ends(self) -> dict[str, str]:
        """Return those of the request, and the failures by which the specification ends; without a request all of
        it."""
        mapped = {**{one: one for one in sorted(FAILURE_OUTCOMES)}, **self._file.mappings.machine_outcomes}
        outputs = {one.name for one in self._given.variables.values() if not one.is_input}
        asked = super()._ends() if self._request.outcomes else {}
        own = {outcome: proposition for outcome, proposition in mapped.items() if proposition in outputs}
        return {**asked, **{one: own[one] for one in own if not asked or one in FAILURE_OUTCOMES}}

    def _remembered(self) -> dict[str, bool]:
        return {name.removesuffix('_m'): False for name in self._given.variables if name.endswith('_m')}

    def _declare(self) -> None:
        self._variables |= self._given.variables
        self._own = set()
        for outcome, proposition in self._vocabulary.ends.items():
            if proposition not in self._variables:
                self._problem(
                    None, f"the machine is to have the outcome '{outcome}'; no output is called '{proposition}'"
                )

    def _rules(self) -> None:
        """Add nothing: the specification is complete."""

    def _strive(self, goals: list[tuple[str, str]], success: str | None) -> None:
        if success is None:
            super()._strive(goals, success)

    def _promises(self) -> tuple[list[tuple[str, str]], str | None, list[str]]:
        return [], None, []
