# SPDX-License-Identifier: BSD-3-Clause
"""Numbers that are none, or beyond anything, in each field of what simulator and navigation receive.

The fields come from the definitions of the interfaces. A request ends, soon, with a reason if it is refused; no
callback raises, nothing hangs, and the robot can be driven afterwards.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Twist
from nav2_msgs.srv import IsPathValid
from nav_msgs.msg import OccupancyGrid
from rosidl_parser.definition import AbstractSequence, BasicType, NamespacedType

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_sim.messages import grid_message
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import load_map
from flexbt_testing.nodes.clients import ACTIONS, SentGoal
from flexbt_testing.nodes.sim_world import DOCK, OFFICE, RobotProbe, line, open_sim_world, pose
from flexbt_testing.waiting import DEADLINE, wait_until

HOSTILE = (math.nan, math.inf, -math.inf, 1e308, -1e19, 1e9, 5e-324)

GOALS: dict[str, dict[str, Any]] = {
    names.COMPUTE_PATH_TO_POSE: {'goal': pose(OFFICE), 'start': pose(DOCK), 'use_start': True},
    names.COMPUTE_PATH_THROUGH_POSES: {'goals': [pose(OFFICE)]},
    names.FOLLOW_PATH: {'path': line(DOCK, (1.2, 4.45), spacing=0.4)},
    names.SPIN: {'target_yaw': 0.1},
    names.BACKUP: {'target': Point(x=0.05), 'speed': 0.1},
    names.DRIVE_ON_HEADING: {'target': Point(x=0.05), 'speed': 0.1},
}


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world() as opened:
        yield opened


def reals(message: Any) -> Iterator[tuple[str, Any, str]]:
    """Yield each field of a message that holds a real number: path, the message it is in, and its name there."""
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        value = getattr(message, name)
        if isinstance(slot, BasicType) and slot.typename in ('float', 'double'):
            yield name, message, name
        elif isinstance(slot, NamespacedType):
            yield from ((f'{name}.{path}', inner, field) for path, inner, field in reals(value))
        elif isinstance(slot, AbstractSequence) and isinstance(slot.value_type, NamespacedType) and value:
            yield from ((f'{name}[-1].{path}', inner, field) for path, inner, field in reals(value[-1]))


def hostile(message: Any) -> Iterator[tuple[str, Any]]:
    """Copy of a message with a hostile number in one field each."""
    for index, (path, _, _) in enumerate(reals(message)):
        for number in HOSTILE:
            changed = copy.deepcopy(message)
            _, inner, field = list(reals(changed))[index]
            is_single = inner.get_fields_and_field_types()[field] == 'float'
            setattr(inner, field, 3e38 if is_single and number == 1e308 else number)
            yield f'{path} {number}', changed


def goes_on(world: RobotProbe) -> None:
    world.place(DOCK)
    goal = SentGoal(world.links.link(ACTIONS[names.SPIN], names.SPIN), ACTIONS[names.SPIN].Goal(target_yaw=0.3), 60.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED, goal.wait()


@pytest.mark.parametrize('action', GOALS)
def test_goals(world: RobotProbe, action: str) -> None:
    world.place(DOCK)
    for what, goal in hostile(ACTIONS[action].Goal(**copy.deepcopy(GOALS[action]))):
        sent = SentGoal(world.links.link(ACTIONS[action], action), goal, DEADLINE)
        assert sent.accepted.wait(DEADLINE)
        until = world.now.time + 1.0
        wait_until(lambda: sent.ended or world.now.time > until, f'{action} {what}')  # noqa: B023
        sent.cancel()
        outcome = sent.wait()
        assert outcome.status in (GoalStatus.ABORTED, GoalStatus.SUCCEEDED, GoalStatus.CANCELED), (what, outcome)
        assert outcome.result is not None, (what, outcome)
        text = outcome.result.error_msg
        assert 'fault' not in text, (what, text)
        assert text or outcome.status is not GoalStatus.ABORTED, what
    goes_on(world)


def test_paths_to_check(world: RobotProbe) -> None:
    for _, request in hostile(IsPathValid.Request(path=line(DOCK, (1.2, 4.45), spacing=0.4))):
        world.ask(IsPathValid, names.IS_PATH_VALID, request)
    goes_on(world)


@pytest.mark.parametrize(
    ('topic', 'message'),
    [
        (names.CMD_VEL, Twist()),
        (names.INITIAL_POSE, PoseWithCovarianceStamped()),
        (names.POSE, pose(DOCK)),
        (names.MAP, OccupancyGrid(data=[0] * 9)),
    ],
)
def test_messages(world: RobotProbe, topic: str, message: Any) -> None:
    real_map = grid_message(load_map(built_in_map()), 'map', Time())
    if topic == names.MAP:
        message.info.width = message.info.height = 3
        message.info.resolution = 0.05
        message.header.frame_id = 'map'
    node = world.runtime.node
    publisher = world.runtime.call(partial(node.create_publisher, type(message), topic, names.transient_local_qos()))
    wait_until(publisher.get_subscription_count, topic)
    for _, changed in hostile(message):
        publisher.publish(changed)
        world.plan(OFFICE).wait()
    if topic == names.MAP:
        publisher.publish(real_map)
        wait_until(lambda: world.plan(OFFICE).wait().status is GoalStatus.SUCCEEDED, 'a plan on the real map')
    world.runtime.call(partial(node.destroy_publisher, publisher))
    goes_on(world)
