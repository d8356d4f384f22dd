# SPDX-License-Identifier: BSD-3-Clause
"""Random sound missions as trees, and the same with one defect: what a proof has to find."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Final, NamedTuple

from flexbt_core.behavior_tree import (
    Condition,
    NodeRegistry,
    NodeStatus,
    StatefulAction,
    TreeKey,
    TreeLibrary,
    builtin_registry,
    input_port,
    load_xml,
    output_port,
)
from flexbt_core.behavior_tree.model import IDLE, RUNNING, STRING
from flexbt_core.behavior_tree.nodes import reactive, timing
from flexbt_core.monitors import While
from flexbt_core.skills import Skill
from flexbt_formal.exploration import TreeSystem

DEFECTS: Final = ('memory', 'forgotten cancel', 'lost wake-up', 'two owners', 'unwritten key', 'endless attempts')
"""A Sequence where a ReactiveSequence was; a control that halts no sibling; a delay that sets no timer; a Parallel of
what was in sequence; a plan that may be left out; attempts without a limit, which go on when a server is gone."""


class StandIn(StatefulAction):
    """Stands for real work, which a proof never begins."""

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


class ForgetfulFallback(reactive.ReactiveFallback):
    """Takes the result of a condition, and leaves the child that runs as it is."""

    __slots__ = ()

    def reset_children(self) -> None:
        """The defect: nothing is halted, only forgotten."""

    def execute(self) -> NodeStatus:
        status = super().execute()
        if status is not RUNNING:
            for child in self.children:
                if child.status is not RUNNING:
                    child.status = IDLE
        return status


class DeafDelay(timing.Delay):
    """Waits for a time, and never asks to be woken at it."""

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
    """A tree, what it requires, and its defect ('' for none)."""

    xml: str
    requirements: tuple[While, ...]
    defect: str

    def system(self) -> TreeSystem:
        """The tree with its environment."""
        registry = _registry()
        library = TreeLibrary([load_xml(self.xml, 'seeded.xml', registry)])
        return TreeSystem(library, TreeKey('seeded.xml', 'Main'), requirements=self.requirements)


def _registry() -> NodeRegistry:
    registry = builtin_registry()
    registry.register_classes([Plan, Drive, Turn, Speak, IsClear, ForgetfulFallback, DeafDelay])
    return registry


def seeded_tree(seed: int, defect: str = '') -> SeededTree:
    """A tree of 3 to 5 stages, each plans, drives, turns or speaks; with ``defect`` one of them is wrong."""
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
