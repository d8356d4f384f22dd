# SPDX-License-Identifier: BSD-3-Clause
"""A plan as a tree for BehaviorTree.CPP 4, Groot2 and FlexBT.

::

    Sequence
      Script                            plan_actions := 0; plan_failure := ''
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
that succeeds without its effects is done again, and counts.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final
from xml.etree import ElementTree

from .compaction import Group, Rule
from .model import Domain, PlanningError, bits
from .planner import Plan
from .policy import Policy
from .problem import Leaf, Problem

FAILURE_ENTRY: Final = 'plan_failure'
"""The entry of the blackboard that says why a tree gave up."""

COUNT_ENTRY: Final = 'plan_actions'
"""The entry that has the number of actions that were done."""

_RESET: Final = f"{FAILURE_ENTRY} := ''"
_NAME: Final = re.compile(r'[^\W\d][\w-]*')
"""Of types and ports: BehaviorTree.CPP 4.8 takes leaves as tags of their types only."""
_BUILTIN: Final = ('ScriptCondition', 'Script')
_MARGIN: Final = 3


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
        most_actions = _MARGIN * max(1, plan.coverage.longest)
    writer = _Writer(plan.problem, plan.policy)
    root = ElementTree.Element('root', BTCPP_format='4', main_tree_to_execute=name)
    root.append(writer.tree(name, plan.members, most_actions))
    root.append(writer.models())
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding='unicode') + '\n'


def failed_action(problem: Problem, reason: str) -> str | None:
    """The action because of which a tree gave up for this reason; None when it was none."""
    names = (action.name for action in problem.actions)
    return next((name for name in names if _failure(name, problem.leaf(name)) == reason), None)


class _Writer:
    def __init__(self, problem: Problem, policy: Policy) -> None:
        self._problem = problem
        self._policy = policy
        self._domain: Domain = policy.domain
        self._types: dict[tuple[str, str], set[str]] = {}

    def tree(self, name: str, members: Sequence[Rule | Group], most: int) -> ElementTree.Element:
        tree = ElementTree.Element('BehaviorTree', ID=name)
        top = _add(tree, 'Sequence')
        _add(top, 'Script', code=f'{COUNT_ENTRY} := 0; {_RESET}')
        ways = _add(top, 'Fallback')
        step = _add(_add(ways, 'KeepRunningUntilFailure'), 'ReactiveSequence', name='until the goal holds')
        self._goal(_add(step, 'Inverter'))
        allowed = _add(step, 'ReactiveFallback', name='actions are left')
        _add(allowed, 'ScriptCondition', code=f'{COUNT_ENTRY} < {most}')
        _give_up(allowed, f'the goal was not reached by {most} actions')
        branches = _add(step, 'ReactiveFallback', name='the cheapest way from here')
        for member in members:
            self._member(branches, member)
        _give_up(branches, 'no way to the goal is planned from here')
        self._goal(ways)
        return tree

    def models(self) -> ElementTree.Element:
        """The node types, as Groot2 wants to know them."""
        models = ElementTree.Element('TreeNodesModel')
        for (kind, type), ports in sorted(self._types.items()):
            model = _add(models, kind, ID=type)
            for port in sorted(ports):
                _add(model, 'input_port', name=port)
        return models

    def _goal(self, parent: ElementTree.Element) -> None:
        if len(self._policy.goals) > 1:
            parent = _add(parent, 'ReactiveFallback', name='one of the goals')
        for goal in self._policy.goals:
            self._conditions(_add(parent, 'ReactiveSequence', name='the goal'), goal)

    def _member(self, parent: ElementTree.Element, member: Rule | Group) -> None:
        if isinstance(member, Group):
            sequence = _add(parent, 'ReactiveSequence')
            self._conditions(sequence, member.condition)
            inner = _add(sequence, 'ReactiveFallback')
            for one in member.members:
                self._member(inner, one)
            return
        name = self._domain.actions[member.action].name
        leaf = self._problem.leaf(name)
        sequence = _add(parent, 'ReactiveSequence', name=f'at cost {member.cost:g}') if member.condition else parent
        self._conditions(sequence, member.condition)
        retry = _add(
            sequence,
            'RetryUntilSuccessful',
            num_attempts=str(leaf.attempts),
            _onSuccess=f'{COUNT_ENTRY} := {COUNT_ENTRY} + 1; {_RESET}',
            _onFailure=f"{FAILURE_ENTRY} := '{_failure(name, leaf)}'",
        )
        if leaf.deadline is not None:
            retry = _add(retry, 'Timeout', msec=str(round(1000 * leaf.deadline)))
        self._leaf(retry, 'Action', name, leaf)

    def _conditions(self, parent: ElementTree.Element, condition: int) -> None:
        for literal in bits(condition):
            text = self._domain.literals[literal]
            leaf = self._problem.leaf(text)
            self._leaf(_add(parent, 'Inverter') if leaf.inverted else parent, 'Condition', text, leaf)

    def _leaf(self, parent: ElementTree.Element, kind: str, name: str, leaf: Leaf) -> None:
        for word in (leaf.type, *leaf.ports):
            if not _NAME.fullmatch(word):
                raise PlanningError(
                    f'{name}: {word!r:.80} cannot be a type or port of a leaf; call it by letters, digits, _ and -'
                )
        if leaf.type not in _BUILTIN:
            self._types.setdefault((kind, leaf.type), set()).update(leaf.ports)
        _add(parent, leaf.type, **{'name': name, **leaf.ports})


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _give_up(parent: ElementTree.Element, reason: str) -> None:
    """A last branch: it keeps the reason that an action has left."""
    code = f"{FAILURE_ENTRY} := ({FAILURE_ENTRY} == '') ? '{reason}' : {FAILURE_ENTRY}"
    _add(_add(parent, 'ForceFailure', name='gives up'), 'Script', name=reason, code=code)


def _failure(name: str, leaf: Leaf) -> str:
    return f'{_quoted(name)} failed {_times(leaf.attempts)}'


def _quoted(text: str) -> str:
    return text.replace("'", '’').replace('\\', '/')


def _times(number: int) -> str:
    return 'once' if number == 1 else f'{number} times'
