# SPDX-License-Identifier: BSD-3-Clause
"""The navigators of a live server with scripted navigation servers: what a client of Nav2 gets, and when."""

from __future__ import annotations

import contextlib
import gc
import math
import random
import threading
import uuid
import weakref
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs.action import FollowWaypoints, NavigateThroughPoses, NavigateToPose, SmoothPath
from nav2_msgs.msg import BehaviorTreeLog
from rclpy.action import CancelResponse
from rclpy.duration import Duration
from std_msgs.msg import Empty, String
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.errors import ResourceError, UnfitParameterError
from flexbt_common.files import resolve_file
from flexbt_common.transform_listener import TransformListener
from flexbt_common.values.entries import from_entry
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_msgs.msg import TreeStatus
from flexbt_server.errors import ServerParameterError
from flexbt_server.nav2 import motion_actions
from flexbt_server.nav2.branches import FAILED, pending
from flexbt_server.navigators import activation, bt_navigator
from flexbt_server.navigators.bt_navigator import NavigatorGoal
from flexbt_server.runs.run_events import RunOutcome
from flexbt_testing.behavior_trees.faulty_leaves import Held
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import LifecycleClient, SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, document, install_nodes, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

NAVIGATORS = [names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS]
GOAL_OUTSIDE_MAP = 204
NO_VIAPOINTS_GIVEN = 309


class Front:
    """A client of Nav2 before a server with navigators, and a robot that stands at the origin."""

    def __init__(self, world: ServerWorld) -> None:
        self.world = world
        self.navigation = world.navigation
        self.planner = world.navigation.actions[names.COMPUTE_PATH_TO_POSE]
        self.follow = world.navigation.actions[names.FOLLOW_PATH]
        runtime = world.client.runtime
        links = ActionLinks(runtime)
        self._to_pose = links.link(NavigateToPose, names.NAVIGATE_TO_POSE)
        self._through = links.link(NavigateThroughPoses, names.NAVIGATE_THROUGH_POSES)
        self._waypoints = links.link(FollowWaypoints, names.FOLLOW_WAYPOINTS)
        self._poses, self._goal_poses = runtime.call(
            lambda: [runtime.node.create_publisher(PoseStamped, topic, 1) for topic in (names.POSE, names.GOAL_POSE)]
        )

    def stand(self, x: float, seconds: float = 1.0) -> None:
        """Tell that the robot is at x, until the server knows."""
        here = pose_stamped(x)
        here.header.stamp.sec, here.header.stamp.nanosec = int(seconds), round(seconds % 1.0 * 1e9)
        wait_until(lambda: (self._poses.publish(here), self.world.server.goals.pose == here)[1], 'the pose')

    def to(self, x: float, y: float = 0.0, tree: str = '', frame: str = 'map') -> SentGoal:
        return self.send(NavigateToPose.Goal(pose=pose_stamped(x, y, frame), behavior_tree=tree))

    def send(self, goal: NavigateToPose.Goal) -> SentGoal:
        return SentGoal(self._to_pose, goal, DEADLINE)

    def through(self, *xs: float, tree: str = '') -> SentGoal:
        return SentGoal(
            self._through, NavigateThroughPoses.Goal(poses=[pose_stamped(x) for x in xs], behavior_tree=tree), DEADLINE
        )

    def waypoints(self, *xs: float, frame: str = 'map', **fields: Any) -> SentGoal:
        poses = [pose_stamped(x, frame=frame) for x in xs]
        return SentGoal(self._waypoints, FollowWaypoints.Goal(poses=poses, **fields), DEADLINE)

    def click(self, x: float) -> None:
        """As RViz's goal tool."""
        wait_until(self._goal_poses.get_subscription_count, 'goal_pose')
        self._goal_poses.publish(pose_stamped(x))

    def driven_to(self) -> list[float]:
        """Return where the paths end that the controller got."""
        return [goal.path.poses[-1].pose.position.x for goal in self.follow.goals]

    def planned_to(self) -> list[float]:
        return [goal.goal.pose.position.x for goal in self.planner.goals]

    def drives_to(self, x: float) -> None:
        """Wait until the controller drives on a path to x."""
        wait_until(lambda: self.follow.running and self.driven_to()[-1] == x, f'the path to {x}')

    def arrive(self) -> None:
        """Let the controller, and those that come after it, be at the end of the path."""
        self.navigation.hold.discard(names.FOLLOW_PATH)
        for number in self.follow.running:
            self.follow.end(number)


@contextlib.contextmanager
def open_front(**parameters: Any) -> Iterator[Front]:
    with open_server_world(navigators=NAVIGATORS, feedback_rate=50.0, **parameters) as world:
        world.server.activate()
        front = Front(world)
        front.stand(0.0)
        yield front


@pytest.fixture
def front() -> Iterator[Front]:
    with open_front() as opened:
        yield opened


@pytest.fixture
def driving(front: Front) -> Front:
    """Return a robot that drives until it is told to stop."""
    front.navigation.hold.add(names.FOLLOW_PATH)
    return front


def more_than(items: list[Any], count: int) -> bool:
    return len(items) > count


