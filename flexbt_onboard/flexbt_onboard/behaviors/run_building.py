# SPDX-License-Identifier: BSD-3-Clause
"""Construction of a run: from a request to a checked machine with its inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from flexbt_common.values.entries import from_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.resume import RunPosition
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_msgs.msg import BehaviorStructure, BlackboardEntry, StateStructure
from flexbt_onboard.errors import BehaviorError, CommandRefusedError, ManifestError, ParameterError

from .behavior import Behavior, OperatorGone
from .behavior_library import BehaviorEntry, BehaviorLibrary

_HIGHEST_AUTONOMY: Final = 3


@dataclass(frozen=True)
class RunRequest:
    """A request for a run.

    ``arguments`` are pairs of parameter name and text. ``inputs`` go to the userdata of the root machine. ``by`` is
    the operator or program that asks for the run, and ``command_id`` the command of an operator. ``at`` is the
    position from which the run resumes after a crash. A run that is not ``is_durable`` does not resume, since nobody
    waits for its result any more. ``queue_entry`` is the number of the entry of the mission queue, 0 for none.
    """

    entry: BehaviorEntry
    arguments: Sequence[tuple[str, str]]
    inputs: Sequence[BlackboardEntry]
    autonomy: int
    by: str = ''
    command_id: str | None = None
    at: RunPosition | None = None
    is_durable: bool = True
    queue_entry: int = 0


def run_request(
    library: BehaviorLibrary,
    behavior: str,
    arguments: Sequence[tuple[str, str]],
    inputs: Sequence[BlackboardEntry],
    autonomy: int,
    by: str,
    command_id: str | None = None,
    *,
    is_durable: bool = True,
) -> RunRequest:
    """Return the request for a run of a behavior of the library.

    Raises:
        CommandRefusedError: the behavior is unknown or broken, or the autonomy level does not exist.
    """
    try:
        entry = library.find(behavior)
    except BehaviorError as error:
        raise CommandRefusedError(str(error)) from error
    if entry.error:
        raise CommandRefusedError(f'behavior {entry.name!r} is broken: {entry.error}')
    level = checked_autonomy(autonomy)
    return RunRequest(entry, tuple(arguments), tuple(inputs), level, by, command_id, is_durable=is_durable)


def check_given(request: RunRequest) -> None:
    """Check arguments and inputs of a later run, as far as that needs no machine.

    Raises:
        CommandRefusedError: a parameter is unknown, given twice or does not accept its text, or an input is given
            twice or cannot be converted.
    """
    known = {one.name: one for one in request.entry.parameters}
    given = [name for name, _ in request.arguments]
    try:
        for name, text in request.arguments:
            if given.count(name) > 1:
                raise ParameterError(f'parameter {name!r} is given twice')
            if '/' in name:
                continue  # of an embedded behavior
            if name not in known:
                near = did_you_mean(name, known)
                raise ParameterError(f'behavior {request.entry.name!r} has no parameter {name!r}{near}')
            known[name].from_text(text)
        _values_of(request.inputs)
    except FlexbtError as error:
        raise CommandRefusedError(str(error)) from error


def checked_autonomy(level: int) -> int:
    """Check an autonomy level and return it.

    Raises:
        CommandRefusedError: the level does not exist.
    """
    if level > _HIGHEST_AUTONOMY:
        raise CommandRefusedError(f'autonomy {level} is none of 0 Off, 1 Low, 2 High, 3 Full')
    return level


def build(request: RunRequest) -> tuple[Behavior, MachineDefinition]:
    """Make the behavior and its checked machine. The code of the behavior may raise any exception.

    Raises:
        ParameterError: an argument is not valid, or the result is not a machine.
        ManifestError: ``operator_gone`` or ``operator_gone_after`` of the behavior is not valid.
        MachineError: the machine has errors.
    """
    behavior = request.entry.instantiate()
    behavior.set_arguments(request.arguments)
    gone, after = behavior.operator_gone, behavior.operator_gone_after
    if not isinstance(gone, OperatorGone) or not isinstance(after, int | float) or not 0.0 < after < math.inf:
        raise ManifestError(
            f'behavior {behavior.name!r}: operator_gone has to be an OperatorGone, and operator_gone_after a number of '
            f'seconds above 0, not {gone!r} and {after!r}'
        )
    return behavior, definition_of(behavior)


def definition_of(behavior: Behavior) -> MachineDefinition:
    """Return the checked machine that a behavior creates. The code of the behavior may raise any exception.

    Raises:
        ParameterError: the result is not a machine.
        MachineError: the machine has errors.
    """
    machine: Any = behavior.create()
    if isinstance(machine, MachineDefinition):
        return machine  # checked when it was made
    if not isinstance(machine, OperatableStateMachine):
        raise ParameterError(
            f'create() has to return an OperatableStateMachine or a MachineDefinition, not {short_repr(machine)}'
        )
    return define(machine)


def structure_message(definition: MachineDefinition, run_id: str, behavior: str) -> BehaviorStructure:
    """Return the structure of a run for the consoles."""
    return BehaviorStructure(
        run_id=run_id,
        behavior=behavior,
        states=[
            StateStructure(
                path=entry.path,
                kind=entry.kind.value,
                type=entry.type_name,
                children=list(entry.children),
                outcomes=list(entry.outcomes),
                targets=list(entry.targets),
                autonomy=list(entry.autonomy),
            )
            for entry in definition.structure()
        ],
    )


def checked_inputs(definition: MachineDefinition, inputs: Sequence[BlackboardEntry]) -> dict[str, Any]:
    """Return the values of the inputs by userdata key.

    Every key that the machine reads and has no default for must be among them.

    Raises:
        ParameterError: an input is missing, unknown or given twice.
        FlexbtError: a value cannot be converted.
    """
    accepted = {*definition.input_keys, *definition.defaults}
    for entry in inputs:
        if entry.key not in accepted:
            known = ', '.join(sorted(accepted)) or 'none'
            raise ParameterError(f'input {entry.key!r} is not a userdata key of the behavior; it takes: {known}')
    values = _values_of(inputs)
    for key in definition.read_inputs:
        if key not in values and key not in definition.defaults:
            raise ParameterError(f'input {key!r} is needed and has no default; give it with the start')
    return values


def _values_of(inputs: Sequence[BlackboardEntry]) -> dict[str, Any]:
    """Return the values of inputs by key.

    Raises:
        ParameterError: an input is given twice.
        FlexbtError: a value cannot be converted.
    """
    values: dict[str, Any] = {}
    for entry in inputs:
        if entry.key in values:
            raise ParameterError(f'input {entry.key!r} is given twice')
        values[entry.key] = from_entry(entry)
    return values
