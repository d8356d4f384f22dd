# SPDX-License-Identifier: BSD-3-Clause
"""What ``flexbt doctor`` reports: each trouble is made with real nodes, and gone when its advice is followed."""

from __future__ import annotations

import contextlib
import json
import os
import pwd
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import pytest
import rclpy.qos
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist, TwistStamped
from nav2_msgs.action import ComputePathToPose, FollowPath, Spin, Wait
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from flexbt_bringup import cli, doctor
from flexbt_bringup.doctor import Finding, Level, RobotCheck, machine_findings, router_findings
from flexbt_bringup.graph import Graph, observe
from flexbt_bringup.manifest import manifest_text, proposed_nodes
from flexbt_common import names
from flexbt_common.runtime.node_runtime import LargeQueueNode, NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_server.node_manifests import read_manifest
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer


@pytest.fixture
def other() -> Iterator[NodeRuntime]:
    """Run a node of the robot."""
    with NodeRuntime.open('localization') as runtime:
        yield runtime


def findings(namespace: str = '', seconds: float = 3.0) -> list[Finding]:
    with NodeRuntime.open('doctor', namespace=namespace or None) as runtime:
        return list(RobotCheck(runtime, namespace, seconds).findings())


def of(found: list[Finding], check: str, level: Level = Level.ERROR) -> list[str]:
    return [one.what for one in found if one.check == check and one.level is level]


def publish_transform(runtime: NodeRuntime, age: float = 0.0, world: str = 'map', robot: str = 'base_link') -> Any:
    publisher = runtime.node.create_publisher(TFMessage, 'tf', 10)

    def send() -> None:
        transform = TransformStamped()
        moment = time.time() - age
        transform.header.frame_id, transform.child_frame_id = world, robot
        transform.header.stamp.sec, transform.header.stamp.nanosec = int(moment), int(moment % 1 * 1e9)
        transform.transform.rotation.w = 1.0
        publisher.publish(TFMessage(transforms=[transform]))

    return runtime.node.create_timer(0.1, send)


def test_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    found = findings(seconds=0.2)
    assert [one.check for one in found] == ['discovery']
    assert 'no other node was found within 0.2 s' in found[0].what


