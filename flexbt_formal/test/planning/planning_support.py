# SPDX-License-Identifier: BSD-3-Clause
"""Worlds in which the trees of plans run: they do what the model says, or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.ports import STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_formal.planning.problem import Action, Leaf, PlanningProblem
from flexbt_formal.planning.tree_xml import FAILURE_ENTRY


def action(name: str, needs: str, adds: str, deletes: str, cost: float = 1.0) -> Action:
    return Action(name, frozenset(needs.split()), frozenset(adds.split()), frozenset(deletes.split()), cost)


def led_by(problem: PlanningProblem, attempts: int = 2) -> PlanningProblem:
    """Return the problem with leaves that the world knows."""
    every = (*problem.actions, *problem.disturbances)
    literals = {literal for one in every for literal in one.needs | one.adds | one.deletes}.union(*problem.goal)
    leaves = {literal: Leaf('Holds', {'literal': literal}) for literal in literals}
    leaves |= {one.name: Leaf('Do', {'action': one.name}, attempts=attempts) for one in problem.actions}
    return replace(problem, leaves=leaves)


@dataclass
class World:
    """Carries out actions: they take as many ticks as ``lasts`` says, and then have their effects, unless one ``fails``
    or is ``idle``. A tick takes a second."""

    problem: PlanningProblem
    true: set[str]
    fails: Callable[[str], bool] = lambda name: False
    idle: Callable[[str], bool] = lambda name: False
    lasts: Callable[[str], int] = lambda name: 1
    done: list[str] = field(default_factory=list)
    started: list[str] = field(default_factory=list)
    reason: object = None
    ticks: int = 0
    tree: Tree | None = None
    clock: ManualClock = field(default_factory=ManualClock)

    def run(self, xml: str, before: Callable[[int], None] = lambda tick: None, most: int = 500) -> NodeStatus:
        world = self
        actions = {one.name: one for one in self.problem.actions}

        class Holds(Condition):
            ports = {'literal': input_port(STRING)}

            def tick(self) -> NodeStatus:
                return NodeStatus.SUCCESS if self.get_input('literal') in world.true else NodeStatus.FAILURE

        class Do(StatefulAction):
            ports = {'action': input_port(STRING)}
            left = 0

            def on_start(self) -> NodeStatus:
                name = self.get_input('action')
                world.started.append(name)
                self.left = world.lasts(name)
                assert actions[name].needs <= world.true, f'{name} without what it needs'
                return NodeStatus.RUNNING

            def on_running(self) -> NodeStatus:
                name = self.get_input('action')
                self.left -= 1
                if self.left > 0:
                    return NodeStatus.RUNNING
                if world.fails(name):
                    return NodeStatus.FAILURE
                if not world.idle(name):
                    world.true = (world.true - actions[name].deletes) | actions[name].adds
                world.done.append(name)
                return NodeStatus.SUCCESS

            def on_halted(self) -> None:
                pass

        registry = builtin_registry()
        registry.register('Holds', Holds)
        registry.register('Do', Do)
        library = TreeLibrary().stage([load_xml(xml, 'plan.xml', registry)])
        self.tree = tree = Tree(library, 'Plan', clock=self.clock)
        for number in range(most):
            self.ticks = number + 1
            before(number)
            self.clock.advance(1.0)
            status = tree.tick_once()
            if status is not NodeStatus.RUNNING:
                self.reason = tree.blackboard.get(FAILURE_ENTRY)
                return status
        raise AssertionError(f'the tree still runs; done: {self.done[-20:]}')
