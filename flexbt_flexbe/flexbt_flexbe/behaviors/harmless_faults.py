# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE lets pass in a state machine and the engine's check does not, although it does no harm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flexbt_core.state_machine import Child, OperatableStateMachine, StateKind


def without_harmless_faults(machine: OperatableStateMachine, warn: Callable[[str], None], path: str = '') -> None:
    """Take out of a machine, and of those in it, what has no effect; ``warn`` is told of everything.

    These are states that no transition leads to, and levels of autonomy, transitions and remappings of what a state
    does not have.
    """
    if machine.kind is not StateKind.CONCURRENCY:
        reached = _reached(machine)
        for child in machine.children:
            if child.label not in reached:
                warn(f'{path}/{child.label}: left out, since no transition leads to it from the initial state')
        machine.children[:] = [child for child in machine.children if child.label in reached]
    machine.children[:] = [_without_unknown_names(child, warn, f'{path}/{child.label}') for child in machine.children]
    for child in machine.children:
        if isinstance(child.state, OperatableStateMachine):
            without_harmless_faults(child.state, warn, f'{path}/{child.label}')


def _reached(machine: OperatableStateMachine) -> set[str]:
    children = {child.label: child for child in machine.children}
    reached: set[str] = set()
    ahead = [child.label for child in machine.children[:1]]
    while ahead:
        label = ahead.pop()
        if label in children and label not in reached:
            reached.add(label)
            ahead += children[label].transitions.values()
    return reached


def _without_unknown_names(child: Child, warn: Callable[[str], None], path: str) -> Child:
    outcomes = child.state.outcomes
    keys = {*child.state.input_keys, *child.state.output_keys}
    for what, names, known in (
        ('transition', child.transitions, outcomes),
        ('autonomy', child.autonomy, outcomes),
        ('remapping', child.remapping, keys),
    ):
        for name in names:
            if name not in known:
                warn(f'{path}: its {what} of {name!r} has no effect, since it has nothing of that name')
    return replace(
        child,
        transitions={name: target for name, target in child.transitions.items() if name in outcomes},
        autonomy={name: level for name, level in child.autonomy.items() if name in outcomes},
        remapping={name: key for name, key in child.remapping.items() if name in keys},
    )