def ended(goal: SentGoal, status: GoalStatus = GoalStatus.SUCCEEDED, *fragments: str, code: int = 0) -> Any:
    """Return the result of a goal that has to end so."""
    outcome = goal.wait()
    assert outcome.status is status, outcome
    assert goal.result.error_code == code
    for fragment in fragments:
        assert fragment in goal.result.error_msg
    return goal.result


def test_a_planner_that_was_selected_before_the_first_goal_plans_for_it(front: Front) -> None:
    """As in Nav2, a server hears the topics of its default trees from the beginning."""
    runtime = front.world.client.runtime
    selected = runtime.call(
        lambda: runtime.node.create_publisher(String, 'planner_selector', names.transient_local_qos())
    )
    wait_until(selected.get_subscription_count, 'the server')
    selected.publish(String(data='Other'))
    assert selected.wait_for_all_acked(Duration(seconds=DEADLINE))
    ended(front.to(3.0))
    assert front.planner.goals[0].planner_id == 'Other'


def test_to_a_pose(front: Front) -> None:
    assert ended(front.to(3.0)).error_msg == ''
    assert (front.planned_to(), front.driven_to()) == ([3.0], [3.0])


def test_through_poses(front: Front) -> None:
    ended(front.through(3.0, 4.0))
    (goal,) = front.navigation.actions[names.COMPUTE_PATH_THROUGH_POSES].goals
    assert [place.pose.position.x for place in goal.goals] == [3.0, 4.0]


def test_poses_to_pass_have_statuses_that_begin_anew_with_each_goal(front: Front) -> None:
    """As in main: what was passed is completed, and cannot be passed once more."""
    leaf = (
        '<RemovePassedGoals radius="0.7" input_goals="{{goals}}" output_goals="{{left}}" '
        'input_waypoint_statuses="{{{}}}" output_waypoint_statuses="{{{}}}"/>'
    )
    once, twice = leaf.format('waypoint_statuses', 'marked'), leaf.format('marked', 'marked')
    front.world.client.load_tree(once, 'Once')
    front.world.client.load_tree(f'<Sequence>{once}{twice}</Sequence>', 'Twice')
    for _ in range(2):
        ended(front.through(0.1, 4.0, tree='Once'))
    ended(front.through(0.1, 4.0, tree='Twice'), GoalStatus.ABORTED, 'no pending waypoint status')


def test_a_goal_that_does_not_drive_ends_without_the_waypoints_of_another() -> None:
    """In main, where results have the statuses of waypoints."""
    theirs = pending([pose_stamped(1.0)])
    navigator: Any = SimpleNamespace(
        name=names.NAVIGATE_THROUGH_POSES,
        parameters=SimpleNamespace(default_trees={names.NAVIGATE_THROUGH_POSES: 'Tree'}),
        action_type=SimpleNamespace(Result=lambda: SimpleNamespace(waypoint_statuses=[])),
        statuses=lambda: theirs,
    )
    goal = NavigatorGoal(navigator, SimpleNamespace(request=NavigateThroughPoses.Goal()), 0.0)  # type: ignore[arg-type]
    refused = RunOutcome(BtExecute.Result.ERROR, 'another drives')
    for running, statuses in ((None, []), (SimpleNamespace(goal=None), []), (SimpleNamespace(goal=goal), [FAILED])):
        goal.running = running  # type: ignore[assignment]
        _, result = goal.result(refused, 0.0)
        assert [one.waypoint_status for one in result.waypoint_statuses] == statuses


def test_codes_are_those_of_the_servers_and_messages_name_the_node(front: Front) -> None:
    front.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1, GOAL_OUTSIDE_MAP)
    failed = ended(front.to(100.0), GoalStatus.ABORTED, 'scripted failure 0', code=GOAL_OUTSIDE_MAP)
    assert failed.error_msg.count('ComputePathToPose') == 1
    assert 'ComputePathToPose' in failed.error_msg.partition(': ')[0]
    ended(front.to(1.0))  # the code is not left for the next goal


def test_no_poses_fail_by_the_code_of_the_planner(front: Front) -> None:
    front.navigation.fail[names.COMPUTE_PATH_THROUGH_POSES] = (100, NO_VIAPOINTS_GIVEN)
    ended(front.through(), GoalStatus.ABORTED, code=NO_VIAPOINTS_GIVEN)


def test_feedback(driving: Front) -> None:
    front = driving
    goal = front.to(3.0)
    wait_until(lambda: goal.feedback and goal.feedback[-1].distance_remaining == pytest.approx(3.0))
    assert goal.feedback[-1].current_pose == front.world.server.goals.pose
    assert goal.feedback[-1].estimated_time_remaining.sec == 0  # it stands still
    for step in range(1, 11):  # 0.5 m/s
        front.stand(0.05 * step, 1.0 + 0.1 * step)
        seen = len(goal.feedback) + 1
        wait_until(partial(more_than, goal.feedback, seen))
    last = goal.feedback[-1]
    # The path has two poses; that at the start is the nearer one.
    assert last.distance_remaining == pytest.approx(3.0)
    left = last.estimated_time_remaining
    assert left.sec + left.nanosec * 1e-9 == pytest.approx(6.0, rel=0.05)
    assert last.number_of_recoveries == 0
    front.arrive()
    ended(goal)


