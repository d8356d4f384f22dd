# SPDX-License-Identifier: BSD-3-Clause
"""What the host of a state machine gives to its states: their way to ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from flexbt_common.calls import ActionLinks, ServiceLinks
from flexbt_common.runtime import NodeRuntime
from flexbt_core.values import shown

from .run_goals import RunGoals

if TYPE_CHECKING:
    from flexbt_core.state_machine import EventState

READY_SECONDS: Final = 15.0
"""How long a node that is alive is waited for until it is ready, s of wall time. To begin takes it seconds, and several
times as many on a machine that is busy."""


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class StateServices:
    """The services of a run; a state gets it with :func:`state_services`.

    ``runtime`` owns the node and the thread on which everything of rclpy happens, ``actions`` and ``services`` are
    the shared clients, and ``node_name`` is the fully qualified name of the node that runs the states: what
    happens on its behalf elsewhere ends when it dies. ``changed`` tells the host, from any thread, that something
    that the operator is shown has changed: the state's activity. ``unready`` names the nodes that are alive but not
    ready yet: the servers that a state wants may be among them. ``goals`` are those that the states of the run have
    sent.
    """

    runtime: NodeRuntime
    actions: ActionLinks
    services: ServiceLinks
    node_name: str
    changed: Callable[[], None] = field(default=_nothing)
    unready: Callable[[], Sequence[str]] = field(default=tuple)
    goals: RunGoals = field(default_factory=RunGoals)

    @classmethod
    def of(cls, runtime: NodeRuntime) -> StateServices:
        """Those of a node that knows nothing of others."""
        return runtime.call(
            lambda: cls(runtime, ActionLinks(runtime), ServiceLinks(runtime), runtime.node.get_fully_qualified_name())
        )


def state_services(state: EventState) -> StateServices:
    """The services that a state was given by its host.

    Raises:
        TypeError: the state machine runs without ROS.
    """
    services = state.services
    if not isinstance(services, StateServices):
        raise TypeError(
            f'{type(state).__name__} {state.path}: needs ROS; run its machine with StateServices as services, '
            f'not {shown(services)}'
        )
    return services
