# SPDX-License-Identifier: BSD-3-Clause
"""A BT server, real action and service servers in place of navigation, and a client, all in this process."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import SmoothPath
from nav2_msgs.msg import RouteNode
from nav2_msgs.srv import ClearEntireCostmap, IsPathValid

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, ActionServerLink
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import Encoding, to_entry
from flexbt_msgs.action import BtExecute, BtGetData, BtLoad, BtSetData
from flexbt_server.bt_server import BtServer

from .clients import ACTIONS, SentGoal
from .scripted_action_server import GoalAnswer, ScriptedActionServer


def pose_stamped(x: float, y: float = 0.0, frame: str = 'map') -> PoseStamped:
    """Return a pose in the map."""
    stamped = PoseStamped()
    stamped.header.frame_id = frame
    stamped.pose.position.x, stamped.pose.position.y = float(x), float(y)
    stamped.pose.orientation.w = 1.0
    return stamped


ALWAYS: Final = (
    names.COMPUTE_PATH_TO_POSE,
    names.COMPUTE_PATH_THROUGH_POSES,
    names.FOLLOW_PATH,
    names.SPIN,
    names.BACKUP,
    names.WAIT,
    names.DRIVE_ON_HEADING,
)
"""Actions served in every world."""

ON_DEMAND: Final = {name: action for name, action in ACTIONS.items() if name not in ALWAYS}
"""Actions that a test serves by :meth:`Navigation.serve`."""


class Navigation:
    """Stand-ins for the navigation servers, with counters. Each succeeds unless set to fail its first goals."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.fail: dict[str, tuple[int, int]] = {}
        """By server: the number of first goals that fail, and their error code."""
        self.hold: set[str] = set()
        self.cleared = {'global': 0, 'local': 0}
        self.path_valid = True
        self.actions: dict[str, ScriptedActionServer] = {}
        self._runtime = runtime
        self.serve({name: ACTIONS[name] for name in ALWAYS})
        self.actions[names.FOLLOW_PATH].preempting = True

        def services() -> None:
            node = runtime.node
            for which, name in (('global', names.CLEAR_GLOBAL_COSTMAP), ('local', names.CLEAR_LOCAL_COSTMAP)):
                node.create_service(ClearEntireCostmap, name, self._clear(which))
            node.create_service(IsPathValid, names.IS_PATH_VALID, self._is_path_valid)

        runtime.call(services)

    def serve(self, actions: Mapping[str, type[Any]]) -> None:
        """Serve these actions too."""
        for name, action in actions.items():
            answer = self._answer(name, action)
            self.actions[name] = ScriptedActionServer(self._runtime, action, name, answer=answer)

    def count(self, name: str) -> int:
        """Return the number of goals that a server has received."""
        return len(self.actions[name].goals)

    def _answer(self, name: str, action: Any) -> GoalAnswer:
        def answer(number: int, goal: Any) -> Any:
            failures, code = self.fail.get(name, (0, 0))
            if number < failures:
                return 'abort', action.Result(error_code=code, error_msg=f'scripted failure {number}')
            if name in self.hold:
                return None
            result = action.Result()
            if action is SmoothPath:
                result.path = goal.path
            elif hasattr(result, 'path'):
                target = goal.goal if hasattr(goal, 'goal') else goal.goals[-1]
                result.path.header.frame_id = 'map'
                result.path.poses = [pose_stamped(0.0), target]
                if hasattr(result, 'route'):  # a route that does not begin and end exactly at start and goal
                    goal_at = target.pose.position
                    result.path.poses = [pose_stamped(0.0, 1.0), pose_stamped(goal_at.x, goal_at.y + 1.0)]
                    result.route.header.frame_id = 'map'
                    places = (one.pose.position for one in result.path.poses)
                    result.route.nodes = [RouteNode(nodeid=id, position=place) for id, place in enumerate(places)]
            return 'succeed', result

        return answer

    def _clear(self, which: str) -> Callable[[Any, Any], Any]:
        def clear(request: Any, response: Any) -> Any:
            self.cleared[which] += 1
            return response

        return clear

    def _is_path_valid(self, request: Any, response: Any) -> Any:
        response.is_valid = self.path_valid and bool(request.path.poses)
        return response


class Client:
    """A node that uses the BT server."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self._links = ActionLinks(runtime)
        self.loader = self._links.link(BtLoad, names.BT_LOADER)
        self.executor = self._links.link(BtExecute, names.BT_EXECUTOR)

    @cached_property
    def getter(self) -> ActionServerLink:
        """Client that reads entries, created on first use."""
        return self._links.link(BtGetData, names.BT_GET_DATA)

    @cached_property
    def setter(self) -> ActionServerLink:
        """Client that writes entries, created on first use."""
        return self._links.link(BtSetData, names.BT_SET_DATA)

    def load(self, *files: str, xml: str = '') -> Any:
        """Load files or XML, and return the result."""
        return SentGoal(self.loader, BtLoad.Goal(files=list(files), xml=xml)).result

    def load_tree(self, body: str, tree: str = 'Main') -> None:
        """Load one tree with this body, and check that it is accepted."""
        result = self.load(xml=document(body, tree))
        assert result.code == BtLoad.Result.SUCCESS, result.message

    def execute(
        self, tree: str = 'Main', goals: Sequence[PoseStamped] = (), inputs: dict[str, Any] | None = None, **fields: Any
    ) -> SentGoal:
        """Send a goal."""
        entries = [to_entry(key, value, encoding=Encoding.BINARY) for key, value in (inputs or {}).items()]
        return SentGoal(self.executor, BtExecute.Goal(behavior_tree=tree, goals=list(goals), inputs=entries, **fields))

    def get(self, *keys: str, blackboard: str = '', encoding: int = BtGetData.Goal.BINARY) -> Any:
        """Read entries and return the result."""
        goal = BtGetData.Goal(keys=list(keys), blackboard=blackboard, encoding=encoding)
        return SentGoal(self.getter, goal).result

    def set(self, *entries: Any, blackboard: str = '') -> Any:
        """Write entries and return the result."""
        return SentGoal(self.setter, BtSetData.Goal(entries=list(entries), blackboard=blackboard)).result


def document(body: str, tree: str = 'Main') -> str:
    """Return a document with one tree, which is its main tree."""
    return (
        f'<root BTCPP_format="4" main_tree_to_execute="{tree}"><BehaviorTree ID="{tree}">{body}</BehaviorTree></root>'
    )


class ServerWorld:
    """A server, navigation and a client."""

    def __init__(self, server: NodeRuntime, navigation: NodeRuntime, client: NodeRuntime) -> None:
        self.server_runtime = server
        self.navigation_runtime = navigation
        self.server = BtServer(server)
        self.navigation = Navigation(navigation)
        self.client = Client(client)


@contextlib.contextmanager
def open_server_world(**parameters: Any) -> Iterator[ServerWorld]:
    """Provide a server with these parameters, navigation and client."""
    with (
        NodeRuntime.open('navigation') as navigation,
        NodeRuntime.open('bt_server', parameters={'server_timeout': 10.0, 'start_timeout': 0.0} | parameters) as server,
        NodeRuntime.open('client') as client,
    ):
        yield ServerWorld(server, navigation, client)


def install_nodes(directory: Path, module: str) -> None:
    """Make ``module:register`` visible to Python as an entry point of an installed package."""
    info = directory / 'flexbt_test_nodes-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: flexbt-test-nodes\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text(f'[flexbt.bt_nodes]\nnodes = {module}:register\n')
    sys.path.insert(0, str(directory))