def test_recoveries_and_poses_that_are_left(driving: Front) -> None:
    driving.navigation.fail[names.COMPUTE_PATH_THROUGH_POSES] = (4, 308)
    goal = driving.through(3.0, 4.0)
    wait_until(lambda: goal.feedback and goal.feedback[-1].number_of_recoveries == 1)
    wait_until(lambda: goal.feedback[-1].number_of_poses_remaining == 2)
    driving.drives_to(4.0)
    again = driving.through(5.0)  # takes over: counts and time begin again
    wait_until(lambda: again.feedback and again.feedback[-1].number_of_poses_remaining == 1)
    assert again.feedback[-1].number_of_recoveries == 0
    assert again.feedback[-1].navigation_time.sec <= goal.feedback[-1].navigation_time.sec


def test_a_newer_goal_takes_over_without_a_stop(driving: Front) -> None:
    first = driving.to(1.0)
    driving.drives_to(1.0)
    second = driving.to(2.0)
    ended(first, GoalStatus.ABORTED, 'newer goal')
    driving.drives_to(2.0)
    assert 'canceled' not in driving.follow.statuses.values()  # the controller went from one path to the other
    driving.arrive()
    ended(second)


def test_two_clients_that_preempt_each_other_five_times_a_second(driving: Front) -> None:
    goals = []
    for number in range(20):
        goals.append(driving.to(float(number + 1)))
        wait_until(lambda: goals[-1].accepted.is_set())
    driving.drives_to(20.0)
    driving.arrive()
    ended(goals[-1])
    for goal in goals[:-1]:
        assert goal.wait().status is GoalStatus.ABORTED
    assert 'canceled' not in driving.follow.statuses.values()


def test_goals_of_two_actions_that_have_the_same_id_are_canceled_apart(
    driving: Front, monkeypatch: pytest.MonkeyPatch
) -> None:
    driving.navigation.hold.add(names.WAIT)
    driving.world.client.load_tree('<Wait/>', 'Waits')
    same = uuid.uuid4()
    with monkeypatch.context() as patch:
        patch.setattr(uuid, 'uuid4', lambda: same)
        drive, wait = driving.to(1.0), driving.world.client.execute('Waits')
    driving.drives_to(1.0)
    wait_until(lambda: driving.navigation.count(names.WAIT), 'the other goal')
    drive.cancel()
    assert drive.wait().status is GoalStatus.CANCELED
    assert not wait.ended
    wait.cancel()
    assert wait.wait().status is GoalStatus.CANCELED


def test_a_goal_that_begins_as_a_run_ends_replaces_the_one_offered_to_that_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_nodes(tmp_path, server_nodes.__name__)
    monkeypatch.setattr(bt_navigator, 'LOOK_SECONDS', 10 * DEADLINE)  # goals that wait begin only as others end
    transformed: list[Any] = []
    monkeypatch.setattr(
        TransformListener, 'transform_pose', lambda _self, pose, _frame, known, *_: transformed.append((known, pose))
    )
    Held.reset()
    with open_front() as front:
        front.world.client.load_tree('<HeldInTick/>', 'Hold')
        goals = front.world.server.goals
        first = front.to(1.0, tree='Hold')
        assert Held.entered.wait(DEADLINE)
        second = front.to(2.0, tree='Hold')
        wait_until(lambda: sum(goal.running is not None for goal in goals._goals.values()) == 2, 'the offer')
        third = front.to(3.0, tree='Hold', frame='odom')
        wait_until(lambda: transformed, 'the third goal')
        ((known, pose),) = transformed
        front.world.server_runtime.call(lambda: known(pose))
        Held.release.set()  # the first run ends in this tick
        ended(first)
        ended(second, GoalStatus.ABORTED, 'newer goal')
        ended(third)
        wait_until(lambda: not goals.running.all(), 'the end of the runs')


def test_another_tree_cannot_take_over(driving: Front) -> None:
    driving.world.client.load_tree('<ComputePathToPose goal="{goal}" path="{path}"/>', 'PlanOnly')
    first = driving.to(1.0)
    driving.drives_to(1.0)
    ended(driving.to(2.0, tree='PlanOnly'), GoalStatus.ABORTED, 'navigate_to_pose drives the robot', 'cancel it first')
    assert driving.planned_to() == [1.0]  # nor has it changed the goal of the tree that runs
    # The default tree by its name is the same tree.
    again = driving.to(3.0, tree='flexbt_server/behavior_trees/navigate_to_pose.xml')
    driving.drives_to(3.0)
    assert first.wait().status is GoalStatus.ABORTED
    driving.arrive()
    ended(again)


def test_navigators_exclude_each_other(driving: Front) -> None:
    first = driving.to(1.0)
    driving.drives_to(1.0)
    ended(driving.through(2.0), GoalStatus.ABORTED, 'navigate_to_pose drives the robot')
    driving.arrive()
    ended(first)


