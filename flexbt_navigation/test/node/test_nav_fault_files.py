# SPDX-License-Identifier: BSD-3-Clause
"""Faults of navigation servers from a world file, of a process of its own, and where there is none."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_prefix
from nav2_msgs.action import Wait

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError
from flexbt_sim.simulator.node import Simulator
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import FAST, open_probe, open_simulator, without_faults
from flexbt_testing.waiting import DEADLINE, wait_until


def test_without_navigation_nobody_carries_it_out() -> None:
    with open_simulator(**FAST) as probe:
        answer = probe.ask(SetFault, 'simulator/set_fault', SetFault.Request(fault='server_hangs'))
        assert not answer.success and 'nobody carries it out' in answer.message


FILE = """
plan: {rooms: [{from: [0, 0], to: [10, 6]}]}
robots:
  alpha: {model: burger, pose: [1, 1, 0]}
  beta: {model: burger, pose: [1, 4, 0]}
faults: [{entity: alpha, fault: FAULT, parameters: PARAMETERS, after: 0.2}]
"""


def world_file(directory: Path, fault: str, parameters: str) -> str:
    file = directory / 'hall.yaml'
    file.write_text(FILE.replace('FAULT', fault).replace('PARAMETERS', parameters))
    return str(file)


@pytest.mark.dds('a fault kills a process')
def test_a_fault_of_a_world_file_is_there_and_another_one_kills_the_process_of_the_robot(tmp_path: Path) -> None:
    file = world_file(tmp_path, 'server_refuses', '{server: wait}')
    program = Path(get_package_prefix('flexbt_navigation')) / 'lib' / 'flexbt_navigation' / 'navigation'
    words = [str(program), '--ros-args', '-r', '__ns:=/alpha', '-p', 'use_sim_time:=true']
    with (
        without_faults(names.SIMULATOR, parameters={'world': file}) as simulator,
        open_probe() as probe,
        subprocess.Popen(words, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as navigation,
    ):
        try:
            Simulator(simulator)

            def goal() -> Any:
                return SentGoal(probe.links.link(Wait, f'/alpha/{names.WAIT}'), Wait.Goal(), DEADLINE)

            wait_until(lambda: goal().wait().status is GoalStatus.REJECTED, 'the fault of the file')

            def dies(entity: str) -> Any:
                request = SetFault.Request(entity=entity, fault='server_dies')
                return probe.ask(SetFault, 'simulator/set_fault', request)

            answer = dies('beta')
            assert not answer.success and "'beta'" in answer.message, answer.message
            assert dies('alpha').success
            _, err = navigation.communicate(timeout=DEADLINE)
            assert navigation.returncode == -signal.SIGKILL, err
            assert 'follow_path dies' in err
        finally:
            navigation.kill()


def test_a_world_file_with_a_code_that_the_action_does_not_know_is_refused(tmp_path: Path) -> None:
    file = world_file(tmp_path, 'server_fails', '{server: spin, error_code: 9}')
    with (
        NodeRuntime.open(names.SIMULATOR, parameters={'world': file}) as runtime,
        pytest.raises(SimulationError, match='spin does not know 9; it has 0 '),
    ):
        Simulator(runtime)
