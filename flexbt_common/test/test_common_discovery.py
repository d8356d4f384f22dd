# SPDX-License-Identifier: BSD-3-Clause
"""Processes of this computer find each other without shared memory; those that have other settings find them, too."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from std_msgs.msg import Empty

from flexbt_common import discovery
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system import networks
from flexbt_testing.system.networks import NetworkNamespace
from flexbt_testing.waiting import wait_until

PUBLISH = """
import time, rclpy
from std_msgs.msg import Empty
rclpy.init()
publisher = rclpy.create_node('other').create_publisher(Empty, 'hello', 1)
while True:
    publisher.publish(Empty())
    time.sleep(0.05)
"""

pytestmark = pytest.mark.skipif(
    os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp') != 'rmw_fastrtps_cpp',
    reason='profiles are those of Fast DDS',
)


def shared_memory(process: int | str) -> list[str]:
    """Return what a process has of Fast DDS's shared memory."""
    return [line for line in Path(f'/proc/{process}/maps').read_text().splitlines() if 'shm/fast' in line]


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('range_of_other', ['', 'LOCALHOST', 'SUBNET'])
def test_processes_hear_each_other(range_of_other: str) -> None:
    environment = dict(os.environ)
    if range_of_other:
        environment |= {discovery.RANGE: range_of_other, discovery.PROFILE: ''}
    heard: list[Empty] = []
    with NodeRuntime.open('here') as runtime:
        runtime.call(lambda: runtime.node.create_subscription(Empty, 'hello', heard.append, 1))
        with subprocess.Popen([sys.executable, '-c', PUBLISH], env=environment) as other:
            try:
                wait_until(lambda: heard, 'a message of the other process', 60.0)
                assert not shared_memory('self')
                assert bool(shared_memory(other.pid)) is bool(range_of_other)
            finally:
                other.kill()


@pytest.mark.parametrize('name', ['this_computer', 'network', 'radio_robot', 'radio_console'])
def test_a_profile_differs_between_versions_of_fast_dds_only_in_the_name_of_an_element(name: str) -> None:
    config = Path(__file__).parents[1] / 'config'
    texts = [(config / place / f'{name}.xml').read_text(encoding='utf-8') for place in ('', 'fastdds3')]
    of_2, of_3 = (re.sub(r'<!--.*?-->|\s+', '', text, flags=re.DOTALL) for text in texts)
    assert of_2.replace('heartbeatPeriod', 'heartbeat_period') == of_3 != of_2


def test_it_is_told_that_there_is_no_loopback_interface() -> None:
    if reason := networks.missing():
        pytest.skip(reason)
    environment: dict[str, str] = {}
    discovery.only_this_computer(environment)
    discovery.check_loopback(environment)
    with NetworkNamespace(loopback=False) as network:
        network.call(lambda: discovery.check_loopback({}))  # they go another way
        with pytest.raises(OSError, match='no loopback interface'):
            network.call(lambda: discovery.check_loopback(environment))


def test_with_another_middleware_the_range_says_it() -> None:
    environment = {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}
    discovery.only_this_computer(environment)
    assert environment[discovery.RANGE] == 'LOCALHOST' and discovery.PROFILE not in environment
