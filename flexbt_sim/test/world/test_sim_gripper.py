# SPDX-License-Identifier: BSD-3-Clause
"""Grippers: what they pick up is nowhere in the way until it is put down, or taken from them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_sim.errors import SimulationError
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.world import Circle, GripperModel, ObstacleModel, Pose, RobotModel, World
from flexbt_testing.waiting import DEADLINE, wait_until

CUP = ObstacleModel(pose=Pose(1.0, 0.0, 0.0), shape=Circle(0.05))


@pytest.fixture
def world() -> World:
    world = World()
    world.add('arm', RobotModel(gripper=GripperModel(reach=0.6)), Pose(0.5, 0.0, 0.0))
    world.add('cup', CUP)
    return world


def test_what_is_picked_up_goes_along_and_is_put_down_ahead(world: World) -> None:
    world.add('box', ObstacleModel(pose=Pose(0.9, 0.2, 0.0), shape=Circle(0.11)))  # nearer, and too large
    assert world.grip('arm') == 'cup' == world.robots['arm'].devices['gripper'].state
    world.remove('box')
    world.robots['arm'].command(0.2, 0.0, world.time)
    world.step(0.4)
    assert world.state('cup').pose == world.robots['arm'].pose
    assert not world.robots['arm'].in_contact
    with pytest.raises(SimulationError, match='arm holds cup'):
        world.grip('arm')
    assert world.release('arm') == 'cup'
    x, y, _ = world.obstacles['cup'].pose
    assert (x, y) == pytest.approx((world.robots['arm'].pose.x + 0.6, 0.0))
    assert (world.robots['arm'].devices['gripper'].state, dict(world.held)) == ('', {})
    with pytest.raises(SimulationError, match='holds nothing'):
        world.release('arm')


def test_what_cannot_be_is_told(world: World) -> None:
    world.move('cup', Pose(2.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match=r'nothing that the gripper of arm can take is within its reach of 0.6 m'):
        world.grip('arm')
    world.add('other', RobotModel(), Pose(5.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match='other has no gripper'):
        world.grip('other')
    world.move('cup', CUP.pose)
    world.grip('arm')
    world.add('wall', ObstacleModel(pose=Pose(1.1, 0.0, 0.0), shape=Circle(0.2)))
    with pytest.raises(SimulationError, match="would overlap 'wall'"):
        world.release('arm')
    assert world.robots['arm'].devices['gripper'].state == 'cup'


def test_it_can_be_taken_from_the_gripper_and_goes_back_at_a_reset(world: World) -> None:
    world.grip('arm')
    world.move('cup', Pose(3.0, 0.0, 0.0))
    assert (world.robots['arm'].devices['gripper'].state, world.state('cup').pose.x) == ('', 3.0)
    world.move('cup', CUP.pose)
    world.grip('arm')
    world.reset()
    assert (world.robots['arm'].devices['gripper'].state, world.state('cup').pose) == ('', CUP.pose)
    world.grip('arm')
    world.remove('cup')
    assert (world.robots['arm'].devices['gripper'].state, dict(world.held)) == ('', {})
    world.add('cup', CUP)
    world.grip('arm')
    world.remove('arm')
    world.step()
    assert not world.held and 'cup' in world.obstacles


def test_what_a_robot_holds_is_moved_with_it_and_left_there_if_it_is_removed(world: World) -> None:
    world.grip('arm')
    world.move('arm', Pose(5.0, 5.0, 0.0))
    world.add('other', RobotModel(), CUP.pose)
    world.remove('arm')
    assert world.obstacles['cup'].pose == Pose(5.0, 5.0, 0.0)


class Observer:
    """A node that commands a gripper, and sees the scene."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.doors: dict[str, float] = {}
        self.things: dict[str, str] = {}
        self.holds: str | None = None
        self._runtime = runtime
        self._services = ServiceLinks(runtime)
        runtime.call(self._connect)

    def _connect(self) -> None:
        node = self._runtime.node
        node.create_subscription(JointState, 'simulator/doors', self._on_doors, names.transient_local_qos())
        node.create_subscription(TFMessage, 'simulator/things', self._on_things, names.transient_local_qos())
        node.create_subscription(String, 'arm/gripper_holds', self._on_holds, names.transient_local_qos())

    def _on_doors(self, message: JointState) -> None:
        self.doors = dict(zip(message.name, message.position, strict=True))

    def _on_things(self, message: TFMessage) -> None:
        self.things = {one.child_frame_id: one.header.frame_id for one in message.transforms}

    def _on_holds(self, message: String) -> None:
        self.holds = message.data

    def ask(self, service: str, data: bool) -> Any:
        outcome = service_outcome(self._services.link(SetBool, service), SetBool.Request(data=data), DEADLINE)
        assert outcome.ok, outcome.reason
        return outcome.response


@pytest.fixture
def observer(tmp_path: Any) -> Iterator[Observer]:
    file = tmp_path / 'scene.yaml'
    file.write_text(
        'models: {carrier: {based_on: waffle, gripper: {reach: 0.6}}}\n'
        'robots: {arm: {model: carrier, pose: [0.5, 0, 0]}}\n'
        'obstacles: {cup: {pose: [1, 0, 0], shape: 0.05}}\n'
        'doors: {gate: {from: [5, 0], to: [6, 0], opening_time: 0.1}}\n'
    )
    with (
        NodeRuntime.open('simulator', parameters={'world': str(file)}) as runtime,
        NodeRuntime.open('observer') as other,
    ):
        Simulator(runtime)
        yield Observer(other)


def test_the_simulator_tells_of_doors_things_and_grippers(observer: Observer) -> None:
    wait_until(
        lambda: (observer.doors, observer.things, observer.holds) == ({'gate': 0.0}, {'cup': 'map'}, ''), 'the scene'
    )
    answer = observer.ask('arm/gripper', True)
    assert (answer.success, answer.message) == (True, 'cup')
    wait_until(lambda: (observer.things, observer.holds) == ({'cup': 'arm'}, 'cup'), 'that it is held')
    answer = observer.ask('arm/gripper', True)
    assert (answer.success, answer.message) == (False, 'arm holds cup; open the gripper first')
    assert observer.ask('arm/gripper', False).success
    wait_until(lambda: (observer.things, observer.holds) == ({'cup': 'map'}, ''), 'that it was put down')
    assert observer.ask('simulator/doors/gate', True).success
    wait_until(lambda: observer.doors == {'gate': 1.0}, 'the open door')
