# SPDX-License-Identifier: BSD-3-Clause
"""A plan as a tree for BehaviorTree.CPP 4, Groot2 and FlexBT.

::

    Sequence
      Script                            plan_actions := 0; plan_last := ''; plan_failure := ''
      Fallback
        KeepRunningUntilFailure         one action after the other
          ReactiveSequence
            Inverter(the goal)          when it holds, whatever runs is halted, and the loop ends
            ReactiveFallback            not more actions than are allowed
            ReactiveFallback            the branches, the cheapest first; the last one says why it gives up
              ReactiveSequence(conditions, RetryUntilSuccessful(action))
        ReactiveSequence(the goal)

The tree succeeds when the goal holds. It fails when an action failed as often as it may be tried and no other branch
holds, when no branch holds, or after ``most_actions`` actions; ``plan_failure`` on the blackboard says which. An action
that succeeds without its effects is done again as often as it may be tried, and has failed then. One that has failed is
left to the other branches until another action has succeeded.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from flexbt_formal.planning.problems import Problem

from .compaction import Group, Rule, actions_of
from .leaf_elements import (
    AGAIN_ENTRY,
    COUNT_ENTRY,
    FAILURE_ENTRY,
    LAST_ENTRY,
    NOTHING_DONE,
    LeafWriter,
    actions_left,
    add,
    add_last_branch,
    allowed_actions,
)
from .planner import Plan
from .policy import Policy


def tree_xml(plan: Plan, name: str = 'Plan', most_actions: int | None = None) -> str:
    """The XML of a plan's tree.

    ``most_actions``: after so many actions that succeeded the tree gives up; without it, after three times as many as
    the longest way that was tried.

    Raises:
        ValueError: the plan has no tree, since there is no plan.
        PlanningError: the type of a leaf, or a port, cannot stand in XML.
    """
    if plan.policy is None or plan.coverage is None:
        raise ValueError('there is no plan, and so no tree')
    if most_actions is None:
        most_actions = allowed_actions(plan.coverage)
    writer = _Writer(plan.problem, plan.policy)
    return writer.document(name, [writer.tree(name, plan.members, most_actions)])


def tree_entries(plan: Plan) -> tuple[str, ...]:
    """The entries of the blackboard that a plan's tree has for itself."""
    own = (COUNT_ENTRY, LAST_ENTRY, AGAIN_ENTRY, FAILURE_ENTRY)
    return (*own, *map(_given_up, actions_of(plan.members)))


def _given_up(action: int) -> str:
    """The entry with how many actions had succeeded when this one has failed."""
    return f'plan_given_up_{action}'


class _Writer(LeafWriter):
    def __init__(self, problem: Problem, policy: Policy) -> None:
        super().__init__(problem, policy.domain)
        self._policy = policy

    def tree(self, name: str, members: Sequence[Rule | Group], most: int) -> ElementTree.Element:
        tree = ElementTree.Element('BehaviorTree', ID=name)
        top = add(tree, 'Sequence')
        none_given_up = ''.join(f'; {_given_up(action)} := -1' for action in actions_of(members))
        add(top, 'Script', code=NOTHING_DONE + none_given_up)
        ways = add(top, 'Fallback')
        step = add(add(ways, 'KeepRunningUntilFailure'), 'ReactiveSequence', name='until the goal holds')
        self.goal(add(step, 'Inverter'), self._policy.goals)
        actions_left(step, most)
        branches = add(step, 'ReactiveFallback', name='the cheapest way from here')
        for member in members:
            self._member(branches, member)
        add_last_branch(branches, 'no way to the goal is planned from here')
        self.goal(ways, self._policy.goals)
        return tree

    def _member(self, parent: ElementTree.Element, member: Rule | Group) -> None:
        if isinstance(member, Group):
            sequence = add(parent, 'ReactiveSequence')
            self.conditions(sequence, member.condition)
            inner = add(sequence, 'ReactiveFallback')
            for one in member.members:
                self._member(inner, one)
            return
        sequence = add(parent, 'ReactiveSequence', name=f'at cost {member.cost:g}') if member.condition else parent
        self.conditions(sequence, member.condition)
        given_up = _given_up(member.action)
        self.action(sequence, member.action, f'{given_up} == {COUNT_ENTRY}', f'{given_up} := {COUNT_ENTRY}')
