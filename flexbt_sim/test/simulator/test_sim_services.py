# SPDX-License-Identifier: BSD-3-Clause
"""A world file on ROS: two robots in namespaces, and the standard services of simulators, on one launched world."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, Vector3
from nav2_msgs.srv import LoadMap
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.srv import GetMap
from rcl_interfaces.msg import Log
from rclpy.qos import qos_profile_sensor_data as LOSSY
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, LaserScan
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    EntityFilters,
    EntityState,
    Result,
    SimulationState,
    TagsFilter,
)
from simulation_interfaces.srv import (
    DeleteEntity,
    GetEntities,
    GetEntitiesStates,
    GetEntityInfo,
    GetEntityState,
    GetNamedPoses,
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetEntityState,
    SetSimulationState,
    SpawnEntity,
    StepSimulation,
)
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import seconds_of
from flexbt_msgs.srv import SetFault
from flexbt_sim.messages import pose_of
from flexbt_sim.simulator import core
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import MODELS, FaultModel, Pose, World, WorldFile
from flexbt_testing.nodes.clients import LifecycleClient, SentGoal
from flexbt_testing.nodes.sim_world import RobotProbe, pose, without_faults
from flexbt_testing.waiting import DEADLINE, wait_until

WORLD = """
plan:
  rooms: [{from: [0, 0], to: [10, 6]}]
seed: 3
robots:
  alpha: {model: burger, pose: [1, 1, 0], bumper: true}
  beta: {model: waffle, pose: [1, 4, 0], odometry: {linear_noise: 0.02}}
obstacles:
  crate: {pose: [8, 5, 0], shape: [0.4, 0.4]}
stations:
  dock: {pose: [1, 1, 0]}
doors:
  gate: {from: [6, 0.1], to: [6, 1.1], opening_time: 0.2}
places:
  exit: [9, 1, 1.57]
