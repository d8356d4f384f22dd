# SPDX-License-Identifier: BSD-3-Clause
"""From a machine as it is written to the checked definition that can be run."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeVar

from flexbt_core.state_machine.checks import problems_of, problems_of_reads
from flexbt_core.state_machine.model import (
    ROOT_PATH,
    UNDECLARED,
    Child,
    Machine,
    MachineDefinition,
    MachineError,
    StateDefinition,
    StateKind,
    Transition,
    child_path,
)

_Key = TypeVar('_Key')
_Value = TypeVar('_Value')


def define(machine: Machine) -> MachineDefinition:
    """Check a machine as a whole and make its definition.

    Raises:
        MachineError: with every problem of it.
    """
    problems = list(problems_of(machine))
    if problems:
        raise MachineError(problems)
    definition = _define(machine, ROOT_PATH, '', {}, {})
    problems = list(problems_of_reads(definition))
    if problems:
        raise MachineError(problems)
    return definition


def _define(
    machine: Machine,
    path: str,
    label: str,
    transitions: Mapping[str, Transition],
    remap: Mapping[str, str],
) -> MachineDefinition:
    children: dict[str, StateDefinition | MachineDefinition] = {}
    labels = {child.label for child in machine.children}
    for child in machine.children:
        own = child_path(path, child.label)
        ways = {outcome: _transition(machine, labels, child, outcome) for outcome in child.state.outcomes}
        if isinstance(child.state, Machine):
            children[child.label] = _define(child.state, own, child.label, ways, child.remapping)
        else:
            children[child.label] = StateDefinition(
                own, child.label, child.state, _fixed(ways), _fixed(child.remapping)
            )
    return MachineDefinition(
        path=path,
        label=label,
        outcomes=machine.outcomes,
        input_keys=machine.input_keys,
        output_keys=machine.output_keys,
        defaults=_fixed(machine.userdata.values()),
        children=_fixed(children),
        initial=machine.children[0].label,
        transitions=_fixed(transitions),
        remap=_fixed(remap),
        type_name=type(machine).__name__,
        kind=machine.kind,
        conditions=machine.conditions,
    )


def _transition(machine: Machine, labels: set[str], child: Child, outcome: str) -> Transition:
    target = child.transitions.get(outcome)
    if machine.kind is StateKind.CONCURRENCY and target is None:  # drawn to what it contributes to
        ended = child.label, outcome
        target = next((one.outcome for one in machine.conditions if ended in one.children), None)
    level = child.autonomy.get(outcome, UNDECLARED)
    return Transition(target, None, level) if target in labels else Transition(None, target, level)


def _fixed(mapping: Mapping[_Key, _Value]) -> Mapping[_Key, _Value]:
    return MappingProxyType(dict(mapping))
