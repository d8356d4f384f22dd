# SPDX-License-Identifier: BSD-3-Clause
"""Random sound missions as trees and as machines, and variants with one defect that a proof must find."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.ports import STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import IDLE, RUNNING, NodeStatus
from flexbt_core.behavior_tree.nodes import sequences, timing
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.monitors.requirements import After, Before, Requirement, While
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import StateDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_formal.exploration.machine_system import MachineSystem
from flexbt_formal.exploration.state_models import StateModel, StateModelKind, state_model
from flexbt_formal.exploration.tree_system import TreeSystem

DEFECTS: Final = ('memory', 'forgotten cancel', 'lost wake-up', 'two owners', 'unwritten key', 'endless attempts')
"""Names of the defects of a tree, in this order:

- a Sequence in place of a ReactiveSequence;
- a control that does not halt a sibling;
- a delay that sets no timer;
- a Parallel in place of a sequence;
- a plan that may be left out;
- retries without a limit, which continue after a server is gone.
"""


class StandIn(StatefulAction):
    """A stand-in for real work; a proof never starts it."""

    def on_start(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')

    on_running = on_start

    def on_halted(self) -> None:
        raise AssertionError('a proof runs no real leaf')


class Plan(StandIn):
    ports = {'path': output_port(STRING)}


class Drive(StandIn):
    skill = Skill.of(resources=['base'])
    ports = {'path': input_port(STRING)}


class Turn(StandIn):
    skill = Skill.of(resources=['base'])


class Speak(StandIn):
    pass


class IsClear(Condition):
    def tick(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')


class ForgetfulFallback(sequences.ReactiveFallback):
    """A fallback that returns the result of a condition but leaves the running child as it is."""

    __slots__ = ()

    def reset_children(self) -> None:
        """Forget the running child without halting it: the defect."""

    def execute(self) -> NodeStatus:
        status = super().execute()
        if status is not RUNNING:
            for child in self.children:
                if child.status is not RUNNING:
                    child.status = IDLE
        return status


class DeafDelay(timing.Delay):
    """A decorator that waits for a time but never requests a wake-up."""

    __slots__ = ('_until',)

    def execute(self) -> NodeStatus:
        if not self._begun:
            self._begun = True
            self._until = self.clock.now() + 0.01
        if self.clock.now() < self._until:
            self.status = RUNNING
            return RUNNING
        status = self._tick()
        if status in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
            self._begun = False
            self.child.status = IDLE
        self.status = status
        return status


class SeededTree(NamedTuple):
    """A tree, its requirements, and its defect ('' for none)."""

    xml: str
    requirements: tuple[While, ...]
    defect: str

    def system(self) -> TreeSystem:
        """Return the tree with its environment."""
        registry = _registry()
        library = TreeLibrary([load_xml(self.xml, 'seeded.xml', registry)])
        return TreeSystem(library, TreeKey('seeded.xml', 'Main'), requirements=self.requirements)


def _registry() -> NodeRegistry:
    registry = builtin_registry()
    registry.register_classes([Plan, Drive, Turn, Speak, IsClear, ForgetfulFallback, DeafDelay])
    return registry


def seeded_tree(seed: int, defect: str = '') -> SeededTree:
    """Return a tree of 3 to 5 stages that plan, drive, turn or speak. With ``defect``, one of them is wrong."""
    chance = random.Random(seed)
    number = chance.randint(3, 5)
    bad = chance.randrange(number) if defect else None
    guards: list[While] = []
    stages = [_stage(chance, place, defect if place == bad else '', guards) for place in range(number)]
    body = f'<Sequence>{"".join(stages)}</Sequence>'
    if chance.random() < 0.5:
        body = f'<RetryUntilSuccessful num_attempts="2">{body}</RetryUntilSuccessful>'
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return SeededTree(xml, tuple(guards), defect)


def _stage(chance: random.Random, place: int, defect: str, guards: list[While]) -> str:
    kinds: Sequence[str] = (defect,) if defect else DEFECTS
    kind = chance.choice(kinds)
    path = f'path_{place}'
    plan = f'<Plan path="{{{path}}}"/>'
    drive = f'<Drive name="drive_{place}" path="{{{path}}}"/>'
    if kind == 'memory':
        guards.append(While(f'drive_{place}', f'clear_{place}'))
        control = 'Sequence' if defect else 'ReactiveSequence'
        return f'{plan}<{control}><IsClear name="clear_{place}"/>{drive}</{control}>'
    if kind == 'forgotten cancel':
        control = 'ForgetfulFallback' if defect else 'ReactiveFallback'
        return f'{plan}<{control}><IsClear name="there_{place}"/>{drive}</{control}>'
    if kind == 'lost wake-up':
        delay = 'DeafDelay' if defect else 'Delay'
        return f'<{delay} delay_msec="10"><Speak name="speak_{place}"/></{delay}>'
    if kind == 'two owners':
        turn = f'<Turn name="turn_{place}"/>'
        both = f'{drive}{turn}' if chance.random() < 0.5 else f'{turn}{drive}'
        return (
            f'{plan}<Parallel success_count="2">{both}</Parallel>' if defect else f'{plan}<Sequence>{both}</Sequence>'
        )
    if kind == 'endless attempts':
        number = -1 if defect else 2
        return f'{plan}<RetryUntilSuccessful num_attempts="{number}">{drive}</RetryUntilSuccessful>'
    attempts = f'<RetryUntilSuccessful num_attempts="2">{plan}</RetryUntilSuccessful>'
    return (f'<ForceSuccess>{attempts}</ForceSuccess>' if defect else attempts) + drive


# Random sound missions as machines, and variants with one transition to the wrong target.


class _Work(EventState):
    """A stand-in for real work; a proof never starts it."""

    def __init__(self, reads: str = '', writes: str = '') -> None:
        super().__init__(['done', 'failed'], reads.split(), writes.split(), desired_rate=None)

    def halting(self) -> str | None:
        return None


class _Judge(EventState):
    def __init__(self) -> None:
        super().__init__(['accepted', 'refused'], desired_rate=None)


class SeededMachine(NamedTuple):
    """A mission, its requirements, and the transition with a wrong target ('' for none).

    ``machine`` is None if the engine rejects the defect, before anything is explored.
    """

    machine: OperatableStateMachine | None
    requirements: tuple[Requirement, ...]
    defect: str

    def system(self) -> MachineSystem:
        """Return the machine with its environment."""
        assert self.machine is not None
        return MachineSystem(define(self.machine), _model, requirements=self.requirements)


def _model(definition: StateDefinition) -> StateModel:
    if isinstance(definition.state, _Judge):
        return StateModel(StateModelKind.DECISION)
    return state_model(definition)


def seeded_machine(seed: int, *, is_defective: bool = False) -> SeededMachine:
    """Return a mission of 2 to 4 legs: plan, maybe have the plan judged, drive. Failures lead to a recovery."""
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
        # As an engineer would write them: each leg needs its plan and its judge, in order; failures lead to a recovery.
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
