# SPDX-License-Identifier: BSD-3-Clause
"""The service ``control_tree``: pauses, resumes and steps running trees."""

from __future__ import annotations

from typing import Any, Final

from rclpy.task import Future

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import check_limits
from flexbt_core.behavior_tree import TickCommand
from flexbt_core.errors import FlexbtError
from flexbt_core.values import sendable
from flexbt_msgs.srv import ControlTree
from flexbt_server.goals import TreeGoals

_COMMANDS: Final = {
    ControlTree.Request.PAUSE: TickCommand.PAUSE,
    ControlTree.Request.RESUME: TickCommand.RESUME,
    ControlTree.Request.STEP: TickCommand.STEP,
}


class ControlServer:
    """Serves ControlTree, for any number of clients.

    Every request is answered when the command has had its effect, or can have none any more.
    """

    def __init__(self, runtime: NodeRuntime, goals: TreeGoals) -> None:
        self._runtime = runtime
        self._goals = goals
        runtime.node.create_service(ControlTree, names.CONTROL_TREE, self._serve)

    async def _serve(self, request: Any, response: Any) -> Any:
        response.message = await self._obey(request, response)
        response.success = not response.message
        return response

    async def _obey(self, request: Any, response: Any) -> str:
        """'' when the command has had its effect; otherwise why not."""
        command = _COMMANDS.get(request.command)
        if command is None:
            known = ', '.join(f'{number} ({known.name})' for number, known in _COMMANDS.items())
            return f'command {request.command} is unknown; known commands: {known}'
        answered = Future(executor=self._runtime.node.executor)
        try:
            check_limits(request)
            run = self._goals.control(
                request.run_id,
                command,
                request.owner,
                lambda reason: self._runtime.post(lambda: answered.set_result(reason)),
            )
        except FlexbtError as error:
            return str(error)
        refusal = str(await answered)
        if command is not TickCommand.RESUME and not refusal:
            response.not_paused = [sendable(line) for line in run.not_paused]
        return refusal
