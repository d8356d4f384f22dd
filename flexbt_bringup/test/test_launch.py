# SPDX-License-Identifier: BSD-3-Clause
"""The launch file of a robot, with stand-ins for the packages of launch, which the wheels do not have."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexbt_testing.launch_files import nodes_of

FILE = Path(__file__).parents[1] / 'launch' / 'robot.launch.py'


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
    nodes = nodes_of(FILE, monkeypatch)
    arguments = {'navigators': given, 'use_sim_time': simulated, 'black_box': 'true'}
    started = {node['executable']: node for node in nodes(arguments)}
    assert set(started) == {'bt_server', 'onboard_executive', 'stop_guard', 'black_box'}
    time = [{'use_sim_time': True}] if simulated == 'true' else []
    assert started['bt_server']['parameters'][1:] == time + ([{'navigators': served}] if served else [])
    assert started['onboard_executive']['parameters'][1:] == time