def test_what_is_canceled_makes_room_when_it_has_stopped(driving: Front) -> None:
    first = driving.to(1.0)
    driving.drives_to(1.0)
    driving.follow.delay_cancel = 0.3
    first.call.cancel(DEADLINE)
    second = driving.through(2.0)  # sent before the robot has stopped, as BasicNavigator does
    third = driving.through(3.0)  # and this replaces it before it has begun, or a moment later
    assert first.wait().status is GoalStatus.CANCELED
    driving.drives_to(3.0)
    assert second.wait().status is GoalStatus.ABORTED
    assert driving.follow.statuses[0] == 'canceled'
    third.call.cancel(DEADLINE)
    assert third.wait().status is GoalStatus.CANCELED


def test_a_goal_that_waits_can_be_canceled(driving: Front) -> None:
    first = driving.to(1.0)
    driving.drives_to(1.0)
    driving.follow.delay_cancel = 1.0
    first.call.cancel(DEADLINE)
    second = driving.through(2.0)
    assert second.accepted.wait(DEADLINE)
    second.call.cancel(DEADLINE)
    assert second.wait().status is GoalStatus.CANCELED
    assert not driving.navigation.actions[names.COMPUTE_PATH_THROUGH_POSES].goals
    assert first.wait().status is GoalStatus.CANCELED


def test_a_tree_file_that_there_is_not_is_named_without_a_line(front: Front) -> None:
    ended(front.to(2.0, tree='nothing.xml'), GoalStatus.ABORTED, 'tree file refused: nothing.xml: not a file name')


def test_a_goal_in_a_frame_that_is_not_known_leaves_the_running_one_alone(driving: Front) -> None:
    first = driving.to(1.0)
    driving.drives_to(1.0)
    ended(driving.to(2.0, frame='nowhere'), GoalStatus.ABORTED, "'nowhere'", "'map'")
    wait_until(lambda: len(driving.planner.goals) > 1, 'the next plan')
    assert set(driving.planned_to()) == {1.0}
    driving.arrive()
    ended(first)


def test_a_goal_in_another_frame_is_transformed(front: Front) -> None:
    runtime = front.world.client.runtime
    dock = TransformStamped(child_frame_id='dock')
    dock.header.frame_id = 'map'
    dock.transform.translation.x = 5.0
    dock.transform.rotation.z, dock.transform.rotation.w = 1.0, 0.0  # it looks back
    publisher = runtime.call(
        lambda: runtime.node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos())
    )
    publisher.publish(TFMessage(transforms=[dock]))
    ended(front.to(1.0, frame='dock'))
    ended(front.to(2.0, frame=''))  # no frame is that of the map
    assert front.planned_to() == [pytest.approx(4.0), 2.0]


def test_the_first_goal_in_another_frame_may_be_stamped_before_it_was_sent(front: Front) -> None:
    runtime = front.world.client.runtime
    publisher = runtime.call(lambda: runtime.node.create_publisher(TFMessage, names.TF, 10))
    wait_until(publisher.get_subscription_count, 'the listener, which no goal has needed yet')
    odom = TransformStamped(child_frame_id='odom')
    odom.header.frame_id = 'map'
    for second in (5, 7):
        odom.header.stamp.sec = second
        odom.transform.translation.x = float(second)
        publisher.publish(TFMessage(transforms=[odom]))
    goal = NavigateToPose.Goal(pose=pose_stamped(1.0, frame='odom'))
    goal.pose.header.stamp.sec = 6
    ended(front.send(goal))
    assert front.planned_to() == [pytest.approx(7.0)]


def test_a_sub_tree_without_autoremap_gets_what_it_is_given(front: Front) -> None:
    drive = '<ComputePathToPose goal="{goal}" path="{path}"/><Wait/><FollowPath path="{path}"/>'
    trees = (
        '<root BTCPP_format="4" main_tree_to_execute="Outer">'
        '<BehaviorTree ID="Outer"><SubTree ID="Inner" goal="{goal}"/></BehaviorTree>'
        f'<BehaviorTree ID="Inner"><Sequence>{drive}</Sequence></BehaviorTree>'
        '<BehaviorTree ID="Forgets"><SubTree ID="Inner"/></BehaviorTree></root>'
    )
    assert front.world.client.load(xml=trees).code == BtLoad.Result.SUCCESS
    front.navigation.hold.add(names.WAIT)
    goal = front.to(1.0, tree='Outer')
    wait_until(lambda: goal.feedback and goal.feedback[-1].number_of_recoveries == 1)  # counted for the whole run
    front.navigation.actions[names.WAIT].end(0)
    ended(goal)
    ended(front.to(1.0, tree='Forgets'), GoalStatus.ABORTED, 'ComputePathToPose', 'goal')


def test_a_planner_that_no_selector_has_selected(front: Front) -> None:
    ids = 'planner_id="{selected_planner}"'  # main's navigate_to_pose_w_bounds_check.xml has no PlannerSelector
    front.world.client.load_tree(f'<ComputePathToPose goal="{{goal}}" path="{{path}}" {ids}/>', 'Plan')
    ended(front.to(1.0, tree='Plan'))
    assert front.planner.goals[0].planner_id == ''


def test_a_planner_that_answers_late(front: Front) -> None:
    front.planner.delay_accept = 0.05  # more than the 20 ms of Nav2
    ended(front.to(1.0))