def test_a_healthy_robot_has_no_errors(other: NodeRuntime) -> None:
    other.call(lambda: publish_transform(other))
    pose = other.call(lambda: other.node.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', 10))
    for type, name in ((ComputePathToPose, 'compute_path_to_pose'), (FollowPath, 'follow_path')):
        ScriptedActionServer(other, type, name)
    found = findings()
    assert [one for one in found if one.level is Level.ERROR] == []
    assert of(found, 'transforms', Level.OK) == ['base_link is known in map']
    assert of(found, 'pose', Level.OK) == ['the pose of the robot comes from the transforms, /amcl_pose']
    assert of(found, 'servers', Level.OK) == ['2 actions of Nav2']
    assert pose is not None


def test_time_that_stands_still_and_clocks_that_are_mixed(other: NodeRuntime) -> None:
    with NodeRuntime.open('planner', parameters={'use_sim_time': True}):
        (told,) = of(findings(), 'clock')
        assert told == 'use_sim_time is true for /planner, and nobody publishes /clock: their time stands still'
        with NodeRuntime.open('clock') as clock:
            publisher = clock.call(lambda: clock.node.create_publisher(Clock, '/clock', 10))
            clock.call(lambda: clock.node.create_timer(0.05, lambda: publisher.publish(Clock())))
            (told,) = of(findings(), 'clock')
            assert told == 'use_sim_time is true for /planner and false for /localization: stamps do not fit each other'


def test_a_node_without_simulated_time_is_not_called_hanging(other: NodeRuntime) -> None:
    """The nodes of micro-ROS answer requests for parameters, and have no use_sim_time."""

    class Bare(LargeQueueNode):
        def __init__(self, name: str, **options: Any) -> None:
            super().__init__(name, start_parameter_services=False, **options)

    def answer(request: GetParameters.Request, response: GetParameters.Response) -> GetParameters.Response:
        response.values = [ParameterValue() for _ in request.names]
        return response

    with NodeRuntime.open('base', node_class=Bare) as base:
        base.call(lambda: base.node.create_service(GetParameters, '~/get_parameters', answer))
        found = findings()
    assert of(found, 'nodes') == []
    assert of(found, 'clock', Level.OK) == ["all nodes use the computers' clocks"]


def test_transforms_that_are_missing_or_old(other: NodeRuntime) -> None:
    found = findings(seconds=1.0)
    assert of(found, 'transforms', Level.WARNING) == ['nobody publishes /tf', 'nobody publishes /tf_static']
    assert 'no pose of base_link in map: ' in of(found, 'transforms')[0]
    other.call(lambda: publish_transform(other, age=60.0))
    (told,) = of(findings(), 'transforms')
    assert told.startswith('the newest transform from map to base_link is 6')


def test_topics_and_frames_are_those_of_the_executive(other: NodeRuntime) -> None:
    settings = {
        'global_frame': 'world',
        'robot_base_frame': 'base',
        'pose_topic': 'slam/pose',
        'cmd_vel_topic': 'wheels',
    }
    other.call(lambda: publish_transform(other, world='world', robot='base'))
    kept = [
        other.call(lambda: other.node.create_publisher(PoseWithCovarianceStamped, 'slam/pose', 10)),
        other.call(lambda: other.node.create_subscription(TwistStamped, 'wheels', print, 10)),
    ]
    found = findings(seconds=1.0)
    assert 'no pose of base_link in map: ' in of(found, 'transforms')[0]
    assert of(found, 'velocity', Level.WARNING) == ['nobody listens to /cmd_vel: a STOP cannot command zero velocity']
    assert 'there is no transform, and nobody publishes /pose, /amcl_pose, /odom' in of(found, 'pose', Level.WARNING)[0]
    with NodeRuntime.open('onboard_executive') as executive:
        for name, value in settings.items():
            executive.call(partial(executive.node.declare_parameter, name, value))
        for sent, level in ((Twist, Level.ERROR), (TwistStamped, Level.OK)):
            publisher: Any = executive.call(partial(executive.node.create_publisher, sent, 'wheels', 1))
            found = findings()
            assert of(found, 'transforms', Level.OK) == ['base is known in world']
            assert of(found, 'pose', Level.OK) == ['the pose of the robot comes from the transforms, /slam/pose']
            (told,) = [one for one in found if one.check == 'velocity']
            assert told.level is level, told
            assert level is Level.OK or told.remedy.startswith('set enable_stamped_cmd_vel to true for /onboard_exec')
            executive.call(partial(executive.node.destroy_publisher, publisher))
    assert all(kept)


def test_the_black_box_is_no_base_and_gives_no_topic_its_type(other: NodeRuntime) -> None:
    """It hears velocity commands as Twist, whatever the base takes, and poses as PoseStamped, whatever is sent."""
    with NodeRuntime.open('black_box') as box, NodeRuntime.open('onboard_executive') as executive:
        kept = [
            box.call(lambda: box.node.create_subscription(Twist, 'cmd_vel', print, 10)),
            executive.call(lambda: executive.node.create_publisher(Twist, 'cmd_vel', 1)),
            box.call(lambda: box.node.create_subscription(PoseStamped, 'pose', print, 10)),
            other.call(lambda: other.node.create_publisher(String, 'pose', 1)),
        ]
        assert 'nobody listens to /cmd_vel' in of(findings(seconds=1.0), 'velocity', Level.WARNING)[0]
        kept.append(other.call(lambda: other.node.create_subscription(TwistStamped, 'cmd_vel', print, 10)))
        found = findings(seconds=1.0)
        assert of(found, 'pose')[0].startswith('/pose has the type std_msgs/msg/String, expected ')
        (told,) = of(found, 'velocity')
        assert told.startswith('/localization takes geometry_msgs/msg/TwistStamped on /cmd_vel'), told
    assert all(kept)


@pytest.mark.dds('another process takes part')
def test_a_robot_in_a_namespace(other: NodeRuntime) -> None:
    other.call(lambda: publish_transform(other))  # of another robot, at the root
    with NodeRuntime.open('localization', namespace='/robot1') as robot:
        for typed in ('robot1', '/robot1/'):
            found = doctor_of('--namespace', typed, '--seconds', '1')
            assert found['transforms'] == 'error', found  # not those of the other robot
        robot.call(lambda: publish_transform(robot))
        assert doctor_of('--namespace', 'robot1', '--seconds', '5')['transforms'] == 'ok'
    ran = subprocess.run(['flexbt', 'doctor', '--namespace', 'robot 1'], capture_output=True, text=True, check=False)
    assert ran.returncode == 2
    assert "'robot 1' is not a namespace of ROS" in ran.stderr


def doctor_of(*words: str) -> dict[str, str]:
    """Return the level of the last finding of each check."""
    ran = subprocess.run(
        ['flexbt', 'doctor', '--json', *words], capture_output=True, text=True, check=False, timeout=60
    )
    found = [json.loads(line) for line in ran.stdout.splitlines()]
    return {one['rule']: one['severity'] for one in found}


def test_servers_of_another_type_or_missing(other: NodeRuntime) -> None:
    ScriptedActionServer(other, Wait, 'spin')
    ScriptedActionServer(other, FollowPath, 'robot1/follow_path')
    found = findings()
    assert of(found, 'servers') == ['/spin has the type nav2_msgs/action/Wait, expected nav2_msgs/action/Spin']
    with NodeRuntime.open('bt_server') as server:
        leaf = server.call(lambda: ActionClient(server.node, Spin, 'spin'))
        both = 'nav2_msgs/action/Spin, nav2_msgs/action/Wait'
        assert of(findings(), 'servers') == [f'/spin has the type {both}, expected nav2_msgs/action/Spin']
        assert leaf
    missing = of(found, 'servers', Level.WARNING)
    assert 'there is no action /follow_path: trees that drive fail; there is /robot1/follow_path' in missing


def test_what_is_only_called_is_not_served(other: NodeRuntime) -> None:
    kept = other.call(lambda: (ActionClient(other.node, Spin, 'spin'), other.node.create_client(Trigger, 'reset')))
    ScriptedActionServer(other, FollowPath, 'follow_path')
    with NodeRuntime.open('doctor') as runtime:
        graph = observe(runtime, 3.0)
    assert list(graph.actions) == ['/follow_path']
    assert '/localization/get_parameters' in graph.services
    assert '/reset' not in graph.services
    assert kept


def test_topics_that_do_not_fit(other: NodeRuntime) -> None:
    with NodeRuntime.open('listener') as listener:
        best_effort = rclpy.qos.QoSProfile(depth=1, reliability=rclpy.qos.ReliabilityPolicy.BEST_EFFORT)
        kept = [
            other.call(lambda: other.node.create_publisher(String, 'scan', best_effort)),
            listener.call(lambda: listener.node.create_subscription(String, 'scan', print, 1)),
            other.call(lambda: other.node.create_publisher(String, 'mixed', 1)),
            listener.call(lambda: listener.node.create_publisher(Int32, 'mixed', 1)),
        ]
        told = of(findings(), 'topics')
        assert any(one == '/listener hears nothing of /localization on /scan' for one in told), told
        assert any(one.startswith('/mixed has several types: std_msgs/msg/') for one in told), told
        assert all(kept)


def test_two_nodes_of_one_name_and_a_wrong_namespace(other: NodeRuntime) -> None:
    with NodeRuntime.open('localization'), NodeRuntime.open('console'), NodeRuntime.open('console'):  # two operators
        assert of(findings(), 'discovery') == ['several nodes are called /localization']
    assert 'no node is in the namespace /robot7' in of(findings('/robot7', 1.0), 'discovery')[0]


def test_the_offset_of_the_robots_clock() -> None:
    behind = [3.0]
    with NodeRuntime.open('onboard_executive') as executive:
        assert of(findings(seconds=1.0), 'link') == ['no status of /onboard_executive within 1 s']
        qos = names.transient_local_qos()
        publisher = executive.call(
            lambda: executive.node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, qos)
        )

        def send() -> None:
            status, moment = ExecutiveStatus(), time.time() - behind[0]
            status.stamp.sec, status.stamp.nanosec = int(moment), int(moment % 1 * 1e9)
            publisher.publish(status)

        executive.call(lambda: executive.node.create_timer(0.05, send))
        (told,) = of(findings(), 'link', Level.WARNING)
        assert told.startswith("the robot's clock differs by -3."), told
        behind[0] = 0.0
        assert len(of(findings(), 'link', Level.OK)) == 1


