# SPDX-License-Identifier: BSD-3-Clause
"""Plans as trees for BehaviorTree.CPP 4, Groot2 and FlexBT, and the elements of which these trees are made."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final
from xml.etree import ElementTree

from flexbt_core.values.text import short_repr

from .coverage import Coverage
from .planner import Plan
from .policy import BranchRule, Policy, RuleGroup, actions_of
from .problem import Domain, Leaf, PlanningError, PlanningProblem, bits

FAILURE_ENTRY: Final = 'plan_failure'
"""The entry of the blackboard that says why a tree gave up."""

COUNT_ENTRY: Final = 'plan_actions'
"""The entry of the blackboard with the number of actions that succeeded."""

LAST_ENTRY: Final = 'plan_last'
"""The entry of the blackboard with the last action that succeeded."""

AGAIN_ENTRY: Final = 'plan_again'
"""The entry of the blackboard with how often that action has succeeded in a row, and none was under way since."""

NOTHING_DONE: Final = f"{COUNT_ENTRY} := 0; {LAST_ENTRY} := ''; {AGAIN_ENTRY} := 0; {FAILURE_ENTRY} := ''"
"""The script with which a tree begins."""

_FAILED: Final = 'failed'
_IN_VAIN: Final = 'succeeded without its effects'
_MARGIN: Final = 3
_NAME: Final = re.compile(r'[^\W\d][\w-]*')
"""Pattern of the names of types and ports: BehaviorTree.CPP 4.8 accepts leaves only as tags of their types."""
_LONGEST_LINE: Final = 120
_ATTRIBUTE: Final = re.compile(r' (?=[\w:-]+="[^"]*")')
_BUILTIN: Final = ('ScriptCondition', 'Script')


def failed_action(problem: PlanningProblem, reason: str) -> tuple[str, str] | None:
    """Return the action because of which a tree gave up for this reason, and what it did; None when it was none."""
    did = ((action.name, what) for action in problem.actions for what in (_FAILED, _IN_VAIN))
    return next((one for one in did if _reason(*one, problem.leaf(one[0])) == reason), None)


def _rows(line: str) -> Iterable[str]:
    """Return a line of XML; one that is too long has a line for each attribute."""
    if len(line) <= _LONGEST_LINE:
        return [line]
    margin = ' ' * (len(line) - len(line.lstrip(' ')))
    return _ATTRIBUTE.sub(f'\n{margin}    ', line).splitlines()


class LeafWriter:
    """A writer of the leaves of a problem, which keeps the node types that occur."""

    def __init__(self, problem: PlanningProblem, domain: Domain) -> None:
        self._problem = problem
        self._domain = domain
        self._types: dict[tuple[str, str], set[str]] = {}

    def document(self, main: str, trees: Iterable[ElementTree.Element]) -> str:
        """Return the XML of trees, with the node types as Groot2 wants to know them."""
        root = ElementTree.Element('root', BTCPP_format='4', main_tree_to_execute=main)
        root.extend(trees)
        models = add(root, 'TreeNodesModel')
        for (kind, type), ports in sorted(self._types.items()):
            model = add(models, kind, ID=type)
            for port in sorted(ports):
                add(model, 'input_port', name=port)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding='unicode')
        rows = (row for line in text.splitlines() for row in _rows(line))
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + '\n'.join(rows) + '\n'

    def goal(self, parent: ElementTree.Element, goals: Sequence[int]) -> None:
        """Whether one of the goals holds."""
        if len(goals) > 1:
            parent = add(parent, 'ReactiveFallback', name='one of the goals')
        for goal in goals:
            self.conditions(add(parent, 'ReactiveSequence', name='the goal'), goal)

    def conditions(self, parent: ElementTree.Element, condition: int) -> None:
        """Add a leaf for each literal of a condition."""
        for literal in bits(condition):
            text = self._domain.literals[literal]
            leaf = self._problem.leaf(text)
            self._leaf(add(parent, 'Inverter') if leaf.inverted else parent, 'Condition', text, leaf)

    def action(
        self,
        parent: ElementTree.Element,
        number: int,
        given_up: str,
        failed: str,
        *,
        last: str = LAST_ENTRY,
        again: str = AGAIN_ENTRY,
    ) -> None:
        """Add an action with its attempts.

        An action that succeeds without its effects is tried again while attempts are left, and then fails.

        ``failed`` is a script for that, which makes ``given_up`` true: where that is so, the action fails at once.
        ``last`` and ``again`` are the entries of its robot.
        """
        name = self._domain.actions[number].name
        leaf = self._problem.leaf(name)
        is_last = f"{last} == '{quoted(name)}'"
        in_vain = f'({is_last} && {again} >= {leaf.attempts})'
        reason = f"{in_vain} ? '{_reason(name, _IN_VAIN, leaf)}' : '{_reason(name, _FAILED, leaf)}'"
        names = '; '.join(f"{entry} := '{quoted(name)}'" for entry in dict.fromkeys((last, LAST_ENTRY)))
        retry = add(
            parent,
            'RetryUntilSuccessful',
            num_attempts=str(leaf.attempts),
            _failureIf=f'{given_up} || {in_vain}',
            _onSuccess=f'{again} := ({is_last}) ? ({again} + 1) : 1; {COUNT_ENTRY} := {COUNT_ENTRY} + 1; {names}; '
            f"{FAILURE_ENTRY} := ''",
            _onFailure=f'{FAILURE_ENTRY} := ({given_up}) ? {FAILURE_ENTRY} : ({reason}); {failed}',
            _onHalted=f'{again} := 0',  # it was under way, so what was done before has had its effects
        )
        if leaf.deadline is not None:
            retry = add(retry, 'Timeout', msec=str(round(1000 * leaf.deadline)))
        self._leaf(retry, 'Action', name, leaf)

    def _leaf(self, parent: ElementTree.Element, kind: str, name: str, leaf: Leaf) -> None:
        for word in (leaf.type, *leaf.ports):
            if not _NAME.fullmatch(word):
                raise PlanningError(
                    f'{name}: {short_repr(word)} cannot be a type or port of a leaf; '
                    'call it by letters, digits, _ and -'
                )
        if leaf.type not in _BUILTIN:
            self._types.setdefault((kind, leaf.type), set()).update(leaf.ports)
        add(parent, leaf.type, **{'name': name, **leaf.ports})


def add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    """Return a new child."""
    return ElementTree.SubElement(parent, tag, attributes)


def allowed_actions(coverage: Coverage) -> int:
    """Return the number of actions after which a tree gives up: three times that of the longest way that was tried."""
    return _MARGIN * max(1, coverage.longest)


def actions_left(parent: ElementTree.Element, most: int) -> None:
    """Give up when this many actions have succeeded."""
    allowed = add(parent, 'ReactiveFallback', name='actions are left')
    add(allowed, 'ScriptCondition', code=f'{COUNT_ENTRY} < {most}')
    add_last_branch(
        allowed, f'the goal was not reached by {most} actions', f" .. '; the last one was ' .. {LAST_ENTRY}"
    )


def add_last_branch(parent: ElementTree.Element, reason: str, more: str = '') -> None:
    """Add a last branch, which keeps the reason that an action has left. A script adds ``more`` to the reason."""
    code = f"{FAILURE_ENTRY} := ({FAILURE_ENTRY} == '') ? ('{reason}'{more}) : {FAILURE_ENTRY}"
    add(add(parent, 'ForceFailure', name='gives up'), 'Script', name=reason, code=code)


def quoted(text: str) -> str:
    """Return a text within the quotes of a script."""
    return text.replace("'", '’').replace('\\', '/')


def _reason(name: str, what: str, leaf: Leaf) -> str:
    return f'{quoted(name)} {what} {_times(leaf.attempts)}'


def _times(number: int) -> str:
    return 'once' if number == 1 else f'{number} times'


# A plan as a tree for BehaviorTree.CPP 4, Groot2 and FlexBT.
#
# ::
#
#     Sequence
#       Script                            plan_actions := 0; plan_last := ''; plan_failure := ''
#       Fallback
#         KeepRunningUntilFailure         one action after the other
#           ReactiveSequence
#             Inverter(the goal)          when it holds, whatever runs is halted, and the loop ends
#             ReactiveFallback            not more actions than are allowed
#             ReactiveFallback            the branches, the cheapest first; the last one says why it gives up
#               ReactiveSequence(conditions, RetryUntilSuccessful(action))
#         ReactiveSequence(the goal)
#
# The tree succeeds when the goal holds. It fails when an action failed as often as it may be tried and no other branch
# holds, when no branch holds, or after ``most_actions`` actions; ``plan_failure`` on the blackboard says which. An
# action that succeeds without its effects is done again as often as it may be tried, and has failed then. One that has
# failed is left to the other branches until another action has succeeded.


def tree_xml(plan: Plan, name: str = 'Plan', most_actions: int | None = None) -> str:
    """Return the XML of a plan's tree.

    ``most_actions``: after this many actions that succeeded the tree gives up; without it, after three times as many as
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
    """Return the entries of the blackboard that a plan's tree has for itself."""
    own = (COUNT_ENTRY, LAST_ENTRY, AGAIN_ENTRY, FAILURE_ENTRY)
    return (*own, *map(_given_up, actions_of(plan.members)))


def _given_up(action: int) -> str:
    """Return the entry with how many actions had succeeded when this one has failed."""
    return f'plan_given_up_{action}'


class _Writer(LeafWriter):
    def __init__(self, problem: PlanningProblem, policy: Policy) -> None:
        super().__init__(problem, policy.domain)
        self._policy = policy

    def tree(self, name: str, members: Sequence[BranchRule | RuleGroup], most: int) -> ElementTree.Element:
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

    def _member(self, parent: ElementTree.Element, member: BranchRule | RuleGroup) -> None:
        if isinstance(member, RuleGroup):
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