def test_a_goal_needs_the_pose_of_the_robot() -> None:
    with open_server_world(navigators=NAVIGATORS, server_timeout=0.2) as world:
        world.server.activate()
        ended(Front(world).to(1.0), GoalStatus.ABORTED, 'pose of the robot is not known')


def test_a_tree_that_cannot_be_loaded(front: Front) -> None:
    ended(front.to(1.0, tree='Nowhere'), GoalStatus.ABORTED, "no tree 'Nowhere'")
    ended(front.to(1.0, tree='/etc/hostname.xml'), GoalStatus.ABORTED, 'allowed_directories')


def test_a_tree_that_raises_ends_its_goal_only(front: Front) -> None:
    front.world.client.load_tree('<Script code="x := goal + 1"/>', 'Broken')
    assert front.to(1.0, tree='Broken').wait().status is GoalStatus.ABORTED
    ended(front.to(1.0))


def test_an_edit_between_goals_is_taken_over(tmp_path: Path) -> None:
    file = tmp_path / 'tree.xml'
    file.write_text(document('<ComputePathToPose goal="{goal}" path="{path}"/>'))
    with open_front(default_nav_to_pose_bt_xml=str(file)) as front:
        ended(front.to(1.0))
        assert front.driven_to() == []
        drive = '<ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/>'
        file.write_text(document(f'<Sequence>{drive}</Sequence>'))
        ended(front.to(2.0))
        assert front.driven_to() == [2.0]
        file.write_text(document('<NoSuchNode/>'))
        ended(front.to(3.0))  # the last good version
        assert front.driven_to() == [2.0, 3.0]


def test_a_default_tree_that_cannot_be_loaded_is_told_at_the_start() -> None:
    wrong = {'navigators': NAVIGATORS, 'default_nav_to_pose_bt_xml': '/no/such.xml'}
    with pytest.raises(ServerParameterError, match=r'default_nav_to_pose_bt_xml.*/no/such'), open_server_world(**wrong):
        pass
    with (
        pytest.raises(UnfitParameterError, match=r'navigators.*dock_robot'),
        open_server_world(navigators=['dock_robot']),
    ):
        pass


def test_trees_of_a_directory_go_by_their_ids(tmp_path: Path) -> None:
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/>'
    (tmp_path / 'a.xml').write_text(document(plan, 'PlanOnly'))
    (tmp_path / 'b.xml').write_text('<root/>')
    with open_front(bt_search_directories=[str(tmp_path)], default_nav_to_pose_bt_xml='PlanOnly') as front:
        ended(front.to(1.0))
        ended(front.to(2.0, tree='PlanOnly'))
        ended(front.to(3.0, tree=str(tmp_path / 'a.xml')))
        assert (front.planned_to(), front.driven_to()) == ([1.0, 2.0, 3.0], [])
    wrong = pytest.raises(ServerParameterError, match=r'bt_search_directories.*nowhere')
    with wrong, open_server_world(bt_search_directories=['/nowhere']):
        pass


def test_a_path_in_a_package_share_is_that_of_the_package() -> None:
    file = resolve_file('flexbt_server/behavior_trees/navigate_to_pose.xml')
    share = next(parent for parent in file.parents if parent.name == 'flexbt_server')
    assert resolve_file(str(share / 'behavior_trees/navigate_to_pose.xml')) == file
    with pytest.raises(ResourceError):
        resolve_file(str(share / '../../../../../etc/hostname'))


def test_nothing_of_the_goal_before_is_left_but_what_the_tree_keeps(front: Front) -> None:
    keys = '<SetBlackboard value="5" output_key="kept"/>'
    front.world.client.load_tree(
        f'<Sequence>{keys}<ComputePathToPose goal="{{goal}}" path="{{path}}"/></Sequence>', 'A'
    )
    ended(front.to(1.0, tree='A'))
    front.world.client.load_tree('<AlwaysSuccess/>', 'B')
    ended(front.to(2.0, tree='B'))
    result = front.world.client.get('path', 'kept', 'goal', blackboard=names.NAVIGATE_TO_POSE)
    assert [entry.key for entry in result.entries] == ['path', 'kept', 'goal']
    path, kept, goal = map(from_entry, result.entries)
    assert (len(path.poses), kept, goal.pose.position.x) == (0, '5', 2.0)


def test_goal_pose(driving: Front) -> None:
    driving.click(1.0)
    driving.drives_to(1.0)
    driving.click(2.0)
    driving.drives_to(2.0)
    assert 'canceled' not in driving.follow.statuses.values()


def test_the_run_is_seen_paused_and_stopped_as_any_other(driving: Front) -> None:
    runtime = driving.world.client.runtime
    seen: list[TreeStatus] = []
    runtime.call(
        lambda: runtime.node.create_subscription(
            TreeStatus, names.TREE_STATUS, seen.append, names.transient_local_qos(64)
        )
    )
    goal = driving.to(1.0)
    driving.drives_to(1.0)
    wait_until(lambda: seen, 'the stream of transitions')
    assert driving.world.server.goals.stop_all('was stopped', DEADLINE)
    ended(goal, GoalStatus.ABORTED, 'was stopped')
    assert driving.follow.statuses[0] == 'canceled'
    wait_until(lambda: seen[-1].finished)


