# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the navigators, with the names that they have in Nav2 where Nav2 has them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from flexbt_common import names
from flexbt_common.cli import home_path
from flexbt_common.runtime import ParameterDeclarer
from flexbt_server.errors import ServerParameterError

NAVIGATORS: Final = (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS)
"""What can be served."""

DEFAULT_TREES: Final = {
    names.NAVIGATE_TO_POSE: 'default_nav_to_pose_bt_xml',
    names.NAVIGATE_THROUGH_POSES: 'default_nav_through_poses_bt_xml',
}
"""The parameter of the default tree of each navigator that runs trees."""


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
            raise ServerParameterError(f"parameter 'navigators': {name!r} is not one of {', '.join(NAVIGATORS)}")
    trees = {
        name: declare.text(
            parameter,
            f'flexbt_server/behavior_trees/{name}.xml',
            f'tree of a goal of {name} that names none: package/path.xml, an absolute path, or the ID of a loaded tree',
        )
        for name, parameter in DEFAULT_TREES.items()
    }
    directories = tuple(
        home_path(text)
        for text in declare.texts(
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
    enabled = declare.flag('wait_at_waypoint.enabled', True, 'whether follow_waypoints pauses at each waypoint')
    pause = declare.integer(
        'wait_at_waypoint.waypoint_pause_duration', 0, 0, 86_400_000, 'how long it pauses, ms of the clock of the node'
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
        waypoint_pause=pause * 1e-3 if enabled else 0.0,
    )
