# SPDX-License-Identifier: BSD-3-Clause
"""A bench for the executive, which runs on one node while an operator on another node supervises it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, BehaviorLibrary
from flexbt_onboard.node.executive import open_executive
from flexbt_onboard.node.executive_parameters import ExecutiveParameters

from .operator import Operator


def entry_of(behavior: type[Behavior]) -> BehaviorEntry:
    """Return a library entry like that of an installed package."""
    return BehaviorEntry(
        behavior.manifest.name, 'test', behavior.manifest, tuple(behavior().parameters.values()), behavior
    )


def behavior_of(make: Callable[[], OperatableStateMachine], name: str = 'Test') -> type[Behavior]:
    """Return a behavior without parameters whose machine ``make`` creates."""

    class Made(Behavior):
        manifest = BehaviorManifest(name)

        def create(self) -> OperatableStateMachine:
            return make()

    return Made


class ExecutiveBench(Operator):
    """An executive, and its operator on a separate node."""

    def __init__(
        self,
        *behaviors: type[Behavior],
        parameters: ExecutiveParameters | None = None,
        ros_parameters: Mapping[str, Any] | None = None,
    ) -> None:
        self.runtime = NodeRuntime('onboard_executive', args=(), parameters=ros_parameters)
        super().__init__(NodeRuntime('console', args=()))
        library = BehaviorLibrary(entry_of(behavior) for behavior in behaviors)
        self.executive = open_executive(self.runtime, parameters or ExecutiveParameters(peers=()), library)
        self.wait_connected()

    def close(self) -> None:
        """Close both nodes."""
        self.runtime.close()
        super().close()
