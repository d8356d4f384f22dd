# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the navigators, with the names that they have in Nav2 where Nav2 has them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from flexbt_common import names
from flexbt_common.files import home_path
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_server.errors import ServerParameterError

NAVIGATORS: Final = (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS)
"""What can be served."""

DEFAULT_TREES: Final = {
    names.NAVIGATE_TO_POSE: 'default_nav_to_pose_bt_xml',
    names.NAVIGATE_THROUGH_POSES: 'default_nav_through_poses_bt_xml',
}
"""The parameter of the default tree of each navigator that runs trees."""

WAIT: Final = 'wait_at_waypoint'
INPUT: Final = 'input_at_waypoint'
TASKS: Final = (WAIT, INPUT)
"""What can be done at waypoints."""


@dataclass(frozen=True)
class InputParameters:
    """Of the task executor input_at_waypoint: ``timeout`` in s of the clock of the node."""

    topic: str
    timeout: float


@dataclass(frozen=True)
class NavigatorParameters:
    """Values of the parameters; see :func:`declare_navigator_parameters` for meaning and unit."""

    navigators: tuple[str, ...]
    default_trees: dict[str, str]
    search_directories: tuple[Path, ...]
    global_frame: str
    goal_key: str
    goals_key: str
    path_key: str
    statuses_key: str
    stop_on_failure: bool
    waypoint_pause: float
    waypoint_input: InputParameters | None

    @property
    def trusted(self) -> tuple[Path, ...]:
        """Files and directories that the parameters name by absolute paths: whoever sets parameters may use any."""
        trees = (Path(tree) for tree in self.default_trees.values() if tree.startswith('/'))
        return (*trees, *self.search_directories)

    @property
    def found_files(self) -> list[Path]:
        """The XML files of the search directories."""
        return [file for directory in self.search_directories for file in sorted(directory.glob('*.xml'))]


def declare_navigator_parameters(declare: ParameterDeclarer) -> NavigatorParameters:
    """Declare the parameters and read them.

    Raises:
        ServerParameterError, UnfitParameterError: a value that cannot work.
    """
    served = declare.texts(
        'navigators', (), f'actions that are served as by bt_navigator and waypoint_follower: {", ".join(NAVIGATORS)}'
    )
    for name in served:
        if name not in NAVIGATORS:
            actions = f'{", ".join(NAVIGATORS)}{did_you_mean(name, NAVIGATORS)}'
            raise ServerParameterError(
                f"parameter 'navigators': {short_repr(name)} is not served; write one of {actions}"
            )
    trees = {
        name: declare.fixed.text(
            parameter,
            f'flexbt_server/behavior_trees/{name}.xml',
            f'tree of a goal of {name} that names none: package/path.xml, an absolute path, or the ID of a loaded tree',
        )
        for name, parameter in DEFAULT_TREES.items()
    }
    directories = tuple(
        home_path(text)
        for text in declare.fixed.texts(
            'bt_search_directories',
            (),
            'directories whose XML files are loaded at the start; goals may name their trees by ID',
        )
    )
    for directory in directories:
        if not (directory.is_absolute() and directory.is_dir()):
            raise ServerParameterError(
                f"parameter 'bt_search_directories': {directory} is not the absolute path of a directory"
            )
    task = declare.text(
        'waypoint_task_executor_plugin', WAIT, f'what follow_waypoints does at each waypoint: {", ".join(TASKS)}'
    )
    if task not in TASKS:
        raise ServerParameterError(
            f"parameter 'waypoint_task_executor_plugin': {task!r} is not one of {', '.join(TASKS)}; a robot that does "
            'something else at waypoints has a behavior or a tree that does it'
        )
    pauses = declare.flag(f'{WAIT}.enabled', True, 'whether it pauses there')
    pause = declare.integer(
        f'{WAIT}.waypoint_pause_duration', 0, 0, 86_400_000, 'how long it pauses, ms of the clock of the node'
    )
    asks = declare.flag(f'{INPUT}.enabled', True, 'whether it waits there for a message')
    asked = InputParameters(
        declare.text(f'{INPUT}.input_topic', f'{INPUT}/input', 'topic of the message, std_msgs/Empty'),
        declare.real(
            f'{INPUT}.timeout', 10.0, 0.01, 86_400.0, 'how long it waits for it at most, s of the clock of the node'
        ),
    )
    return NavigatorParameters(
        navigators=served,
        default_trees={name: tree for name, tree in trees.items() if name in served},
        search_directories=directories,
        global_frame=declare.text(
            'global_frame',
            'map',
            'frame of robot and goals where none is named, and of the goals of navigators',
        ),
        goal_key=declare.text('goal_blackboard_id', 'goal', 'blackboard key of the goal of navigate_to_pose'),
        goals_key=declare.text('goals_blackboard_id', 'goals', 'blackboard key of those of navigate_through_poses'),
        path_key=declare.text('path_blackboard_id', 'path', 'blackboard key of the path that the robot follows'),
        statuses_key=declare.text(
            'waypoint_statuses_blackboard_id',
            'waypoint_statuses',
            'blackboard key of what has become of each of them, for trees of the branch main',
        ),
        stop_on_failure=declare.flag(
            'stop_on_failure', True, 'whether follow_waypoints ends when a waypoint cannot be reached'
        ),
        waypoint_pause=pause * 1e-3 if pauses and task == WAIT else 0.0,
        waypoint_input=asked if asks and task == INPUT else None,
    )
