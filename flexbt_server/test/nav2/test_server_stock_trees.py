# SPDX-License-Identifier: BSD-3-Clause
"""All trees that come with Nav2, of both branches, as they are, in one server, against scripted servers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_core.behavior_tree.model.errors import Source
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.behavior_tree.xml.node_elements import elements_of
from flexbt_core.behavior_tree.xml.parser import parse
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_msgs.action import BtExecute
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.stock_trees import stock_trees
from flexbt_testing.nodes.server_world import ON_DEMAND, ServerWorld, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result

TREES: Final = {(branch, name): text for branch in NAV2_BRANCHES for name, text in stock_trees(branch).items()}
REGISTRIES: Final = {branch: node_registry(lambda _source, _error: None, branch) for branch in NAV2_BRANCHES}
NEVER_END: Final = 'follow_point.xml'
THROUGH_POSES: Final = 'navigate_through_poses_w_replanning_and_recovery.xml'

pytestmark = pytest.mark.skipif(not TREES, reason='there is no clone of ros-navigation/navigation2')


@pytest.fixture(scope='module')
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('stock')
    for (branch, name), text in TREES.items():
        (directory / branch).mkdir(exist_ok=True)
        (directory / branch / name).write_text(text)
    return directory


@pytest.fixture(scope='module')
def world(files: Path) -> Iterator[ServerWorld]:
    with open_server_world(allowed_directories=[str(files)]) as opened:
        opened.navigation.serve(ON_DEMAND)
        runtime = opened.navigation_runtime
        robot = runtime.call(
            lambda: runtime.node.create_publisher(PoseStamped, names.POSE, names.transient_local_qos())
        )
        robot.publish(pose_stamped(0))
        yield opened


def test_there_are_all_of_them() -> None:
    assert [sum(branch == of for of, _ in TREES) for branch in NAV2_BRANCHES] == [12, 15]


@pytest.mark.parametrize(('branch', 'name'), TREES)
def test_a_file_shows_its_branch(branch: Nav2Branch, name: str) -> None:
    assert REGISTRIES[branch].nav2_branch_of(elements_of(parse(Source(name, TREES[branch, name])))) == branch


@pytest.mark.parametrize(('branch', 'name'), TREES)
def test_it_runs_as_it_is(world: ServerWorld, files: Path, branch: Nav2Branch, name: str) -> None:
    number = 3 if name == THROUGH_POSES else 1
    goals = [pose_stamped(one + 1) for one in range(number)]
    goal = world.client.execute(str(files / branch / name), goals=goals, blackboard=f'{branch} {name}')
    if name == NEVER_END:
        follow = world.navigation.actions[names.FOLLOW_PATH]
        before = len(follow.goals)
        wait_until(lambda: len(follow.goals) > before + 2, 'the robot to be followed on and on')
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.CANCELED
    else:
        assert goal.result.code == Result.SUCCESS, goal.result.message


def test_every_node_of_one_branch_is_known_in_the_other_as_well() -> None:
    """Whatever the parameter says: a file is read by what it shows."""
    for registry, ((branch, name), text) in itertools.product(REGISTRIES.values(), TREES.items()):
        load_xml(text, f'{branch}/{name}', registry)