"""


class Bench:
    """The simulator, and somebody who asks and listens."""

    def __init__(self, simulator: Simulator, runtime: NodeRuntime) -> None:
        self.simulator = simulator
        self.runtime = runtime
        self._probe = RobotProbe(runtime)

    def ask(self, service_type: Any, service: str, **fields: Any) -> Any:
        """Ask a service of the simulator; the response."""
        return self.ask_other(service_type, f'simulator/{service}', **fields)

    def ask_other(self, service_type: Any, service: str, **fields: Any) -> Any:
        """Ask any service."""
        return self._probe.ask(service_type, service, service_type.Request(**fields))

    def listen(self, message_type: Any, topic: str, qos: Any = LOSSY) -> list[Any]:
        """Return the messages of a topic, as they come."""
        heard: list[Any] = []
        node = self.runtime.node
        self.runtime.call(lambda: node.create_subscription(message_type, topic, heard.append, qos))
        return heard

    def publisher(self, message_type: Any, topic: str) -> Callable[[Any], None]:
        node = self.runtime.node
        made = self.runtime.call(lambda: node.create_publisher(message_type, topic, 1))
        wait_until(made.get_subscription_count)
        return lambda message: made.publish(message)

    def pose(self, name: str) -> tuple[float, ...]:
        """Return where an entity is: m, m, rad."""
        response = self.ask(GetEntityState, 'get_entity_state', entity=name)
        assert response.result.result == Result.RESULT_OK, response.result.error_message
        return tuple(pose_of(response.state.pose))

    def set_state(self, state: int) -> int:
        response = self.ask(SetSimulationState, 'set_simulation_state', state=SimulationState(state=state))
        return int(response.result.result)

    def state(self) -> int:
        return int(self.ask(GetSimulationState, 'get_simulation_state').state.state)

    def spawn(self, text: str, **fields: Any) -> Any:
        return self.ask(SpawnEntity, 'spawn_entity', resource_string=text, **fields)


@pytest.fixture(scope='module')
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    file = tmp_path_factory.mktemp('world') / 'hall.yaml'
    file.write_text(WORLD)
    parameters = {'world': str(file), 'speed_factor': 5.0}
    with (
        without_faults(names.SIMULATOR, parameters=parameters) as simulator,
        without_faults('somebody') as runtime,
    ):
        yield Bench(Simulator(simulator), runtime)


@pytest.fixture(autouse=True)
def at_start(bench: Bench) -> Iterator[None]:
    yield
    bench.set_state(SimulationState.STATE_PLAYING)
    assert bench.ask(ResetSimulation, 'reset_simulation').result.result == Result.RESULT_OK


def test_each_robot_has_its_topics_in_its_namespace(bench: Bench) -> None:
    topics: list[tuple[Any, str, Any]] = [
        (PoseStamped, names.POSE, LOSSY),
        (Odometry, names.ODOM, LOSSY),
        (LaserScan, names.SCAN, LOSSY),
        (TFMessage, names.TF, LOSSY),
        (TFMessage, names.TF_STATIC, names.transient_local_qos()),
        (OccupancyGrid, names.MAP, names.transient_local_qos()),
        (PoseWithCovarianceStamped, names.AMCL_POSE, names.transient_local_qos()),
        (String, names.ROBOT_DESCRIPTION, names.transient_local_qos()),
        (BatteryState, names.BATTERY_STATE, LOSSY),
        (BatteryState, names.BATTERY_STATUS, LOSSY),
    ]
    heard = {
        (robot, topic): bench.listen(message_type, f'/{robot}/{topic}', qos)
        for robot in ('alpha', 'beta')
        for message_type, topic, qos in topics
    }
    bumper = bench.listen(Bool, f'/alpha/{names.BUMPER}', names.transient_local_qos())
    wait_until(lambda: all(heard.values()) and bumper, lambda: [key for key, value in heard.items() if not value])
    assert pose_of(heard['beta', names.POSE][0].pose).distance(pose_of(pose((1.0, 4.0)).pose)) < 1e-6
    assert pose_of(heard['beta', names.ODOM][0].pose.pose).distance(pose_of(pose((0.0, 0.0)).pose)) < 1e-6
    assert heard['beta', names.BATTERY_STATUS][-1].current < 0.0
    assert '<robot name="alpha">' in heard['alpha', names.ROBOT_DESCRIPTION][0].data
    assert not bumper[0].data
    for robot in ('alpha', 'beta'):
        watch = LivelinessWatch(bench.runtime, f'/{robot}/simulator')
        wait_until(lambda: watch.ready)  # noqa: B023
        watch.close()


def test_a_robot_is_driven_alone_and_a_wall_is_felt(bench: Bench) -> None:
    drive = bench.publisher(Twist, '/alpha/cmd_vel')
    bumper = bench.listen(Bool, f'/alpha/{names.BUMPER}', names.transient_local_qos())

    def has_hit() -> bool:
        drive(Twist(linear=Vector3(x=-0.22)))
        return bool(bumper and bumper[-1].data)

    wait_until(has_hit)
    assert bench.pose('alpha')[0] < 0.5
    assert bench.pose('beta') == pytest.approx((1.0, 4.0, 0.0))


def test_entities_are_found_by_name_category_tag_and_place(bench: Bench) -> None:
    def found(**fields: Any) -> set[str]:
        response = bench.ask(GetEntities, 'get_entities', filters=EntityFilters(**fields))
        assert response.result.result == Result.RESULT_OK, response.result.error_message
        return set(response.entities)

    assert found() == {'alpha', 'beta', 'crate', 'dock', 'gate'}
    assert found(filter='.*a') == {'alpha', 'beta'}
    robots = EntityCategory(category=EntityCategory.CATEGORY_ROBOT)
    assert found(categories=[robots]) == {'alpha', 'beta'}
    assert found(tags=TagsFilter(tags=['obstacle', 'station'])) == {'crate', 'dock'}
    assert found(tags=TagsFilter(tags=['obstacle', 'station'], filter_mode=TagsFilter.FILTER_MODE_ALL)) == set()
    corner = Bounds(type=Bounds.TYPE_BOX, points=[Vector3(x=0.0, y=0.0), Vector3(x=2.0, y=2.0)])
    assert found(bounds=corner) == {'alpha', 'dock'}
    ball = Bounds(type=Bounds.TYPE_SPHERE, points=[Vector3(x=8.0, y=4.5), Vector3(x=0.4)])
    assert found(bounds=ball) == {'crate'}
    site = Bounds(type=Bounds.TYPE_BOX, points=[Vector3(x=-500.0, y=500.0), Vector3(x=5.0, y=-500.0)])
    assert found(bounds=site) == {'alpha', 'beta', 'dock'}
    hull = EntityFilters(bounds=Bounds(type=Bounds.TYPE_CONVEX_HULL))
    answer = bench.ask(GetEntities, 'get_entities', filters=hull)
    assert answer.result.result == Result.RESULT_FEATURE_UNSUPPORTED
    for pattern in ('(', 'a' * 2_000):
        answer = bench.ask(GetEntities, 'get_entities', filters=EntityFilters(filter=pattern))
        assert answer.result.result == Result.RESULT_OPERATION_FAILED
    states = bench.ask(GetEntitiesStates, 'get_entities_states', filters=EntityFilters(filter='crate'))
    assert states.entities == ['crate'] and states.states[0].pose.position.x == 8.0
    info = bench.ask(GetEntityInfo, 'get_entity_info', entity='crate').info
    assert info.tags == ['obstacle'] and info.category.category == EntityCategory.CATEGORY_STATIC_OBJECT
    assert bench.ask(GetEntityInfo, 'get_entity_info', entity='x').result.result == Result.RESULT_NOT_FOUND
    poses = bench.ask(GetNamedPoses, 'get_named_poses').poses
    assert [(one.name, one.pose.position.x) for one in poses] == [('exit', 9.0)]


def test_faults_do_not_begin_or_end_while_they_are_listed(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[bool] = []

    def active_faults(_world: World, _entity: str) -> dict[str, FaultModel]:
        held.append(bench.simulator.lock.locked())
        return {}

    with monkeypatch.context() as patched:
        patched.setattr(World, 'active_faults', active_faults)
        bench.simulator.pacer.pause()
        bench.ask(GetEntityInfo, 'get_entity_info', entity='alpha')
    bench.simulator.pacer.play()
    assert held and all(held)


def test_a_robot_comes_and_goes_with_its_topics(bench: Bench) -> None:
    answer = bench.spawn('robots: {gamma: {model: burger}}', initial_pose=pose((5.0, 3.0, 1.0), 'world'))
    assert (answer.result.result, answer.entity_name) == (Result.RESULT_OK, 'gamma'), answer.result.error_message
    heard = bench.listen(PoseStamped, '/gamma/pose')
    wait_until(lambda: heard)
    assert tuple(pose_of(heard[0].pose)) == pytest.approx((5.0, 3.0, 1.0))
    beside = bench.spawn(
        'robots: {gamma: {model: burger}}', allow_renaming=True, initial_pose=pose((1.0, 0.0), 'gamma')
    )
    assert beside.entity_name == 'gamma_1'
    assert bench.pose('gamma_1')[:2] == pytest.approx((5.0 + math.cos(1.0), 3.0 + math.sin(1.0)))
    watch = LivelinessWatch(bench.runtime, '/gamma/simulator')
    wait_until(lambda: watch.ready)
    assert bench.ask(DeleteEntity, 'delete_entity', entity='gamma').result.result == Result.RESULT_OK
    wait_until(lambda: not bench.runtime.node.get_publishers_info_by_topic('/gamma/pose'))
    wait_until(lambda: watch.alive is False)
    watch.close()
    assert bench.ask(DeleteEntity, 'delete_entity', entity='gamma').result.result == Result.RESULT_NOT_FOUND


def test_a_new_robot_casts_no_beams_while_that_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which takes seconds, on a thread of its own: the world would stand still as long."""
    compiled = threading.Event()
    monkeypatch.setattr(core, 'prepare_world', lambda: compiled.wait(DEADLINE))
    with without_faults(names.SIMULATOR, namespace='/early') as runtime:
        simulator = Simulator(runtime)
        simulator.pacer.pause()
        runtime.call(lambda: simulator.spawn('gamma', MODELS['burger'], Pose(2.0, 4.45, 0.0), ''))
        assert not simulator.world.robots['gamma'].devices['lidar'].is_read
        compiled.set()


