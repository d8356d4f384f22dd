# SPDX-License-Identifier: BSD-3-Clause
"""Children of concurrency containers that are interchangeable, such as robots that do the same.

Where two of them are in the same situation, what can happen to the one is the mirror image of what can happen to the
other: to follow one of them is enough. What is left out is left out only there, so that all that is followed happens as
it is told, and the nearest way to something wrong is as long as without.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any

from flexbt_core.state_machine import MachineDefinition, StateDefinition, StateKind

from .state_models import ModelState

Group = tuple[str, ...]
"""The paths of children that are interchangeable, in their order."""


def interchangeable(machine: MachineDefinition) -> list[Group]:
    """Those of all containers in a machine of models, outermost first. None of them has a time of its own: of two that
    are due at once, the first may end what the other is in. Neither has one priority, which is the first one's."""
    return [group for node in machine.nodes() if isinstance(node, MachineDefinition) for group in _groups(node)]


def _groups(container: MachineDefinition) -> Iterator[Group]:
    if container.kind is not StateKind.CONCURRENCY:
        return
    groups: list[list[StateDefinition | MachineDefinition]] = []
    for child in container.children.values():
        for group in groups:
            if _shape(group[0]) == _shape(child) and _ends(container, group[0].label, child.label) == _ends(container):
                group.append(child)
                break
        else:
            groups.append([child])
    yield from (tuple(one.path for one in group) for group in groups if len(group) > 1)


def _ends(container: MachineDefinition, one: str = '', other: str = '') -> list[tuple[str, Any]]:
    """When a container ends, with two of its children exchanged. The order of conditions only matters where they have
    different outcomes."""
    exchanged = {one: other, other: one}
    return [
        (outcome, {frozenset((exchanged.get(label, label), by) for label, by in one.children) for one in conditions})
        for outcome, conditions in groupby(container.conditions, lambda one: one.outcome)
    ]


def _shape(node: StateDefinition | MachineDefinition) -> Any:
    """All of a child but its place: what is not the same is not interchangeable."""
    around = dict(node.transitions), dict(node.remap), node.outcomes
    if isinstance(node, StateDefinition):
        state = node.state
        if not isinstance(state, ModelState):  # one that is real, or has a time or attempts around it
            return node.path
        keys = set(state.input_keys), set(state.output_keys)
        return *around, *keys, state.model, state.is_instant, state.runs_while_blocked
    if node.kind is StateKind.PRIORITY:
        return node.path
    children: Mapping[str, Any] = {label: _shape(child) for label, child in node.children.items()}
    keys = set(node.input_keys), set(node.output_keys)
    return *around, *keys, node.kind, node.initial, set(node.defaults), _ends(node), children