def test_the_log_of_the_tree_has_its_end(front: Front) -> None:
    runtime = front.world.client.runtime
    logs: list[BehaviorTreeLog] = []
    runtime.call(lambda: runtime.node.create_subscription(BehaviorTreeLog, names.BEHAVIOR_TREE_LOG, logs.append, 1000))
    server = front.world.server_runtime
    wait_until(lambda: server.call(lambda: server.node.count_subscribers(names.BEHAVIOR_TREE_LOG)))
    ended(front.to(1.0))

    def seen() -> list[tuple[str, str, str]]:
        return [(one.node_name, one.previous_status, one.current_status) for log in logs for one in log.event_log]

    wait_until(lambda: ('NavigateRecovery', 'SUCCESS', 'IDLE') in seen(), seen)
    of_root = [change[1:] for change in seen() if change[0] == 'NavigateRecovery']
    assert of_root == [('IDLE', 'RUNNING'), ('RUNNING', 'SUCCESS'), ('SUCCESS', 'IDLE')]


def test_the_lifecycle_of_bt_navigator(driving: Front) -> None:
    runtime = driving.world.client.runtime
    manager = LifecycleClient(runtime, names.BT_NAVIGATOR)
    wait_until(lambda: manager.state() == 'active', 'the servers of the default trees')
    assert LifecycleClient(runtime, names.WAYPOINT_FOLLOWER).state() == 'active'
    goal = driving.to(1.0)
    driving.drives_to(1.0)
    assert manager.change('deactivate')
    ended(goal, GoalStatus.ABORTED, 'deactivated')
    assert driving.to(2.0).wait().status is GoalStatus.REJECTED
    assert manager.change('activate')
    driving.navigation.hold.clear()
    ended(driving.to(3.0))


def test_a_goal_whose_tree_is_still_read_does_not_drive_after_bt_navigator_was_deactivated(front: Front) -> None:
    manager = LifecycleClient(front.world.client.runtime, names.BT_NAVIGATOR)
    may_read, served = threading.Event(), front.world.server.goals
    front.world.server._reader.submit(may_read.wait, 'a slow disk')
    goal = front.to(1.0)
    wait_until(lambda: not served._no_goals.is_set(), 'the goal')
    assert manager.change('deactivate')
    may_read.set()
    ended(goal, GoalStatus.ABORTED, 'deactivated')
    assert not front.follow.goals


def test_bt_navigator_is_active_when_the_servers_of_the_default_tree_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'tree.xml').write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Smooth">'
        '<SmoothPath unsmoothed_path="{path}" smoothed_path="{path}"/></BehaviorTree><BehaviorTree ID="Main"><Sequence>'
        '<ComputePathToPose goal="{goal}" path="{path}"/><SubTree ID="Smooth" _autoremap="true"/>'
        '<FollowPath path="{path}" server_name="{who}"/></Sequence></BehaviorTree></root>'
    )
    parameters = {'default_nav_to_pose_bt_xml': str(tmp_path / 'tree.xml'), 'navigators': [names.NAVIGATE_TO_POSE]}
    with open_server_world(**parameters) as world:
        world.server.activate()
        manager = LifecycleClient(world.client.runtime, names.BT_NAVIGATOR)
        assert manager.state() == 'activating'
        with monkeypatch.context() as short:
            short.setattr(activation, 'ACTIVATION_SECONDS', 0.0)
            wait_until(lambda: manager.state() == 'active', 'the end of its patience')
        assert manager.change('deactivate') and manager.state() == 'inactive'
        assert manager.change('activate') and manager.state() == 'active'  # a manager does not ask twice
        world.server.deactivate('was deactivated', 'is inactive', DEADLINE)
        world.server.activate()
        assert manager.state() == 'activating'
        world.navigation.serve({names.SMOOTH_PATH: SmoothPath})
        wait_until(lambda: manager.state() == 'active', 'the server that was missing')


def test_a_controller_that_fails_while_there_is_no_path_gets_the_next_one(
    driving: Front, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion_actions, 'PATH_SECONDS', 1e6)
    driving.world.client.load_tree(
        '<PipelineSequence><RateController hz="5"><RecoveryNode number_of_retries="1">'
        '<ComputePathToPose goal="{goal}" path="{path}"/><Wait/></RecoveryNode></RateController>'
        '<RecoveryNode number_of_retries="1"><FollowPath path="{path}"/>'
        '<SetBlackboard value="yes" output_key="again"/></RecoveryNode></PipelineSequence>'
    )
    wait = driving.navigation.actions[names.WAIT]
    driving.navigation.hold.add(names.WAIT)
    goal = driving.to(1.0, tree='Main')
    driving.drives_to(1.0)
    driving.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1_000_000, 208)
    wait_until(lambda: wait.running, 'the recovery of the planner')
    (follows,) = driving.follow.running
    driving.follow.end(follows, 'abort')
    asked = partial(driving.world.client.get, 'again', blackboard=names.NAVIGATE_TO_POSE)
    wait_until(lambda: asked().entries, 'the controller, tried again')
    (running,) = driving.world.server.goals.running.all()
    assert running.run.tree is not None
    (leaf,) = (node for node in running.run.tree.nodes if isinstance(node, motion_actions.FollowPath))
    wait_until(lambda: leaf._rest_by < math.inf, 'the leaf that waits')
    leaf._rest_by = 0.0  # as after a long time
    wait_until(lambda: leaf._rest_by > 0.0, 'all its patience with what is still ending, when the path comes')
    driving.navigation.fail.clear()
    wait.end(wait.running[0])
    wait_until(lambda: driving.follow.running, 'the next path')
    driving.arrive()
    ended(goal)
    assert all(request.path.poses for request in driving.follow.goals)


