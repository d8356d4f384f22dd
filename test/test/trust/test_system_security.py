# SPDX-License-Identifier: BSD-3-Clause
"""The security policy beside the graph of a running robot: all that it needs is allowed, and nothing else."""

from __future__ import annotations

import re
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ament_index_python.packages import get_package_prefix

from flexbt_common import interfaces
from flexbt_common.names import SIMULATOR
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import silent_console

NAMES = (
    'simulator',
    'navigation',
    'bt_server',
    'onboard_executive',
    'stop_guard',
    'console',
    'observer',
    'recorder',
    'black_box',
)
READING = {'publisher': 'publish', 'subscriber': 'subscribe', 'service': 'reply', 'client': 'request'}
"""What the graph calls by which name, and the word of a policy for it."""
PARTS = re.compile(r'/_action/(feedback|status|send_goal|cancel_goal|get_result)$')
ON_DEMAND = frozenset(
    {
        ('subscribe', 'clock'),
        ('subscribe', 'parameter_events'),
        ('execute', '/behavior_synthesis'),
        ('reply', '/gripper'),
        ('publish', '/gripper_holds'),
        ('publish', '/imu'),
        ('publish', '/range'),
        ('publish', '/keepout_costmap_filter_info'),
        ('publish', '/keepout_filter_mask'),
    }
)
"""Interfaces that a node has only with some parameter, with another package, with a device that not every robot has, or
in a world with a no-go zone."""

Right = tuple[str, str]
"""What may be done, and with what: ('publish', '/cmd_vel'); an action is a name with the word execute or call."""


@cache
def policy(*words: str) -> dict[tuple[str, str], set[Right]]:
    """Return the policy: the rights by (enclave, node)."""
    program = Path(get_package_prefix('flexbt_tools')) / 'lib/flexbt_tools/security_policy'
    done = subprocess.run([program, *words], capture_output=True, check=True, text=True)
    rights: dict[tuple[str, str], set[Right]] = {}
    for enclave in ElementTree.fromstring(done.stdout).iter('enclave'):  # noqa: S314 our own output
        for profile in enclave.iter('profile'):
            node, namespace = profile.attrib['node'], profile.attrib['ns'].rstrip('/')
            rights[enclave.attrib['path'], node] = {
                (next(iter(rule.attrib)), absolute(one.text or '', namespace, node)) for rule in profile for one in rule
            }
    return rights


def absolute(name: str, namespace: str, node: str) -> str:
    if name.startswith('~/'):
        return f'{namespace}/{node}{name[1:]}'
    return name if name.startswith('/') else f'{namespace}/{name}'


def used(probe: Probe) -> dict[str, set[Right]]:
    """Return what each node of the robot publishes, serves, and so on, now; with the nodes that are parts of it."""
    node = probe.console.node
    found: dict[str, set[Right]] = defaultdict(set)
    whole = {part: name for name, parts in interfaces.PARTS.items() for part in parts}
    for name, namespace in node.get_node_names_and_namespaces():
        owner = whole.get(name, name)
        if owner not in NAMES:
            continue
        for what, right in READING.items():
            for topic, _ in getattr(node, f'get_{what}_names_and_types_by_node')(name, namespace):
                base, parts = PARTS.subn('', topic)
                serves = what in ('publisher', 'service')
                found[owner].add((('execute' if serves else 'call') if parts else right, base))
    return found


def offered_by(node: str) -> set[Right]:
    """Return what a node has to offer at all times, by the policy."""
    rights = next(rights for (_, name), rights in policy().items() if name == node)
    return {right for right in rights if right[0] in ('publish', 'reply', 'execute')} - ON_DEMAND


def are_known(probe: Probe) -> bool:
    """Return whether all is known by now that the parts of nodes serve."""
    node = probe.console.node
    there = dict(node.get_node_names_and_namespaces())
    return all(
        part in there
        and len(node.get_service_names_and_types_by_node(part, there[part]))
        == (11 if part in interfaces.SETTABLE_SERVERS else 5)
        for parts in interfaces.PARTS.values()
        for part in parts
    )


@pytest.fixture
def driven(tmp_path: Path) -> Iterator[dict[str, set[Right]]]:
    """Yield what the nodes have used while a mission was driven."""
    with Stack(tmp_path) as stack, NodeRuntime.open('probe') as runtime:
        navigators = '[navigate_to_pose, navigate_through_poses, follow_waypoints]'
        stack.start_all({'speed_factor': '4.0'}, {'navigators': navigators})
        stack.start('recorder', {'file': str(tmp_path / 'run.mcap')})
        directories = {name: str(tmp_path / name) for name in ('ring', 'incidents')}
        stack.start('black_box', {'goals': 'false', **directories})  # it hears of what goals it may
        probe = Probe(runtime)
        with silent_console('watch'), silent_console('watch', '--observer'):
            probe.wait_ready()
            probe.wait(lambda: set(NAMES) <= set(used(probe)), 'all nodes in the graph')
            probe.wait(lambda: are_known(probe), 'their parts')
            probe.drive_to(3.8, 1.2)
            probe.wait(lambda: used(probe)[SIMULATOR] >= offered_by(SIMULATOR), 'the services of the simulator')
            rights = used(probe)
            probe.stop()
            probe.wait_state(ExecutiveStatus.IDLE)
        yield rights


def test_a_mission_needs_no_more_than_the_policy_allows_and_offers_all_of_it(driven: dict[str, set[Right]]) -> None:
    allowed = {node: rights for (_, node), rights in policy().items()}
    assert set(allowed) == set(NAMES)
    for node, rights in allowed.items():
        assert driven[node] - rights == set(), f'{node} uses what no policy allows'
        assert offered_by(node) - driven[node] == set(), f'{node} is allowed to offer what it never does'


def test_who_observes_moves_nothing(tmp_path: Path) -> None:
    rights = policy('/robot1')
    for node in ('observer', 'recorder', 'black_box'):
        published = {name for right, name in rights['/robot1/observer', node] if right == 'publish'}
        own = {f'/robot1/{node}/alive', f'/robot1/{node}/incidents'}
        assert published <= {'/rosout', '/parameter_events', '/robot1/executive/ping', *own}
    assert ('publish', '/robot1/cmd_vel') not in rights['/robot1/operator', 'console']
    assert not any(right in ('call', 'request') for right, name in rights['/robot1/robot', SIMULATOR])


@pytest.mark.parametrize('namespace', ['robot1', '/robot 1', '//a', '/a/', '/1a', ''])
def test_a_namespace_that_is_none_is_refused(namespace: str) -> None:
    program = Path(get_package_prefix('flexbt_tools')) / 'lib/flexbt_tools/security_policy'
    done = subprocess.run([program, namespace], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and 'is not an absolute namespace' in done.stderr
