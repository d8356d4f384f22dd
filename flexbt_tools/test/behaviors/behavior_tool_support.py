# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors for the tests."""

from __future__ import annotations

import functools

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_server.node_types import node_registry
from flexbt_tools.behaviors.built_behavior import BuiltBehavior
from flexbt_tools.behaviors.check import check_behavior


class Leaf(EventState):
    """A state of which only the declarations count."""

    def __init__(self, *outcomes: str, is_instant: bool = False) -> None:
        super().__init__(outcomes=outcomes)
        self.is_instant = is_instant  # type: ignore[misc]


def found(machine: OperatableStateMachine, *files: str) -> list[tuple[str, str]]:
    """Rule and path of what ``check`` finds in a machine."""
    behavior = BuiltBehavior('Test', define(machine))
    return [(one.rule.name, one.path) for one in check_behavior(behavior, files, _registry())]


@functools.cache
def _registry() -> NodeRegistry:
    return node_registry(_fail)


def _fail(source: str, error: object) -> None:
    raise AssertionError(f'{source}: {error}')
