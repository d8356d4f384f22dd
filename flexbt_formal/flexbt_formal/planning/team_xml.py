# SPDX-License-Identifier: BSD-3-Clause
"""A plan for several robots as trees: one for each robot, and one that runs them all.

::

    Sequence
      Script                            nobody is lost
      Fallback
        ReactiveSequence
          Inverter(the goal)            when it holds, everything that runs is halted
          ReactiveFallback              not more actions than are allowed
          Parallel                      the trees of the robots
        ReactiveSequence(the goal)

    of a robot: KeepRunningUntilFailure
      ReactiveSequence
        ReactiveFallback                what it is to do: the branches, that with the least left first
          ReactiveSequence(conditions, Script)
        ReactiveFallback                it does that; an action goes on when another branch has it, too
          ReactiveSequence(is it this one?, RetryUntilSuccessful(action))

A robot whose action failed as often as it may be tried is lost from then on: ``lost_ROBOT`` on the blackboard, which
others may set, too. Then the branches without it are left.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from .policy import BranchRule, RuleGroup, actions_of
from .problem import PlanningProblem
from .team import TeamPlan, entry
from .team_policy import WAITS, TeamPolicy
from .tree_xml import (
    AGAIN_ENTRY,
    LAST_ENTRY,
    NOTHING_DONE,
    LeafWriter,
    actions_left,
    add,
    add_last_branch,
    allowed_actions,
    quoted,
)


def team_xml(plan: TeamPlan, name: str = 'Plan', most_actions: int | None = None) -> str:
    """Return the XML of the trees of a plan: ``name`` runs all robots, ``name_ROBOT`` is that of one.

    ``most_actions``: after this many actions that succeeded they give up; without it, after three times as many as the
    longest way that was tried.

    Raises:
        ValueError: the plan has no trees, since there is no plan.
        PlanningError: the type of a leaf, or a port, cannot stand in XML.
    """
    if plan.policy is None or plan.coverage is None:
        raise ValueError('there is no plan, and so no tree')
    if most_actions is None:
        most_actions = allowed_actions(plan.coverage)
    writer = _TeamWriter(plan.problem, plan.policy)
    robots = [(robot, entry(name, robot)) for robot in plan.policy.robots]
    trees = [writer.robot(robot, id, members) for (robot, id), members in zip(robots, plan.policy.members, strict=True)]
    return writer.document(name, [writer.team(name, robots, most_actions), *trees])


class _TeamWriter(LeafWriter):
    def __init__(self, problem: PlanningProblem, policy: TeamPolicy) -> None:
        super().__init__(problem, policy.domain)
        self._policy = policy

    def team(self, name: str, robots: Sequence[tuple[str, str]], most: int) -> ElementTree.Element:
        tree = ElementTree.Element('BehaviorTree', ID=name)
        top = add(tree, 'Sequence')
        begins = ''.join(
            f"; {entry('lost', robot)} := false; {entry('next', robot)} := ''"
            f"; {entry(LAST_ENTRY, robot)} := ''; {entry(AGAIN_ENTRY, robot)} := 0"
            for robot, _ in robots
        )
        add(top, 'Script', code=NOTHING_DONE + begins)
        ways = add(top, 'Fallback')
        step = add(ways, 'ReactiveSequence', name='until the goal holds')
        self.goal(add(step, 'Inverter'), self._policy.goals)
        actions_left(step, most)
        side_by_side = add(step, 'Parallel', name='the robots', success_count=str(len(robots)), failure_count='1')
        for robot, id in robots:
            add(side_by_side, 'SubTree', ID=id, name=robot, _autoremap='true')
        self.goal(ways, self._policy.goals)
        return tree

    def robot(self, robot: str, id: str, members: Sequence[BranchRule | RuleGroup]) -> ElementTree.Element:
        tree = ElementTree.Element('BehaviorTree', ID=id)
        both = add(add(tree, 'KeepRunningUntilFailure'), 'ReactiveSequence', name=robot)
        chosen, lost = entry('next', robot), entry('lost', robot)
        branches = add(both, 'ReactiveFallback', name=f'what {robot} is to do')
        for member in members:
            self._member(branches, chosen, member)
        add_last_branch(branches, 'no way to the goal is planned from here')
        done = add(both, 'ReactiveFallback', name=f'{robot} does it')
        for action in actions_of(members):
            if action == WAITS:
                continue
            step = add(done, 'ReactiveSequence')
            add(step, 'ScriptCondition', code=f"{chosen} == '{self._name(action)}'")
            # What it could not do is left to others in the next tick.
            own = {'last': entry(LAST_ENTRY, robot), 'again': entry(AGAIN_ENTRY, robot)}
            self.action(add(step, 'ForceSuccess'), action, lost, f'{lost} := true', **own)
        add(add(done, 'KeepRunningUntilFailure', name='others go on'), 'AlwaysSuccess')
        return tree

    def _member(self, parent: ElementTree.Element, chosen: str, member: BranchRule | RuleGroup) -> None:
        sequence = add(parent, 'ReactiveSequence')
        self.conditions(sequence, member.condition)
        if isinstance(member, RuleGroup):
            inner = add(sequence, 'ReactiveFallback')
            for one in member.members:
                self._member(inner, chosen, one)
        else:
            name = self._name(member.action)
            add(sequence, 'Script', name=name or 'others go on', code=f"{chosen} := '{name}'")

    def _name(self, action: int) -> str:
        return '' if action == WAITS else quoted(self._domain.actions[action].name)
