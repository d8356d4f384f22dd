# SPDX-License-Identifier: BSD-3-Clause
"""The elements of which trees of plans are made: conditions, actions with their attempts, and how a tree gives up."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final
from xml.etree import ElementTree

from flexbt_core.values import shown
from flexbt_formal.planning.problems import Domain, Leaf, PlanningError, Problem, bits

from .coverage import Coverage

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
"""Of types and ports: BehaviorTree.CPP 4.8 takes leaves as tags of their types only."""
_LONGEST_LINE: Final = 120
_ATTRIBUTE: Final = re.compile(r' (?=[\w:-]+="[^"]*")')
_BUILTIN: Final = ('ScriptCondition', 'Script')


def failed_action(problem: Problem, reason: str) -> tuple[str, str] | None:
    """The action because of which a tree gave up for this reason, and what it did; None when it was none."""
    did = ((action.name, what) for action in problem.actions for what in (_FAILED, _IN_VAIN))
    return next((one for one in did if _reason(*one, problem.leaf(one[0])) == reason), None)


def _rows(line: str) -> Iterable[str]:
    """A line of XML; one that is too long has a line for each attribute."""
    if len(line) <= _LONGEST_LINE:
        return [line]
    margin = ' ' * (len(line) - len(line.lstrip(' ')))
    return _ATTRIBUTE.sub(f'\n{margin}    ', line).splitlines()


class LeafWriter:
    """Writes the leaves of a problem, and keeps which node types there are."""

    def __init__(self, problem: Problem, domain: Domain) -> None:
        self._problem = problem
        self._domain = domain
        self._types: dict[tuple[str, str], set[str]] = {}

    def document(self, main: str, trees: Iterable[ElementTree.Element]) -> str:
        """The XML of trees, with the node types as Groot2 wants to know them."""
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
        """A leaf for each literal of a condition."""
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
        """An action with its attempts. One that succeeds is done again where its effects are missing, as often as it
        may be tried; then it fails.

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
                    f'{name}: {shown(word)} cannot be a type or port of a leaf; call it by letters, digits, _ and -'
                )
        if leaf.type not in _BUILTIN:
            self._types.setdefault((kind, leaf.type), set()).update(leaf.ports)
        add(parent, leaf.type, **{'name': name, **leaf.ports})


def add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    """A new child."""
    return ElementTree.SubElement(parent, tag, attributes)


def allowed_actions(coverage: Coverage) -> int:
    """Three times as many actions as the longest way that was tried: after so many a tree gives up."""
    return _MARGIN * max(1, coverage.longest)


def actions_left(parent: ElementTree.Element, most: int) -> None:
    """Gives up when so many actions have succeeded."""
    allowed = add(parent, 'ReactiveFallback', name='actions are left')
    add(allowed, 'ScriptCondition', code=f'{COUNT_ENTRY} < {most}')
    add_last_branch(
        allowed, f'the goal was not reached by {most} actions', f" .. '; the last one was ' .. {LAST_ENTRY}"
    )


def add_last_branch(parent: ElementTree.Element, reason: str, more: str = '') -> None:
    """A last branch: it keeps the reason that an action has left. ``more`` is what a script adds to the reason."""
    code = f"{FAILURE_ENTRY} := ({FAILURE_ENTRY} == '') ? ('{reason}'{more}) : {FAILURE_ENTRY}"
    add(add(parent, 'ForceFailure', name='gives up'), 'Script', name=reason, code=code)


def quoted(text: str) -> str:
    """A text within the quotes of a script."""
    return text.replace("'", '’').replace('\\', '/')


def _reason(name: str, what: str, leaf: Leaf) -> str:
    return f'{quoted(name)} {what} {_times(leaf.attempts)}'


def _times(number: int) -> str:
    return 'once' if number == 1 else f'{number} times'
