# SPDX-License-Identifier: BSD-3-Clause
"""Parameters that cannot work: one line that names the parameter, its value and what would work."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.errors import FlexbtError
from flexbt_navigation.node import Navigation
from flexbt_sim.simulator.node import Simulator


@pytest.mark.parametrize(
    ('setting', 'said'),
    [
        ('map:=/nowhere/flat.yaml', ['/nowhere/flat.yaml', 'cannot be read']),
        ('map:=/', ['/: ', 'cannot be read']),
        ('initial_pose:=[1.0, 3.45, 0.0]', ["'initial_pose'", '(1, 3.45, 0)', 'obstacle', '0.22 m']),
        ('initial_pose:=[100.0, 1.0, 0.0]', ["'initial_pose'", '(100, 1, 0)', 'outside of the map', '12 x 9 m']),
        ('initial_pose:=[.nan, 1.0, 0.0]', ["'initial_pose'", 'nan', 'finite']),
        ('initial_pose:=[1.0, 1.0]', ["'initial_pose'", '[1.0, 1.0]', '[x, y, yaw]']),
        ('radius:=-0.2', ["'radius'", '-0.2', '0.01']),
        ('watchdog:=.nan', ["'watchdog'", 'nan', '0.05']),
        ('speed_factor:=-1.0', ["'speed_factor'", '-1.0', '1000']),
        ('speed_factor:=fast', ["'speed_factor'", "'fast'", '1.0']),
        ('seed:=-1', ["'seed'", '-1']),
        ('scan_beams:=0', ["'scan_beams'", 'write a value from 1 to ']),
        ('scan_range_min:=4.0', ["'scan_range_min'", '4 m', "'scan_range_max'", '3.5 m']),
    ],
)
def test_the_simulator_says_what_it_cannot_work_with(setting: str, said: list[str]) -> None:
    refuse(Simulator, setting, said)


@pytest.mark.parametrize(
    ('setting', 'said'),
    [
        ('robot_radius:=-0.2', ["'robot_radius'", '-0.2', '0.001']),
        ('robot:=alpha', ["'robot'", 'alpha', "'world'"]),
        ('world:=/nowhere/hall.yaml', ["'world'", '/nowhere/hall.yaml', 'cannot be read']),
        ('xy_goal_tolerance:=0.0', ["'xy_goal_tolerance'", '0.0', '0.01']),
        ('owner_nodes:=bt_server', ["'owner_nodes'", "['bt_server']"]),
    ],
)
def test_navigation_says_what_it_cannot_work_with(setting: str, said: list[str]) -> None:
    refuse(Navigation, setting, said)


def refuse(node: Callable[[NodeRuntime], object], setting: str, said: list[str]) -> None:
    """Check that the node refuses the setting, in one line with all of this."""
    with NodeRuntime.open('refusing', args=['--ros-args', '-p', setting]) as runtime:
        with pytest.raises(FlexbtError) as refused:
            node(runtime)
        text = str(refused.value)
        assert '\n' not in text
        assert [word for word in said if word not in text] == [], text