@pytest.mark.parametrize('seed', range(3))
def test_whatever_clients_do_one_navigator_drives_and_every_goal_ends(front: Front, seed: int) -> None:
    """A random walk: at no time two trees, at the end nothing that is left."""
    chance = random.Random(seed)
    drive = '<ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/>'
    front.world.client.load_tree(f'<Sequence>{drive}</Sequence>', 'Other')
    front.follow.delay_cancel = 0.02
    manager = LifecycleClient(front.world.client.runtime, names.BT_NAVIGATOR)
    running = front.world.server.goals.running
    goals: list[SentGoal] = []
    for step in range(120):
        (front.navigation.hold.add if chance.random() < 0.7 else front.navigation.hold.discard)(names.FOLLOW_PATH)
        match chance.randrange(12):
            case 0 | 1 | 2:
                goals.append(front.to(1.0 + step))
            case 3:
                goals.append(front.to(1.0 + step, tree='Other'))
            case 4:
                goals.append(front.through(1.0, 2.0 + step))
            case 5:
                goals.append(front.waypoints(1.0, 2.0 + step, number_of_loops=chance.randrange(3)))
            case 6:
                goals.append(front.to(1.0, tree='Nowhere', frame=chance.choice(['map', 'nowhere'])))
            case 7:
                front.click(1.0 + step)
            case 8 | 9 if goals:
                chance.choice(goals[-3:]).call.cancel(DEADLINE)
            case 10 if chance.random() < 0.3:
                assert manager.change('deactivate') and manager.change('activate')
            case _:
                for number in front.follow.running:
                    front.follow.end(number, chance.choice(['succeed', 'succeed', 'abort']))
        threading.Event().wait(chance.choice([0.0, 0.0, 0.005, 0.03]))
        assert len(running.all()) <= 1
    front.navigation.hold.clear()  # what was clicked may come after all else
    assert manager.change('deactivate') and manager.change('activate')
    for goal in goals:
        goal.call.cancel(DEADLINE)
    for goal in goals:
        assert goal.wait().status in (
            GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.REJECTED
        )  # fmt: skip
    navigators = front.world.server.navigators

    def left() -> list[Any]:
        at_server = [*running.all(), *front.world.server.goals._goals, *navigators._at_work, *navigators._waiting]
        return [*at_server, *front.follow.running]

    wait_until(lambda: not left(), left)
    # A pose that comes only now may take over once more.
    wait_until(lambda: front.to(0.5).wait().status is GoalStatus.SUCCEEDED, 'a goal that succeeds')


def test_waypoints(front: Front) -> None:
    goal = front.waypoints(1.0, 2.0, 3.0)
    assert ended(goal).missed_waypoints == []
    assert front.driven_to() == [1.0, 2.0, 3.0]
    seen = [feedback.current_waypoint for feedback in goal.feedback]
    assert seen == sorted(seen) and set(seen) == {0, 1, 2}


def test_waypoints_in_loops_from_an_index(front: Front) -> None:
    ended(front.waypoints(1.0, 2.0, goal_index=1, number_of_loops=2))
    assert front.driven_to() == [2.0, 1.0, 2.0, 1.0, 2.0]


def test_a_waypoint_that_is_missed_ends_it(front: Front) -> None:
    front.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1, GOAL_OUTSIDE_MAP)
    result = ended(front.waypoints(1.0, 2.0), GoalStatus.ABORTED, 'waypoint 0', code=FollowWaypoints.Result.UNKNOWN)
    ((missed),) = result.missed_waypoints
    assert (missed.index, missed.error_code, missed.goal) == (0, GOAL_OUTSIDE_MAP, pose_stamped(1.0))
    assert front.driven_to() == []


def test_waypoints_that_are_missed_are_left_out() -> None:
    with open_front(stop_on_failure=False) as front:
        front.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1, GOAL_OUTSIDE_MAP)
        result = ended(front.waypoints(1.0, 2.0))
        assert [missed.index for missed in result.missed_waypoints] == [0]
        assert front.driven_to() == [2.0]
        front.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1000, GOAL_OUTSIDE_MAP)
        endless = front.waypoints(1.0, 2.0, number_of_loops=2**32 - 1)
        ended(endless, GoalStatus.ABORTED, 'whole loop', code=FollowWaypoints.Result.UNKNOWN)


@pytest.mark.parametrize(('xs', 'fields', 'why'), [((), {}, 'no waypoints'), ((1.0,), {'goal_index': 1}, 'waypoint 1')])
def test_waypoints_that_cannot_be(front: Front, xs: tuple[float, ...], fields: dict[str, Any], why: str) -> None:
    ended(front.waypoints(*xs, **fields), GoalStatus.ABORTED, why, code=FollowWaypoints.Result.UNKNOWN)


