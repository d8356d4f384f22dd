# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's navigation servers as managed nodes, for those who look for them: each has some of the actions of one node."""

from __future__ import annotations

from functools import partial

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, goal_servers
from flexbt_common.lifecycle import ManagedPart
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.server_common import GoalEnd, finish


def manage_servers(runtime: NodeRuntime) -> None:
    """Have a lifecycle manager decide for each of them whether it works, when all actions are served. One that is not
    active rejects goals; those that it works on are aborted. On the executor thread."""
    for name, actions in names.ACTIONS_OF_SERVERS.items():
        _manage(runtime, name, actions)


def _manage(runtime: NodeRuntime, name: str, actions: tuple[str, ...]) -> None:
    admission = GoalAdmission(name)
    servers = [goal_servers(runtime)[action] for action in actions]
    for server in servers:
        server.admission = admission

    def on_change(is_active: bool) -> None:
        if is_active:
            admission.open()
            return
        admission.close('is inactive')
        for server in servers:
            server.end_all(partial(finish, end=GoalEnd(code='UNKNOWN', message=f'{name} was deactivated')))

    ManagedPart(runtime, name, on_change)
