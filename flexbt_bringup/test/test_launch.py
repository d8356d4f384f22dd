# SPDX-License-Identifier: BSD-3-Clause
"""The launch file of a robot, with stand-ins for the packages of launch, which the wheels do not have."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

FILE = Path(__file__).parents[1] / 'launch' / 'robot.launch.py'


class LaunchConfiguration:
    """An argument of the launch, which a dictionary has."""

    def __init__(self, name: str) -> None:
        self._name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self._name]


@pytest.mark.parametrize(
    ('given', 'served'),
    [
        ('[]', None),
        ('[navigate_to_pose, follow_waypoints]', ['navigate_to_pose', 'follow_waypoints']),
        ('navigate_to_pose', ['navigate_to_pose']),
    ],
)
@pytest.mark.parametrize('simulated', ['true', 'false'])
def test_arguments_that_are_given_override_the_file(
    monkeypatch: pytest.MonkeyPatch, given: str, served: list[str] | None, simulated: str
) -> None:
    anything: Any = SimpleNamespace(
        LaunchConfiguration=LaunchConfiguration,
        LaunchContext=dict,
        LaunchDescription=list,
        DeclareLaunchArgument=dict,
        OpaqueFunction=dict,
        Node=dict,
    )
    for module in ('launch', 'launch.actions', 'launch.substitutions', 'launch_ros', 'launch_ros.actions'):
        monkeypatch.setitem(sys.modules, module, anything)
    nodes = runpy.run_path(str(FILE))['nodes']
    arguments = {'navigators': given, 'use_sim_time': simulated, 'black_box': 'true'}
    started = {node['executable']: node for node in nodes(arguments)}
    assert set(started) == {'bt_server', 'onboard_executive', 'stop_guard', 'black_box'}
    time = [{'use_sim_time': True}] if simulated == 'true' else []
    assert started['bt_server']['parameters'][1:] == time + ([{'navigators': served}] if served else [])
    assert started['onboard_executive']['parameters'][1:] == time
