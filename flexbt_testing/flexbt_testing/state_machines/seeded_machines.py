# SPDX-License-Identifier: BSD-3-Clause
"""Random sound missions as machines, and the same with one transition that leads elsewhere."""

from __future__ import annotations

import random
from typing import NamedTuple

from flexbt_core.monitors import After, Before, Requirement
from flexbt_core.state_machine import (
    EventState,
    MachineError,
    OperatableStateMachine,
    StateDefinition,
    define,
)
from flexbt_formal.exploration import MachineSystem, StateKind, StateModel, state_model


class _Work(EventState):
    """Stands for real work, which a proof never begins."""

    def __init__(self, reads: str = '', writes: str = '') -> None:
        super().__init__(['done', 'failed'], reads.split(), writes.split(), desired_rate=None)

    def halting(self) -> str | None:
        return None


class _Judge(EventState):
    def __init__(self) -> None:
        super().__init__(['accepted', 'refused'], desired_rate=None)


class SeededMachine(NamedTuple):
    """A mission, what it requires, and which transition leads elsewhere ('' for none).

    ``machine`` is None where the engine refuses the defect already, before anything is explored.
    """

    machine: OperatableStateMachine | None
    requirements: tuple[Requirement, ...]
    defect: str

    def system(self) -> MachineSystem:
        """The machine with its environment."""
        assert self.machine is not None
        return MachineSystem(define(self.machine), _model, requirements=self.requirements)


def _model(definition: StateDefinition) -> StateModel:
    if isinstance(definition.state, _Judge):
        return StateModel(StateKind.DECISION)
    return state_model(definition)


def seeded_machine(seed: int, *, is_defective: bool = False) -> SeededMachine:
    """A mission of 2 to 4 legs: plan, perhaps have the plan judged, drive; what fails is recovered from."""
    chance = random.Random(seed)
    legs = chance.randint(2, 4)
    ways: dict[tuple[str, str], str] = {}
    states: dict[str, EventState] = {}
    requirements: list[Requirement] = []
    before = ''
    for leg in range(legs):
        plan, judge, drive = f'Plan{leg}', f'Judge{leg}', f'Drive{leg}'
        is_judged = chance.random() < 0.5
        follows = f'Plan{leg + 1}' if leg + 1 < legs else 'finished'
        states[plan] = _Work(writes=f'path{leg}')
        ways[plan, 'done'] = judge if is_judged else drive
        ways[plan, 'failed'] = 'Recover'
        if is_judged:
            states[judge] = _Judge()
            ways[judge, 'accepted'], ways[judge, 'refused'] = drive, plan
        states[drive] = _Work(reads=f'path{leg}')
        ways[drive, 'done'], ways[drive, 'failed'] = follows, 'Recover'
        # What an engineer would write: no leg without its plan and its judge, in order; failures are recovered from.
        requirements += [Before(f'/{drive}', f'/{judge} > accepted' if is_judged else f'/{plan} > done', again=True)]
        requirements += [After(f'/{one} > failed', ('/Recover',)) for one in (plan, drive)]
        if is_judged:
            requirements.append(After(f'/{judge} > refused', (f'/{plan}',)))
        if before:
            requirements.append(Before(f'/{plan}', f'/{before} > done'))
        before = drive
    states['Recover'] = _Work()
    ways['Recover', 'done'], ways['Recover', 'failed'] = 'Plan0', 'failed'
    requirements += [Before('=finished', f'/{before} > done'), Before('=failed', '/Recover > failed')]
    defect = ''
    if is_defective:
        place = chance.choice(sorted(ways))
        target = chance.choice(sorted({*states, 'finished', 'failed'} - {ways[place]}))
        defect = f'{place[0]} > {place[1]}: {target} instead of {ways[place]}'
        ways[place] = target
    try:
        machine = _machine(states, ways)
        define(machine)
    except MachineError:
        return SeededMachine(None, tuple(requirements), defect)
    return SeededMachine(machine, tuple(requirements), defect)


def _machine(states: dict[str, EventState], ways: dict[tuple[str, str], str]) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        for label, state in states.items():
            OperatableStateMachine.add(
                label, state, transitions={outcome: ways[label, outcome] for outcome in state.outcomes}
            )
    return machine