def test_no_two_robots_are_in_one_namespace(bench: Bench) -> None:
    """Else each command would drive both."""
    placed = pose((5.0, 3.0))
    first = bench.spawn('robots: {gamma: {}}', entity_namespace='delta', initial_pose=placed)
    assert first.result.result == Result.RESULT_OK, first.result.error_message
    for namespace in ('', '/'):
        second = bench.spawn('robots: {delta: {}}', entity_namespace=namespace, initial_pose=pose((5.0, 5.0)))
        assert second.result.result == SpawnEntity.Response.NAMESPACE_INVALID
    thing = bench.spawn('obstacles: {delta: {pose: [5, 5, 0]}}')
    assert thing.result.result == Result.RESULT_OK, thing.result.error_message


@pytest.mark.parametrize(
    ('text', 'fields', 'code', 'says'),
    [
        ('', {}, SpawnEntity.Response.NO_RESOURCE, 'empty'),
        ('<sdf/>', {}, SpawnEntity.Response.UNSUPPORTED_FORMAT, 'XML'),
        ('', {'uri': '/etc/passwd'}, SpawnEntity.Response.UNSUPPORTED_FORMAT, 'YAML'),
        ('', {'uri': '/etc/x.yaml'}, SpawnEntity.Response.NO_RESOURCE, 'package://'),
        ('robots: {a: {model: bruger}}', {}, SpawnEntity.Response.RESOURCE_PARSE_ERROR, "did you mean 'burger'"),
        ('robots: [', {}, SpawnEntity.Response.RESOURCE_PARSE_ERROR, ':1:'),
        ('obstacles: {a: {pose: [1, 2, 0]}, b: {pose: [1, 3, 0]}}', {}, SpawnEntity.Response.RESOURCE_PARSE_ERROR, '2'),
        ('robots: {alpha: {}}', {}, SpawnEntity.Response.NAME_NOT_UNIQUE, 'alpha'),
        ('robots: {new: {}}', {'name': '1 /'}, SpawnEntity.Response.NAME_INVALID, 'letters'),
        ('robots: {new: {}}', {'entity_namespace': 'a b'}, SpawnEntity.Response.NAMESPACE_INVALID, 'namespace'),
        (
            'robots: {new: {}}',
            {'entity_namespace': 'a' * 230},
            SpawnEntity.Response.NAMESPACE_INVALID,
            '230 characters',
        ),
        ('robots: {new: {}}', {'entity_namespace': '/alpha'}, SpawnEntity.Response.NAMESPACE_INVALID, 'already'),
        ('robots: {new: {}}', {'initial_pose': pose((1.0, 1.0))}, SpawnEntity.Response.INVALID_POSE, 'alpha'),
        ('robots: {new: {}}', {'initial_pose': pose((2.0, 2.0), 'moon')}, SpawnEntity.Response.INVALID_POSE, 'moon'),
        ('robots: {new: {}}', {'initial_pose': pose((math.nan, 2.0))}, SpawnEntity.Response.INVALID_POSE, 'none'),
        ('x' * 200_000, {}, Result.RESULT_OPERATION_FAILED, 'characters'),
    ],
)
def test_what_cannot_be_spawned_is_refused_with_its_code(
    bench: Bench, text: str, fields: dict[str, Any], code: int, says: str
) -> None:
    answer = bench.spawn(text, **fields)
    assert (answer.result.result, answer.entity_name) == (code, ''), answer.result.error_message
    assert says in answer.result.error_message


