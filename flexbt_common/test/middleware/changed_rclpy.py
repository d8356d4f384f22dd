# SPDX-License-Identifier: BSD-3-Clause
"""PATTERN REPLACEMENT: a managed node, and a client of it, on an rclpy whose source has been changed so.

Prints which uses of private parts are left.
"""

from __future__ import annotations

import re
import sys
import threading
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType
from typing import Any

from flexbt_testing.waiting import DEADLINE


class ChangedSource(SourceFileLoader):
    """Loads a module from its source with everything that matches replaced."""

    def get_code(self, fullname: str) -> CodeType:
        source = re.sub(sys.argv[1], sys.argv[2], self.get_data(self.path).decode())
        return compile(source, self.path, 'exec')


class ChangedRclpy:
    """Finds the modules of rclpy."""

    @staticmethod
    def find_spec(fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if fullname.partition('.')[0] != 'rclpy':
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = ChangedSource(spec.loader.name, spec.loader.path)
        return spec


def main() -> None:
    sys.meta_path.insert(0, ChangedRclpy)

    from lifecycle_msgs.srv import ChangeState, GetState

    from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome, GoalStatus
    from flexbt_common.calls.goal_server import GoalServer, ServedGoal
    from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
    from flexbt_common.lifecycle.managed_node import ManagedNode
    from flexbt_common.middleware import rclpy_private
    from flexbt_common.middleware.rclpy_private import is_usable
    from flexbt_common.runtime.node_runtime import NodeRuntime, Runtime
    from flexbt_msgs.action import BtGetData

    def serve(goal: ServedGoal) -> None:
        if goal.request.blackboard != 'endless':
            goal.succeed(BtGetData.Result(message='served'))

    class Server:
        """What the node is while it is configured."""

        def __init__(self, runtime: Runtime, refusal: str) -> None:
            runtime.call(
                lambda: GoalServer(
                    runtime, BtGetData, 'get', serve, lambda goal: goal.canceled(BtGetData.Result(message='stopped'))
                )
            )

        def activate(self) -> None:
            """Nothing to be done."""

        def deactivate(self, why: str, refusal: str, within: float) -> None:
            """Nothing to be done."""

    ended = threading.Semaphore(0)
    told: list[Any] = []

    def note(outcome: GoalOutcome | ServiceOutcome) -> None:
        told.append(outcome)
        ended.release()

    def outcome() -> Any:
        assert ended.acquire(timeout=DEADLINE), 'no outcome'
        return told.pop()

    def request(service: Any, name: str, message: Any) -> Any:
        link = ServiceLinks(caller).link(service, f'server/{name}')
        ServiceCall(link, message, on_done=note, server_timeout=DEADLINE, response_timeout=DEADLINE)
        response = outcome()
        assert response.ok, response.reason
        return response.response

    with NodeRuntime.open('server', node_class=ManagedNode) as runtime, NodeRuntime.open('caller') as caller:
        assert isinstance(runtime.node, ManagedNode)
        runtime.node.manage(runtime, Server)
        link = ActionLinks(caller).link(BtGetData, 'get')
        for _ in range(3):
            ActionCall(link, BtGetData.Goal(), on_done=note, server_timeout=DEADLINE, accept_timeout=DEADLINE)
            end = outcome()
            assert end.status is GoalStatus.SUCCEEDED and end.result.message == 'served', end
        call: ActionCall = ActionCall(
            link,
            BtGetData.Goal(blackboard='endless'),
            on_done=note,
            on_accepted=lambda: call.cancel(DEADLINE),
            server_timeout=DEADLINE,
            accept_timeout=DEADLINE,
        )
        end = outcome()
        assert end.status is GoalStatus.CANCELED and end.result.message == 'stopped', end
        assert request(GetState, 'get_state', GetState.Request()).current_state.label == 'active'
        deactivate = ChangeState.Request()
        deactivate.transition.label = 'deactivate'
        assert request(ChangeState, 'change_state', deactivate).success
        assert runtime.node.state == 'inactive'
    for name in ('EXECUTOR', 'PARAMETERS'):
        if is_usable(getattr(rclpy_private, name)):
            print(name)


if __name__ == '__main__':
    main()