def test_newer_waypoints_take_over_and_a_cancel_stops_the_robot(driving: Front) -> None:
    first = driving.waypoints(1.0, 2.0)
    driving.drives_to(1.0)
    tour = weakref.ref(driving.world.server.navigators._follower._tour)  # type: ignore[union-attr]
    second = driving.waypoints(3.0, 4.0)
    ended(first, GoalStatus.ABORTED, 'newer goal', code=FollowWaypoints.Result.UNKNOWN)
    driving.drives_to(3.0)
    wait_until(lambda: (gc.collect(), tour() is None)[1], 'nothing is kept of what was replaced', every=0.25)
    assert 'canceled' not in driving.follow.statuses.values()
    second.call.cancel(DEADLINE)
    assert second.wait().status is GoalStatus.CANCELED
    assert driving.follow.statuses[len(driving.follow.goals) - 1] == 'canceled'


@pytest.mark.parametrize('newer', [1, 2])
def test_newer_waypoints_are_canceled_when_the_robot_of_older_ones_has_stopped(
    driving: Front, monkeypatch: pytest.MonkeyPatch, newer: int
) -> None:
    monkeypatch.setattr(TransformListener, 'transform_pose', lambda *_: None)  # they wait for their frame
    driving.follow.delay_cancel = 0.1
    goals = [driving.waypoints(1.0)]
    driving.drives_to(1.0)
    at_server = driving.world.server.goals._goals
    for _ in range(newer):
        goals.append(driving.waypoints(2.0, frame='odom'))
        ended(goals[-2], GoalStatus.ABORTED, 'newer goal', code=FollowWaypoints.Result.UNKNOWN)
        wait_until(lambda: len(at_server) == len(goals), 'the newer goal')
    goals[-1].cancel()
    assert goals[-1].wait().status is GoalStatus.CANCELED
    assert driving.follow.statuses == {0: 'canceled'}


def test_waypoints_are_not_told_as_canceled_while_the_robot_may_drive() -> None:
    with open_front(cancel_timeout=0.5) as front:
        front.navigation.hold.add(names.FOLLOW_PATH)
        front.follow.on_cancel = lambda _handle: CancelResponse.REJECT
        goal = front.waypoints(1.0)
        front.drives_to(1.0)
        goal.cancel()
        ended(goal, GoalStatus.ABORTED, 'canceled', code=FollowWaypoints.Result.UNKNOWN)
        front.follow.on_cancel = None
        wait_until(lambda: not front.follow.running, 'the end of the drive')


@pytest.mark.parametrize('stops', [True, False])
def test_the_robot_waits_for_input_at_waypoints(stops: bool) -> None:
    task = {'waypoint_task_executor_plugin': 'input_at_waypoint', 'stop_on_failure': stops}
    with open_front(**task, **{'input_at_waypoint.timeout': 600.0}) as front:
        goal = front.waypoints(1.0, 2.0, 3.0)
        runtime = front.world.client.runtime
        button = runtime.call(lambda: runtime.node.create_publisher(Empty, 'input_at_waypoint/input', 10))
        wait_until(button.get_subscription_count, 'who waits for input')
        wait_until(lambda: front.follow.statuses.get(0) == 'succeed')
        assert front.driven_to() == [1.0]
        wait_until(lambda: (button.publish(Empty()), goal.ended)[1], 'the end')
        ended(goal)
        assert front.driven_to() == [1.0, 2.0, 3.0]
        other = front.waypoints(4.0)
        wait_until(lambda: front.follow.statuses.get(3) == 'succeed')
        other.call.cancel(DEADLINE)
        assert other.wait().status is GoalStatus.CANCELED
    with open_front(**task, **{'input_at_waypoint.timeout': 0.05}) as front:
        goal = front.waypoints(1.0, 2.0)
        failed = FollowWaypoints.Result.TASK_EXECUTOR_FAILED
        result = ended(goal, GoalStatus.ABORTED, 'nothing has come on', code=failed) if stops else ended(goal)
        assert [(one.index, one.error_code) for one in result.missed_waypoints] == [(0, failed), (1, failed)][
            : 2 - stops
        ]
    with open_front(**task, **{'input_at_waypoint.enabled': False}) as front:
        ended(front.waypoints(1.0, 2.0))


def test_what_a_robot_cannot_do_at_waypoints_is_told_at_the_start() -> None:
    with pytest.raises(
        UnfitParameterError, match="there is no 'photo_at_waypoint'; known: wait_at_waypoint, input_at_waypoint"
    ):
        open_front(waypoint_task_executor_plugin='photo_at_waypoint').__enter__()


def test_the_robot_pauses_at_waypoints() -> None:
    with open_front(**{'wait_at_waypoint.waypoint_pause_duration': 3_600_000}) as front:
        goal = front.waypoints(1.0, 2.0)
        wait_until(lambda: front.follow.statuses.get(0) == 'succeed')
        goal.call.cancel(DEADLINE)
        assert goal.wait().status is GoalStatus.CANCELED
        assert front.driven_to() == [1.0]
    with open_front(**{'wait_at_waypoint.waypoint_pause_duration': 50}) as front:
        ended(front.waypoints(1.0, 2.0))
