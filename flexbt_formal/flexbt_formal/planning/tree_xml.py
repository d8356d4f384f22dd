# SPDX-License-Identifier: BSD-3-Clause
"""Plans as trees for BehaviorTree.CPP 4, Groot2 and FlexBT.

The tree of a plan for one robot::

    Sequence
      Script                            plan_actions := 0; plan_last := ''; plan_failure := ''
      Fallback
        KeepRunningUntilFailure         one action after the other
          ReactiveSequence
            Inverter(the goal)          when it holds, the running action is halted and the loop ends
            ReactiveFallback            not more actions than are allowed
            ReactiveFallback            the branches, the cheapest first; the last one says why it gives up
              ReactiveSequence(conditions, RetryUntilSuccessful(action))
        ReactiveSequence(the goal)

The tree succeeds when the goal holds. It fails in three cases, and ``plan_failure`` on the blackboard has the reason:

- an action has used up its attempts, and no other branch holds;
- no branch holds;
- the tree has run three times as many actions as the longest tested path.

An action that succeeds without its effects is repeated up to its number of attempts, and then counts as failed. After
a failure, the tree uses other branches instead of this action until another action has succeeded.

For several robots there is a tree for each of them, and one that runs them all::

    Sequence
      Script                            no robot is lost
      Fallback
        ReactiveSequence
          Inverter(the goal)            when it holds, everything that runs is halted
          ReactiveFallback              not more actions than are allowed
          Parallel                      the trees of the robots
        ReactiveSequence(the goal)

    of a robot: KeepRunningUntilFailure
      ReactiveSequence
        ReactiveFallback                what it is to do: the branches, that with the least left first
          ReactiveSequence(the goal, Script)
          ReactiveSequence(conditions, Script)
        ReactiveFallback                it does that; an action goes on when another branch has it, too
          ReactiveSequence(is it this one?, RetryUntilSuccessful(action))

A robot whose action has used up its attempts is lost from then on: ``lost_ROBOT`` on the blackboard, which other
programs may also set. Then only the branches without this robot remain.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Final
from xml.etree import ElementTree

from .planner import Plan
from .policy import WAITS, BranchRule, Policy, RuleGroup, actions_of
from .problem import Leaf, PlanningError, PlanningProblem, bits
from .team import TeamPlan, entry

FAILURE_ENTRY: Final = 'plan_failure'
"""The blackboard entry with the reason why a tree gave up."""

_COUNT_ENTRY: Final = 'plan_actions'
"""The entry of the blackboard with the number of actions that succeeded."""

_LAST_ENTRY: Final = 'plan_last'
"""The entry of the blackboard with the last action that succeeded."""

_AGAIN_ENTRY: Final = 'plan_again'
"""The entry of the blackboard with how often that action has succeeded in a row, and none was under way since."""

_NOTHING_DONE: Final = f"{_COUNT_ENTRY} := 0; {_LAST_ENTRY} := ''; {_AGAIN_ENTRY} := 0; {FAILURE_ENTRY} := ''"
"""The script with which a tree begins."""

_FAILED: Final = 'failed'
_IN_VAIN: Final = 'succeeded without its effects'
_MARGIN: Final = 3
_LONGEST_LINE: Final = 120
_ATTRIBUTE: Final = re.compile(r' (?=[\w:-]+="[^"]*")')
_BUILTIN: Final = ('ScriptCondition', 'Script')


def tree_xml(plan: Plan, name: str = 'Plan') -> str:
    """Return the XML of a plan's tree. For several robots, the tree ``name`` runs the trees ``name_ROBOT`` of all
    robots.

    Raises:
        ValueError: the search found no plan.
        PlanningError: XML cannot contain the type or a port of a leaf, or a leaf acts and tests.
    """
    if plan.policy is None or plan.coverage is None:
        raise ValueError('there is no plan, and so no tree')
    most = _MARGIN * max(1, plan.coverage.longest)
    if isinstance(plan, TeamPlan):
        return _TeamWriter(plan.problem, plan.policy).xml(name, plan.team.robots, most)
    return _RobotWriter(plan.problem, plan.policy).xml(name, most)


def tree_entries(plan: Plan) -> tuple[str, ...]:
    """Return the private blackboard entries of the tree of a plan for one robot."""
    actions = () if plan.policy is None else actions_of(plan.policy.members[0])
    return (_COUNT_ENTRY, _LAST_ENTRY, _AGAIN_ENTRY, FAILURE_ENTRY, *map(_given_up, actions))


def failed_action(problem: PlanningProblem, reason: str) -> tuple[str, str] | None:
    """Return the action whose failure is the ``reason`` of a tree, and how it failed; None for other reasons."""
    did = ((action.name, what) for action in problem.actions for what in (_FAILED, _IN_VAIN))
    return next((one for one in did if _reason(*one, problem.leaf(one[0])) == reason), None)


class _Writer:
    """A writer of the elements that all trees have; it collects their node types."""

    def __init__(self, problem: PlanningProblem, policy: Policy) -> None:
        self._problem = problem
        self._policy = policy
        self._domain = policy.domain
        self._types: dict[tuple[str, str], set[str]] = {}

    def _document(self, main: str, trees: Iterable[ElementTree.Element]) -> str:
        """Return the XML of trees, with the node models that Groot2 requires."""
        root = ElementTree.Element('root', BTCPP_format='4', main_tree_to_execute=main)
        root.extend(trees)
        models = _add(root, 'TreeNodesModel')
        for (kind, type), ports in sorted(self._types.items()):
            model = _add(models, kind, ID=type)
            for port in sorted(ports):
                _add(model, 'input_port', name=port)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding='unicode')
        rows = (row for line in text.splitlines() for row in _rows(line))
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + '\n'.join(rows) + '\n'

    def _main(
        self, name: str, begins: str, most: int, *, repeats: bool
    ) -> tuple[ElementTree.Element, ElementTree.Element]:
        """Return a tree that succeeds when the goal holds, and the element for what it does until then.

        It begins with the script ``begins``, and gives up when ``most`` actions have succeeded.
        """
        tree = ElementTree.Element('BehaviorTree', ID=name)
        top = _add(tree, 'Sequence')
        _add(top, 'Script', code=_NOTHING_DONE + begins)
        ways = _add(top, 'Fallback')
        around = _add(ways, 'KeepRunningUntilFailure') if repeats else ways
        step = _add(around, 'ReactiveSequence', name='until the goal holds')
        self._goal(_add(step, 'Inverter'))
        allowed = _add(step, 'ReactiveFallback', name='actions are left')
        _add(allowed, 'ScriptCondition', code=f'{_COUNT_ENTRY} < {most}')
        _add_last_branch(
            allowed, f'the goal was not reached by {most} actions', f" .. '; the last one was ' .. {_LAST_ENTRY}"
        )
        self._goal(ways)
        return tree, step

    def _goal(self, parent: ElementTree.Element) -> None:
        """Add a test whether one of the goals holds."""
        if len(self._policy.goals) > 1:
            parent = _add(parent, 'ReactiveFallback', name='one of the goals')
        for goal in self._policy.goals:
            sequence = _add(parent, 'ReactiveSequence', name='the goal')
            self._conditions(sequence, goal)
            if not goal:  # it holds, and nothing changes that
                _add(sequence, 'AlwaysSuccess')

    def _conditions(self, parent: ElementTree.Element, condition: int) -> None:
        """Add a leaf for each literal of a condition."""
        for literal in bits(condition):
            text = self._domain.literals[literal]
            leaf = self._problem.leaf(text)
            self._leaf(_add(parent, 'Inverter') if leaf.inverted else parent, 'Condition', text, leaf)

    def _branches(
        self,
        parent: ElementTree.Element,
        members: Sequence[BranchRule | RuleGroup],
        add_rule: Callable[[ElementTree.Element, BranchRule], None],
    ) -> None:
        """Add branches in their order; ``add_rule`` adds one that is not a group."""
        for member in members:
            if isinstance(member, RuleGroup):
                sequence = _add(parent, 'ReactiveSequence')
                self._conditions(sequence, member.condition)
                self._branches(_add(sequence, 'ReactiveFallback'), member.members, add_rule)
            else:
                add_rule(parent, member)

    def _action(
        self,
        parent: ElementTree.Element,
        number: int,
        given_up: str,
        failed: str,
        *,
        last: str = _LAST_ENTRY,
        again: str = _AGAIN_ENTRY,
    ) -> None:
        """Add an action with its attempts.

        An action that succeeds without its effects is tried again while attempts are left, and then fails.

        ``failed`` is a script for that, which makes ``given_up`` true: where that is so, the action fails at once.
        ``last`` and ``again`` are the entries of its robot.
        """
        name = self._domain.actions[number].name
        leaf = self._problem.leaf(name)
        is_last = f"{last} == '{_quoted(name)}'"
        in_vain = f'({is_last} && {again} >= {leaf.attempts})'
        reason = f"{in_vain} ? '{_reason(name, _IN_VAIN, leaf)}' : '{_reason(name, _FAILED, leaf)}'"
        names = '; '.join(f"{entry} := '{_quoted(name)}'" for entry in dict.fromkeys((last, _LAST_ENTRY)))
        retry = _add(
            parent,
            'RetryUntilSuccessful',
            num_attempts=str(leaf.attempts),
            _failureIf=f'{given_up} || {in_vain}',
            _onSuccess=f'{again} := ({is_last}) ? ({again} + 1) : 1; {_COUNT_ENTRY} := {_COUNT_ENTRY} + 1; {names}; '
            f"{FAILURE_ENTRY} := ''",
            _onFailure=f'{FAILURE_ENTRY} := ({given_up}) ? {FAILURE_ENTRY} : ({reason}); {failed}',
            _onHalted=f'{again} := 0',  # it was running, so the previous actions had their effects
        )
        if leaf.deadline is not None:
            retry = _add(retry, 'Timeout', msec=str(max(1, round(1000 * leaf.deadline))))
        self._leaf(retry, 'Action', name, leaf)

    def _leaf(self, parent: ElementTree.Element, kind: str, name: str, leaf: Leaf) -> None:
        attributes = leaf.attributes(name)
        if leaf.type not in _BUILTIN:
            if ({'Action': 'Condition', 'Condition': 'Action'}[kind], leaf.type) in self._types:
                raise PlanningError(
                    f'{leaf.type} is a leaf that acts, and would test a literal, too; give the predicate a sensor, or '
                    'another name'
                )
            self._types.setdefault((kind, leaf.type), set()).update(leaf.ports)
        _add(parent, leaf.type, **attributes)


class _RobotWriter(_Writer):
    """A writer of the tree of one robot."""

    def xml(self, name: str, most: int) -> str:
        members = self._policy.members[0]
        none_given_up = ''.join(f'; {_given_up(action)} := -1' for action in actions_of(members))
        tree, step = self._main(name, none_given_up, most, repeats=True)
        branches = _add(step, 'ReactiveFallback', name='the cheapest way from here')
        self._branches(branches, members, self._rule)
        _add_last_branch(branches, 'no way to the goal is planned from here')
        return self._document(name, [tree])

    def _rule(self, parent: ElementTree.Element, rule: BranchRule) -> None:
        sequence = _add(parent, 'ReactiveSequence', name=f'at cost {rule.cost:g}') if rule.condition else parent
        self._conditions(sequence, rule.condition)
        given_up = _given_up(rule.action)
        self._action(sequence, rule.action, f'{given_up} == {_COUNT_ENTRY}', f'{given_up} := {_COUNT_ENTRY}')


class _TeamWriter(_Writer):
    """A writer of the trees of several robots."""

    def xml(self, name: str, robots: Sequence[str], most: int) -> str:
        begins = ''.join(
            f"; {entry('lost', robot)} := false; {entry('next', robot)} := ''"
            f"; {entry(_LAST_ENTRY, robot)} := ''; {entry(_AGAIN_ENTRY, robot)} := 0"
            for robot in robots
        )
        team, step = self._main(name, begins, most, repeats=False)
        side_by_side = _add(step, 'Parallel', name='the robots', success_count=str(len(robots)), failure_count='1')
        trees = [team]
        for robot, members in zip(robots, self._policy.members, strict=True):
            id = entry(name, robot)
            _add(side_by_side, 'SubTree', ID=id, name=robot, _autoremap='true')
            trees.append(self._robot(robot, id, members))
        return self._document(name, trees)

    def _robot(self, robot: str, id: str, members: Sequence[BranchRule | RuleGroup]) -> ElementTree.Element:
        tree = ElementTree.Element('BehaviorTree', ID=id)
        both = _add(_add(tree, 'KeepRunningUntilFailure'), 'ReactiveSequence', name=robot)
        chosen, lost = entry('next', robot), entry('lost', robot)
        last, again = entry(_LAST_ENTRY, robot), entry(_AGAIN_ENTRY, robot)

        def add_rule(parent: ElementTree.Element, rule: BranchRule) -> None:
            sequence = _add(parent, 'ReactiveSequence')
            self._conditions(sequence, rule.condition)
            action = self._name(rule.action)
            # Where it is to do something else, its last action had its effects.
            code = f"{chosen} := '{action}'; {again} := ({last} == '{action}') ? {again} : 0"
            _add(sequence, 'Script', name=action or 'others go on', code=code)

        branches = _add(both, 'ReactiveFallback', name=f'what {robot} is to do')
        reached = _add(branches, 'ReactiveSequence')
        self._goal(reached)  # since another robot has reached it in this tick
        _add(reached, 'Script', name='nothing more', code=f"{chosen} := ''")
        self._branches(branches, members, add_rule)
        _add_last_branch(branches, 'no way to the goal is planned from here')
        done = _add(both, 'ReactiveFallback', name=f'{robot} does it')
        for action in actions_of(members):
            if action == WAITS:
                continue
            step = _add(done, 'ReactiveSequence')
            _add(step, 'ScriptCondition', code=f"{chosen} == '{self._name(action)}'")
            # Other robots take over its failed action in the next tick.
            self._action(_add(step, 'ForceSuccess'), action, lost, f'{lost} := true', last=last, again=again)
        _add(_add(done, 'KeepRunningUntilFailure', name='others go on'), 'AlwaysSuccess')
        return tree

    def _name(self, action: int) -> str:
        return '' if action == WAITS else _quoted(self._domain.actions[action].name)


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    """Return a new child."""
    return ElementTree.SubElement(parent, tag, attributes)


def _add_last_branch(parent: ElementTree.Element, reason: str, more: str = '') -> None:
    """Add a last branch, which keeps the reason of a failed action. A script adds ``more`` to the reason."""
    code = f"{FAILURE_ENTRY} := ({FAILURE_ENTRY} == '') ? ('{reason}'{more}) : {FAILURE_ENTRY}"
    _add(_add(parent, 'ForceFailure', name='gives up'), 'Script', name=reason, code=code)


def _given_up(action: int) -> str:
    """Return the name of the entry with the number of successful actions at the failure of this one."""
    return f'plan_given_up_{action}'


def _quoted(text: str) -> str:
    """Return a text quoted for a script."""
    return text.replace("'", '’').replace('\\', '/')


def _reason(name: str, what: str, leaf: Leaf) -> str:
    times = 'once' if leaf.attempts == 1 else f'{leaf.attempts} times'
    return f'{_quoted(name)} {what} {times}'


def _rows(line: str) -> Iterable[str]:
    """Return a line of XML, split into a line for each attribute if it is too long."""
    if len(line) <= _LONGEST_LINE:
        return [line]
    margin = ' ' * (len(line) - len(line.lstrip(' ')))
    return _ATTRIBUTE.sub(f'\n{margin}    ', line).splitlines()