def test_the_receive_buffer_of_the_network(tmp_path: Path) -> None:
    limit = tmp_path / 'rmem_max'
    for size, level in ((212_992, Level.WARNING), (doctor.BUFFER, Level.OK)):  # the first is Linux's default
        limit.write_text(f'{size}\n')
        (told,) = doctor._buffers(limit, tmp_path / 'no shared memory')
        assert told.level is level


def test_this_computer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {'ROS_DOMAIN_ID': '300', 'ROS_LOCALHOST_ONLY': '1', 'ROS_LOG_DIR': str(tmp_path)}
    found = list(machine_findings(wrong))
    assert of(found, 'domain') == ['ROS_DOMAIN_ID=300']
    levels = {'0': 'OK', '101': 'OK', '102': 'WARNING', '214': 'WARNING', '215': 'OK', '233': 'ERROR'}
    for domain, level in levels.items():
        found_here = machine_findings({'ROS_DOMAIN_ID': domain})
        assert [one.level.name for one in found_here if one.check == 'domain'] == [level], domain
    assert 'nodes of other computers are not found' in of(found, 'reach', Level.WARNING)[0]
    for value in ('LOCALHOST', 'subnet'):  # as rcl, which takes what it does not know for LOCALHOST
        (told,) = of(list(machine_findings({'ROS_AUTOMATIC_DISCOVERY_RANGE': value})), 'reach', Level.WARNING)
        assert value in told
    assert of(list(machine_findings({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'})), 'reach', Level.WARNING) == []
    monkeypatch.setattr(doctor, 'LITTLE_DISK', 1 << 62)
    assert 'MB left' in of(list(machine_findings({})), 'disk', Level.WARNING)[0]


def test_a_directory_of_the_user_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'file').touch()
    logs = {'ROS_LOG_DIR': str(tmp_path / 'file' / 'log')}
    (told,) = [one for one in machine_findings(logs) if one.check == 'disk' and one.level is Level.ERROR]
    assert told.what == f'{tmp_path}/file (logs of ROS) is not a directory'
    assert told.remedy == 'set ROS_LOG_DIR to a directory that this user may write'
    monkeypatch.setenv('HOME', str(tmp_path))
    for variable, directory in (('ROS_LOG_DIR', '~/log'), ('ROS_HOME', '~')):  # which rcl takes for the home, too
        kept = of(list(machine_findings({variable: directory})), 'disk', Level.OK)
        assert kept[1].startswith(f'{tmp_path}/log (logs of ROS)')

    def no_account(number: int) -> NoReturn:
        raise KeyError(number)  # as for the number of a user that /etc/passwd does not have

    monkeypatch.delenv('HOME')
    monkeypatch.setattr(pwd, 'getpwuid', no_account)
    kept = of(list(machine_findings({})), 'disk', Level.OK)
    assert [one.partition(' ')[0] for one in kept] == [
        f'{tempfile.gettempdir()}/.ros/{one}' for one in ('flexbt', 'log')
    ]


def test_the_router_of_zenoh() -> None:
    with socket.create_server(('127.0.0.1', 0)) as router:
        address = router.getsockname()
        assert [one.level for one in router_findings({}, address)] == [Level.OK]
    (missing,) = router_findings({}, address)
    assert missing.level is Level.ERROR and 'rmw_zenohd' in missing.remedy
    (elsewhere,) = router_findings({'ZENOH_CONFIG_OVERRIDE': 'connect/endpoints=["tcp/10.0.0.1:7447"]'}, address)
    assert elsewhere.level is Level.OK and 'not checked' in elsewhere.what


def test_the_command_prints_json_and_ends_with_a_code() -> None:
    ran = subprocess.run(
        ['flexbt', 'doctor', '--json', '--seconds', '0.3'], capture_output=True, text=True, check=False, timeout=60
    )
    lines = [json.loads(line) for line in ran.stdout.splitlines()]
    assert {line['rule'] for line in lines} >= {'middleware', 'disk', 'discovery'}, ran.stderr
    assert (ran.returncode, lines[-1]['severity']) == (1, 'error')
    for domain in ('abc', '300'):  # the middleware refuses both
        ran = subprocess.run(
            ['flexbt', 'doctor', '--json'],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            env=os.environ | {'ROS_DOMAIN_ID': domain},
        )
        assert (ran.returncode, ran.stderr) == (1, '')
        assert f'ROS_DOMAIN_ID={domain}' in ran.stdout
    machine = subprocess.run(['flexbt', 'doctor', '--machine'], capture_output=True, text=True, check=False, timeout=60)
    assert machine.returncode == 0, machine.stdout


# -- manifests -------------------------------------------------------------------------------------------------------


def test_the_servers_of_a_robot_become_a_manifest_that_can_be_read(other: NodeRuntime) -> None:
    with contextlib.ExitStack() as stack:
        ScriptedActionServer(other, Spin, 'arm/turn_around')
        ScriptedActionServer(other, Wait, 'wait')
        runtime = stack.enter_context(NodeRuntime.open('flexbt_manifest'))
        text = manifest_text(proposed_nodes(observe(runtime, 3.0), ''))
    nodes = read_manifest(text, 'proposed.yaml')
    assert set(nodes) == {'ArmTurnAround', 'CallWait'}
    ports = nodes['ArmTurnAround'].ports
    assert {'target_yaw', 'time_allowance', 'error_code', 'result_error_msg', 'server_name'} <= set(ports)
    assert ports['server_name'].default == 'arm/turn_around'


def test_a_manifest_of_no_server_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['--seconds', '0.3', '--namespace', '/nobody', '--file', str(tmp_path / 'nodes.yaml')]
    assert cli.main(['manifest', '--from-graph', *words]) == 1
    assert 'no server was found in the namespace /nobody' in capsys.readouterr().err
    assert not (tmp_path / 'nodes.yaml').exists()


def test_fields_that_no_port_can_be_called_after_have_other_ports() -> None:
    services: dict[str, tuple[str, ...]] = {'/spawn_entity': ('simulation_interfaces/srv/SpawnEntity',)}
    node = read_manifest(manifest_text(proposed_nodes(Graph((), {}, services, {}), '')), 'proposed.yaml')['SpawnEntity']
    assert {'request_name', 'uri', 'entity_name'} <= set(node.ports)


def test_no_name_of_the_graph_reaches_the_terminal_as_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, '_findings', lambda _options: [doctor.error('a\x1b[2J', 'b\x1b[2J')])
    assert cli.main(['doctor']) == 1
    assert '\x1b' not in capsys.readouterr().out


def test_a_check_whose_output_nobody_reads_ends_quietly() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, 'wb') as output:
        done = subprocess.run(['flexbt', 'doctor', '--machine'], stdout=output, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (0, b'')