def test_what_is_there_is_moved(bench: Bench) -> None:
    def move(entity: str, place: tuple[float, ...], **twist: float) -> int:
        request = SetEntityState.Request(entity=entity)
        request.state.pose = pose(place).pose
        request.state.twist.linear = Vector3(**twist)
        answer = bench.ask_other(SetEntityState, 'simulator/set_entity_state', entity=entity, state=request.state)
        return int(answer.result.result)

    places = {'beta': (6.0, 2.0, 0.5), 'crate': (3.0, 3.0, 0.0), 'dock': (6.0, 5.0, 0.5)}
    for entity, place in places.items():
        assert move(entity, place) == Result.RESULT_OK
        assert bench.pose(entity) == pytest.approx(place)
    assert move('beta', (-5.0, 2.0)) == SetEntityState.Response.INVALID_POSE
    assert move('beta', (math.inf, 2.0)) == SetEntityState.Response.INVALID_POSE
    assert move('beta', (5.0, 2.0), x=1.0) == Result.RESULT_OPERATION_FAILED
    assert move('nobody', (5.0, 2.0)) == Result.RESULT_NOT_FOUND


def test_what_is_seen_of_things_is_told_to_newcomers_and_while_time_stands_still(bench: Bench) -> None:
    bench.set_state(SimulationState.STATE_PAUSED)

    def move(x: float) -> None:
        request = SetEntityState.Request(entity='crate')
        request.state.pose = pose((x, 5.0)).pose
        answer = bench.ask(SetEntityState, 'set_entity_state', entity='crate', state=request.state)
        assert answer.result.result == Result.RESULT_OK

    def told(message: TFMessage) -> float:
        (crate,) = message.transforms
        return float(crate.transform.translation.x)

    move(7.0)
    heard = bench.listen(TFMessage, 'simulator/things', names.transient_local_qos())
    wait_until(lambda: heard)
    assert told(heard[0]) == 7.0  # and not where it was once
    move(6.0)
    wait_until(lambda: told(heard[-1]) == 6.0)


