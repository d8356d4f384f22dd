# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with the conditions of a concurrency container, so that it could not end as it should."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from flexbt_core.state_machine.model import Condition, EventState, Machine, StateKind
from flexbt_core.values import hint

_SEARCHED: Final = 20_000
"""Combinations of outcomes that are checked; what is beyond is noticed when it happens."""


def problems_of_conditions(path: str, container: Machine) -> Iterator[str]:
    """What is wrong with the conditions."""
    problems = list(_names(path, container))
    yield from problems
    if not container.conditions:
        yield f'{path}: the concurrency container has no conditions, so that it could never end'
    elif not problems:
        possible = {child.label: outcomes_of(child.state) for child in container.children}
        ended = _uncovered(possible, container.conditions)
        if ended is not None:
            shown = ', '.join(f'{label} by {outcome!r}' for label, outcome in ended.items())
            yield f'{path}: when its children have ended {shown}, no condition holds; add one for that'


def _names(path: str, container: Machine) -> Iterator[str]:
    children = {child.label: child.state.outcomes for child in container.children}
    for number, condition in enumerate(container.conditions, start=1):
        place = f'{path}: condition {number}, of {condition.outcome!r},'
        if condition.outcome not in container.outcomes:
            yield f'{place} is of no outcome of the container{hint(condition.outcome, container.outcomes)}'
        if not condition.children:
            yield f'{place} names no child'
        if len(dict(condition.children)) < len(dict.fromkeys(condition.children)):
            yield f'{place} wants two outcomes of one child, so that it never holds'
        for label, outcome in condition.children:
            if label not in children:
                yield f'{place} names {label!r}, which is no child{hint(label, children)}'
            elif outcome not in children[label]:
                yield f'{place} names {outcome!r}, which is no outcome of {label}{hint(outcome, children[label])}'


def outcomes_of(state: EventState | Machine) -> tuple[str, ...]:
    """Outcomes by which a state, or a machine as its states are connected, can end."""
    if isinstance(state, EventState):
        return state.outcomes
    if state.kind is StateKind.CONCURRENCY:
        found = {condition.outcome for condition in state.conditions}
    else:
        children = {child.label: child for child in state.children}
        found, ahead = set(), [child.label for child in state.children[:1]]
        while ahead:
            label = ahead.pop()
            if label not in found:
                found.add(label)
                child = children.get(label)
                if child is not None:
                    ahead += [child.transitions[one] for one in outcomes_of(child.state) if one in child.transitions]
    return tuple(outcome for outcome in state.outcomes if outcome in found)


def _uncovered(possible: Mapping[str, Sequence[str]], conditions: Sequence[Condition]) -> dict[str, str] | None:
    """Outcomes of all children for which no condition holds; None when there are none, or none was found in time."""
    labels = list(possible)
    ended: dict[str, str] = {}
    searched = 0

    def search(left: Sequence[Condition]) -> bool:
        """Whether what is chosen up to now can go on so that none of the conditions ``left`` holds."""
        nonlocal searched
        searched += 1
        if searched > _SEARCHED or any(one.holds(ended) for one in left):
            return False
        if len(ended) == len(labels):
            return True
        label = labels[len(ended)]
        for outcome in possible[label]:
            ended[label] = outcome
            if search([one for one in left if dict(one.children).get(label, outcome) == outcome]):
                return True
            del ended[label]
        return False

    return ended if search(conditions) else None