def test_time_is_paused_stepped_and_goes_on(bench: Bench) -> None:
    clock = bench.listen(Clock, '/clock', 10)
    playing, paused, stopped = (
        SimulationState.STATE_PLAYING,
        SimulationState.STATE_PAUSED,
        SimulationState.STATE_STOPPED,
    )
    assert bench.ask(StepSimulation, 'step_simulation', steps=1).result.result == Result.RESULT_OPERATION_FAILED
    assert bench.set_state(paused) == Result.RESULT_OK
    assert bench.set_state(paused) == SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    assert bench.state() == paused
    step = bench.simulator.world.step_size
    before = bench.simulator.world.time
    assert bench.ask(StepSimulation, 'step_simulation', steps=10).result.result == Result.RESULT_OK
    assert bench.simulator.world.time == pytest.approx(before + 10 * step)
    wait_until(lambda: clock and seconds_of(clock[-1].clock) == pytest.approx(before + 10 * step))
    for steps in (0, 2**63):
        answer = bench.ask(StepSimulation, 'step_simulation', steps=steps)
        assert answer.result.result == Result.RESULT_OPERATION_FAILED
    link = ActionLinks(bench.runtime).link(SimulateSteps, 'simulator/simulate_steps')
    goal = SentGoal(link, SimulateSteps.Goal(steps=5), 60.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert bench.simulator.world.time == pytest.approx(before + 15 * step)
    endless = SentGoal(link, SimulateSteps.Goal(steps=1_000_000), 60.0)
    wait_until(lambda: len(endless.feedback) > 5)
    told = endless.feedback[5]
    assert told.completed_steps + told.remaining_steps == 1_000_000
    endless.cancel()
    assert endless.wait().status is GoalStatus.CANCELED
    stopped_meanwhile = SentGoal(link, SimulateSteps.Goal(steps=1_000_000), 60.0)
    wait_until(lambda: stopped_meanwhile.feedback)
    assert bench.set_state(stopped) == Result.RESULT_OK
    assert stopped_meanwhile.wait().status is GoalStatus.ABORTED
    assert (bench.state(), bench.simulator.world.time) == (stopped, 0.0)
    assert bench.set_state(SimulationState.STATE_QUITTING) == Result.RESULT_FEATURE_UNSUPPORTED
    assert bench.set_state(77) == SetSimulationState.Response.INCORRECT_TRANSITION
    assert bench.set_state(playing) == Result.RESULT_OK
    seen = len(clock)
    wait_until(lambda: len(clock) > seen + 3)


def test_requests_at_the_same_simulated_times_give_the_same_bits_as_without_ros(bench: Bench) -> None:
    cart = 'obstacles: {cart: {pose: [5, 3, 0], random_walk: {speed: 0.8, period: 0.5}}}'
    robot = 'robots: {gamma: {model: burger, pose: [3, 3, 1], drive: {slip: 0.1}}}'
    assert bench.set_state(SimulationState.STATE_STOPPED) == Result.RESULT_OK
    world = bench.simulator.parameters.make_world()
    before = len(world.entities)

    def same_after(steps: int) -> None:
        assert bench.ask(StepSimulation, 'step_simulation', steps=steps).result.result == Result.RESULT_OK
        world.step(steps * world.step_size)
        assert repr(bench.simulator.world.snapshot()) == repr(world.snapshot())

    same_after(3)
    for text in (cart, robot):
        assert bench.spawn(text).result.result == Result.RESULT_OK
        ((_, name, model, at),) = WorldFile(Path('spawned'), text).entities
        world.add(name, model, at)
    assert len(world.entities) == before + 2
    same_after(40)
    state = EntityState(pose=pose((7.0, 2.0, 1.0)).pose)
    assert bench.ask(SetEntityState, 'set_entity_state', entity='beta', state=state).result.result == Result.RESULT_OK
    world.move('beta', pose_of(state.pose))
    drive = bench.publisher(Twist, '/gamma/cmd_vel')
    command = Twist(linear=Vector3(x=0.2), angular=Vector3(z=0.5))
    drive(command)
    wait_until(lambda: bench.simulator.world.robots['gamma'].is_driven(world.time))
    world.robots['gamma'].command(0.2, 0.5, world.time)
    same_after(10)
    fault = {'entity': 'gamma', 'fault': 'stuck_wheel', 'parameters': '{side: right}', 'after': 0.1, 'duration': 0.5}
    assert bench.ask(SetFault, 'set_fault', **fault).success
    world.set_fault('gamma', 'stuck_wheel', {'side': 'right'}, 0.1, 0.5)
    assert bench.ask_other(SetBool, 'simulator/doors/gate', data=True).success
    world.doors['gate'].command(True)
    same_after(7)
    bench.listen(LaserScan, '/gamma/scan')

    def is_heard() -> bool:
        same_after(1)
        return bench.simulator.world.robots['gamma'].devices['lidar'].is_read

    wait_until(is_heard)
    assert bench.ask(DeleteEntity, 'delete_entity', entity='crate').result.result == Result.RESULT_OK
    world.remove('crate')
    same_after(60)
    told, expected = (one.robots['gamma'].scan for one in (bench.simulator.world, world))
    assert told is not None
    assert expected is not None
    assert (told.time, told.ranges.tobytes()) == (expected.time, expected.ranges.tobytes())


def test_a_reset_takes_back_what_its_scope_says(bench: Bench) -> None:
    clock = bench.listen(Clock, '/clock', 10)

    def reset(scope: int) -> int:
        return int(bench.ask(ResetSimulation, 'reset_simulation', scope=scope).result.result)

    scopes = ResetSimulation.Request
    assert bench.spawn('obstacles: {box: {pose: [5, 5, 0]}}').result.result == Result.RESULT_OK
    request = SetEntityState.Request(entity='beta')
    request.state.pose = pose((6.0, 2.0)).pose
    bench.ask(SetEntityState, 'set_entity_state', entity='beta', state=request.state)
    wait_until(lambda: clock and seconds_of(clock[-1].clock) > 0.5)
    assert reset(scopes.SCOPE_TIME) == Result.RESULT_OK
    wait_until(lambda: seconds_of(clock[-1].clock) < 0.5)
    assert bench.pose('beta')[:2] == pytest.approx((6.0, 2.0))
    assert reset(scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED) == Result.RESULT_OK
    assert bench.pose('beta')[:2] == pytest.approx((1.0, 4.0))
    assert 'box' not in bench.ask(GetEntities, 'get_entities').entities
    assert bench.spawn('robots: {late: {pose: [5, 5, 0]}}').result.result == Result.RESULT_OK
    assert bench.ask(DeleteEntity, 'delete_entity', entity='alpha').result.result == Result.RESULT_OK
    assert reset(scopes.SCOPE_DEFAULT) == Result.RESULT_OK
    assert set(bench.ask(GetEntities, 'get_entities').entities) == {'alpha', 'beta', 'crate', 'dock', 'gate'}
    heard = bench.listen(PoseStamped, '/alpha/pose')
    wait_until(lambda: heard)
    assert reset(64) == Result.RESULT_FEATURE_UNSUPPORTED


def test_a_reset_brings_the_map_of_the_file_back(bench: Bench) -> None:
    maps = bench.listen(OccupancyGrid, '/beta/map', names.transient_local_qos())
    wait_until(lambda: maps)
    first, rooms = maps[-1], built_in_map()
    bench.ask_other(LoadMap, '/beta/map_server/load_map', map_url=f'file://{rooms}')
    wait_until(lambda: maps[-1] != first)
    assert bench.ask(ResetSimulation, 'reset_simulation').result.result == Result.RESULT_OK
    wait_until(lambda: maps[-1] == first)
    assert bench.ask_other(GetMap, '/beta/map_server/map').map == first


def test_a_reset_reads_the_file_again(bench: Bench) -> None:
    file = bench.simulator.parameters.source
    scans = bench.listen(LaserScan, '/alpha/scan')
    wait_until(lambda: scans and len(scans[-1].ranges) == 360)
    try:
        file.write_text(f'step: 0.05\n{WORLD.replace("bumper: true", "bumper: true, lidar: {beams: 90}")}')
        assert bench.ask(ResetSimulation, 'reset_simulation').result.result == Result.RESULT_OK
        wait_until(lambda: len(scans[-1].ranges) == 90)
        file.write_text('robots: [')
        answer = bench.ask(ResetSimulation, 'reset_simulation').result
        assert answer.result == Result.RESULT_OPERATION_FAILED and ':1:' in answer.error_message
        count = len(scans)
        wait_until(lambda: len(scans) > count)  # it goes on as it was
    finally:
        file.write_text(WORLD)


def test_features_are_told(bench: Bench) -> None:
    features = bench.ask(GetSimulatorFeatures, 'get_simulator_features').features
    assert len(features.features) == 21 and features.spawn_formats == ['yaml']


def test_faults_come_and_go(bench: Bench) -> None:
    def fault(**fields: Any) -> Any:
        return bench.ask(SetFault, 'set_fault', **fields)

    log = bench.listen(Log, '/rosout')
    heard = bench.listen(PoseStamped, '/alpha/pose')
    assert fault(entity='alpha', fault='localization_lost', parameters='jump: [1.0, 0.5, 0.0]').success
    wait_until(lambda: heard and pose_of(heard[-1].pose).distance(pose_of(pose((2.0, 1.5)).pose)) < 1e-6)
    assert bench.pose('alpha')[:2] == pytest.approx((1.0, 1.0))
    assert fault(entity='alpha', clear=True).success
    wait_until(lambda: pose_of(heard[-1].pose).distance(pose_of(pose((1.0, 1.0)).pose)) < 1e-6)
    for what in ('begins', 'is over'):
        text = f'alpha: localization_lost (jump: Pose((1.0, 0.5, 0.0)), drift: 0.0) {what}'
        wait_until(lambda: text in [one.msg for one in log], lambda: log)  # noqa: B023
    assert fault(entity='alpha', fault='messages_dropped', parameters='topic: pose').success
    dropped = bench.simulator.world.time
    other = bench.listen(PoseStamped, '/beta/pose')
    wait_until(lambda: other and seconds_of(other[-1].header.stamp) > dropped + 1.0)
    assert all(seconds_of(one.header.stamp) <= dropped for one in heard)
    assert fault(entity='alpha', fault='messages_late', parameters='{topic: pose, delay: 0.2}', clear=False).success
    assert fault(entity='alpha', fault='messages_dropped', clear=True).success
    count = len(heard)
    wait_until(lambda: len(heard) > count)
    for fields, says in (
        ({'fault': 'stuck_wheel'}, '2 robots'),
        ({'entity': 'gamma', 'fault': 'stuck_wheel'}, 'gamma'),
        ({'entity': 'alpha', 'fault': 'stuck_weel'}, 'stuck_wheel'),
        ({'entity': 'alpha', 'fault': 'stuck_wheel', 'parameters': 'side: up'}, 'up'),
        ({'entity': 'alpha', 'fault': 'stuck_wheel', 'parameters': '[1'}, 'line'),
        ({'entity': 'alpha', 'fault': 'stuck_wheel', 'after': math.nan}, 'nan'),
        ({'entity': 'alpha', 'fault': 'stuck_wheel', 'parameters': 'a' * 20_000}, 'characters'),
    ):
        answer = fault(**fields)
        assert not answer.success and says in answer.message, answer.message


def test_who_enters_a_no_go_zone_is_told_in_the_log(bench: Bench) -> None:
    log = bench.listen(Log, '/rosout')
    for name, kind in (('mud', 'slow'), ('lawn', 'no_go')):
        spawned = bench.spawn(f'zones: {{{name}: {{kind: {kind}, pose: [1, 4, 0], area: 0.2}}}}')
        assert spawned.result.result == Result.RESULT_OK
    wait_until(lambda: 'beta has entered a no-go zone: lawn' in [one.msg for one in log], lambda: log)


def test_late_commands_drive_late(bench: Bench) -> None:
    robot = bench.simulator.world.robots['alpha']
    drive = bench.publisher(Twist, '/alpha/cmd_vel')
    assert bench.set_state(SimulationState.STATE_PAUSED) == Result.RESULT_OK
    late = {'entity': 'alpha', 'fault': 'messages_late', 'parameters': '{topic: cmd_vel, delay: 1.0}'}
    assert bench.ask(SetFault, 'set_fault', **late).success
    began = bench.simulator.world.time
    while not robot.is_driven(bench.simulator.world.time):
        drive(Twist(linear=Vector3(x=0.2)))
        assert bench.ask(StepSimulation, 'step_simulation', steps=1).result.result == Result.RESULT_OK
    assert bench.simulator.world.time >= began + 1.0


class Emptied(deque[Any]):
    """A queue that the thread of the world empties just after it was found not to be empty."""

    def __bool__(self) -> bool:
        had_any = len(self) > 0
        self.clear()
        return had_any


def test_a_command_beside_the_last_late_one_is_driven(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    assert bench.set_state(SimulationState.STATE_PAUSED) == Result.RESULT_OK
    simulator = bench.simulator
    topics = simulator._robots['alpha']
    late = Emptied([(simulator.world.time, (names.CMD_VEL, lambda message: None, Twist()))])
    monkeypatch.setitem(topics._late, names.CMD_VEL, late)
    simulator.runtime.call(lambda: topics._on_command(Twist(linear=Vector3(x=0.2))))
    assert topics.robot.is_driven(simulator.world.time)


def test_a_door_is_opened_and_jams_and_a_spawned_one_has_a_service(bench: Bench) -> None:
    doors = bench.simulator.world.doors
    assert bench.ask(SetBool, 'doors/gate', data=True).success
    wait_until(lambda: doors['gate'].opening == 1.0)
    assert bench.ask(SetFault, 'set_fault', entity='gate', fault='door_jammed').success
    answer = bench.ask(SetBool, 'doors/gate', data=False)
    assert not answer.success and 'jammed' in answer.message
    assert bench.ask(SetFault, 'set_fault', entity='gate', clear=True).success
    assert bench.ask(SetBool, 'doors/gate', data=False).success
    wait_until(lambda: doors['gate'].opening == 0.0)
    assert bench.spawn('doors: {hatch: {from: [4, 0.1], to: [4, 1.1]}}').result.result == Result.RESULT_OK
    assert bench.ask(SetBool, 'doors/hatch', data=True).success
    assert bench.ask(DeleteEntity, 'delete_entity', entity='hatch').result.result == Result.RESULT_OK
    served = bench.runtime.node.get_service_names_and_types_by_node
    wait_until(lambda: not any('hatch' in name for name, _ in served('simulator', '/')))


def test_an_initial_pose_tells_the_localization_and_moves_nothing(bench: Bench) -> None:
    tell = bench.publisher(PoseWithCovarianceStamped, '/alpha/initialpose')
    told = bench.listen(PoseWithCovarianceStamped, '/alpha/amcl_pose', names.transient_local_qos())
    message = PoseWithCovarianceStamped()
    message.header.frame_id, message.pose.pose = 'map', pose((4.0, 3.0, 0.5)).pose
    tell(message)
    wait_until(lambda: told and tuple(pose_of(told[-1].pose.pose)) == pytest.approx((4.0, 3.0, 0.5)))
    assert bench.pose('alpha') == pytest.approx((1.0, 1.0, 0.0))
    message.pose.pose = pose((1.2, 0.9, 0.1)).pose
    tell(message)
    wait_until(lambda: tuple(pose_of(told[-1].pose.pose)) == pytest.approx((1.0, 1.0, 0.0)))


def test_localization_and_map_have_the_services_of_nav2(bench: Bench) -> None:
    amcl = LifecycleClient(bench.runtime, '/alpha/amcl')
    assert amcl.state() == 'active'
    assert amcl.change('deactivate')
    heard = bench.listen(PoseStamped, '/alpha/pose')
    other = bench.listen(PoseStamped, '/beta/pose')
    wait_until(lambda: len(other) > 5)
    assert len(heard) <= 1
    assert amcl.change('activate')
    wait_until(lambda: len(heard) > 2)
    assert LifecycleClient(bench.runtime, '/alpha/map_server').state() == 'active'
    assert bench.ask_other(GetMap, '/alpha/map_server/map').map.info.width > 10
    maps = bench.listen(OccupancyGrid, '/beta/map', names.transient_local_qos())
    wait_until(lambda: maps)
    rooms: Path = built_in_map()
    answer = bench.ask_other(LoadMap, '/beta/map_server/load_map', map_url=f'file://{rooms}')
    assert answer.result == LoadMap.Response.RESULT_SUCCESS
    wait_until(lambda: maps[-1].info.width == answer.map.info.width)
    world = bench.simulator.parameters.world
    assert world is not None
    broken = world.with_name('broken.yaml')
    broken.write_text(rooms.read_text().replace('rooms.png', 'broken.yaml'))
    for url, code in (
        ('/nowhere.yaml', LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST),
        ('/etc/hostname', LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST),  # nothing says that it is there
        (f'{rooms.parent}/../../../../../../../etc/hostname', LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST),
        ('x' * 1_000_000, LoadMap.Response.RESULT_UNDEFINED_FAILURE),
        (str(rooms.with_suffix('.png')), LoadMap.Response.RESULT_INVALID_MAP_METADATA),
        (str(world), LoadMap.Response.RESULT_INVALID_MAP_METADATA),
        (str(broken), LoadMap.Response.RESULT_INVALID_MAP_DATA),
    ):
        assert bench.ask_other(LoadMap, '/beta/map_server/load_map', map_url=url).result == code
