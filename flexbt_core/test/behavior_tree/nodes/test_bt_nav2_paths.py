# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's nodes that watch paths and motion, and those of its branch main: tick by tick, on a manual clock."""

from __future__ import annotations

import math
import threading
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.controls import PauseResumeController
from flexbt_core.behavior_tree.nodes.nav2.decorators import DistanceController, Position, SpeedController
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees.steps import NAMES, check, control, make, step

# Tree, and what happens to it in the branch main (the notation of flexbt_testing.behavior_trees.steps).
MAIN: list[tuple[str, str]] = [
    # The last child ends it, and fails even when it succeeds; Nav2's own test of this has the same counts.
    (control('RoundRobin', 'S', 'S', 'S'), 'S 0S | S 1S | F 2S | S 0S'),
    (control('RoundRobin', 'F', 'F', 'RF'), 'R 0F 1F 2R | F 2F | R 0F 1F 2R'),
    (control('RoundRobin', 'F', 'K'), 'F 0F 1K | F 0F 1K'),
    (control('RoundRobin', 'K', 'K'), 'K 0K 1K'),
    (control('RoundRobin', 'S', 'R'), 'S 0S | R 1R | halt 1! | S 0S'),
    (control('RoundRobin', 'S', 'S', wrap_around='true'), 'S 0S | S 1S | S 0S'),
    (control('NonblockingSequence', 'S', 'S'), 'S 0S 1S | S 0S 1S'),
    (control('NonblockingSequence', 'RS', 'R', 'RRS'), 'R 0R 1R 2R | R 0S 1R 2R | R 1R 2S'),
    (control('NonblockingSequence', 'R', 'RF', 'R'), 'R 0R 1R 2R | F 0R 1F 0! 2!'),
    (control('NonblockingSequence', 'R', 'K'), 'error 0R 1K | halt 0!'),
    # A child that has succeeded is asked again, while others run.
    (f'<NonblockingSequence><Inverter>{step("FS")}</Inverter>{step("R", 1)}</NonblockingSequence>',
     'R 0F 1R | F 0S 1!'),
    (control('PersistentSequence', 'S', 'RS', 'S', current_child_idx='{i}'),
     'i=0 R 0S 1R | halt 1! | S 1S 2S | R 0S 1R'),
    (control('PersistentSequence', 'S', 'F', 'S', current_child_idx='{i}'), 'i=1 F 1F | F 0S 1F | i=2 S 2S | i=3 S'),
    (control('PersistentSequence', 'K', 'K', current_child_idx='{i}'), 'i=0 S 0K 1K'),
    (control('PersistentSequence', 'S', current_child_idx='{i}'), 'error | i=-1 error | i=0 S 0S'),
]  # fmt: skip


@pytest.mark.parametrize(('body', 'expected'), MAIN)
def test_tick_by_tick_as_in_main(body: str, expected: str) -> None:
    check(body, expected, 'main')


def test_nodes_of_main_are_there_in_the_branch_jazzy_too_but_round_robin_goes_round() -> None:
    check(control('NonblockingSequence', 'S', 'S'), 'S 0S 1S')
    check(control('RoundRobin', 'S', 'S', wrap_around='false'), 'S 0S | F 1S')
    check(control('RoundRobin', 'S', 'S'), 'S 0S | S 1S | S 0S')


def test_files_of_both_branches_run_side_by_side_each_with_its_nodes() -> None:
    """Of a file that includes another each goes by its own: a round that is over, and one that goes round."""
    body = '<{id} current_child_idx="{{i}}"><RoundRobin><AlwaysSuccess/></RoundRobin></{id}>'
    files = {
        'main.xml': body.format(id='PersistentSequence'),
        'other.xml': '<RoundRobin><AlwaysSuccess/></RoundRobin>',
    }
    registry = builtin_registry()
    register_nav2(registry, 'jazzy')
    text = ''.join(f'<include path="{file}"/>' for file in files)
    document = load_xml(
        f'<root BTCPP_format="4">{text}</root>', 'all.xml', registry,
        include=lambda path, _package, _including: (path, (
            f'<root BTCPP_format="4"><BehaviorTree ID="{path[:-4].title()}">{files[path]}</BehaviorTree></root>'
        )),
    )  # fmt: skip
    board = Blackboard()
    board.set('i', 0)
    given = {
        id: Tree(TreeLibrary([document]), id, blackboard=board, clock=ManualClock()).tick_once()
        for id in document.trees
    }
    assert given == {'Main': NodeStatus.FAILURE, 'Other': NodeStatus.SUCCESS}


def test_a_round_that_is_over_is_its_own_reason_and_a_failed_child_is_another() -> None:
    for scripts, path in ((('F', 'S'), 'top'), (('F', 'F'), 'F_1'), (('S', 'K'), 'top')):
        tree, _ = make(control('RoundRobin', *scripts), branch='main')
        while tree.tick_once() is not NodeStatus.FAILURE:
            pass
        assert tree.failure is not None
        assert tree.failure.path == path
        assert path != 'top' or 'wrap_around is false' in tree.failure.reason


# -- paths -------------------------------------------------------------------------------------------------------------


def path(*points: tuple[float, float]) -> Any:
    def pose(x: float, y: float) -> Any:
        return SimpleNamespace(pose=SimpleNamespace(position=SimpleNamespace(x=x, y=y)))

    return SimpleNamespace(poses=[pose(x, y) for x, y in points])


STRAIGHT = ((0.0, 0.0), (1.0, 0.0))
ROUND = ((0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 0.0))
ELSEWHERE = ((0.0, 0.0), (0.0, 2.0), (5.0, 2.0))
FAR = ((-4.0, 0.0), (1.0, 0.0))


REMOVED = ((-1.0, -1.0),)


def over_paths(script: str, *paths: tuple[tuple[float, float], ...] | None, **ports: str) -> str:
    """Return result and calls for each path in turn, below a control that keeps the node's status."""
    attributes = ''.join(f' {name}="{value}"' for name, value in ports.items())
    tree, calls = make(
        f'<PipelineSequence><PathLongerOnApproach path="{{path}}"{attributes}>{step(script)}</PathLongerOnApproach>'
        f'{step("R", 1)}</PipelineSequence>'
    )
    decorator = tree.nodes[1]
    results = []
    for points in paths:
        if points is REMOVED:
            tree.blackboard.unset('path')
        elif points is not None:
            tree.blackboard.set('path', path(*points))
        calls.clear()
        results.append(NAMES[decorator.execute()] + ''.join(calls))
    return ' '.join(results)


def test_a_much_longer_path_near_the_goal_ticks_the_child() -> None:
    assert over_paths('S', STRAIGHT, ROUND, ROUND, STRAIGHT, ROUND) == 'S S0S S S S0S'
    assert over_paths('F', STRAIGHT, ROUND) == 'S F0F'
    corner, longer = ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0)), ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0))
    assert over_paths('S', corner, longer, corner, ROUND) == 'S S S S0S'


def test_the_child_goes_on_with_the_path_with_which_it_began() -> None:
    assert over_paths('RRS', STRAIGHT, ROUND, ROUND, ROUND, ROUND) == 'S R0R R0R S0S S'
    # As in Nav2, a path that is short again leaves it as it is.
    assert over_paths('RS', STRAIGHT, ROUND, STRAIGHT, ROUND) == 'S R0R S S0S'
    assert over_paths('KS', STRAIGHT, ROUND, ROUND) == 'S K0K S0S'


def test_the_last_path_counts_while_there_is_none() -> None:
    assert over_paths('S', STRAIGHT, REMOVED, ROUND) == 'S S S0S'


def test_the_time_of_a_path_begins_anew_with_another_one_and_not_with_the_same() -> None:
    clock = ManualClock()
    tree, _ = make('<PathExpiringTimer seconds="10" path="{path}"/>', clock)

    def tick(after: float, points: tuple[tuple[float, float], ...]) -> str:
        clock.advance(after)
        tree.blackboard.set('path', path(*points))
        return NAMES[tree.tick_once()]

    assert [tick(0.0, STRAIGHT), tick(6.0, ROUND), tick(6.0, ROUND), tick(4.0, ROUND)] == ['F', 'F', 'F', 'S']
    assert tree.next_wake == 26.0


def test_no_path_another_goal_a_long_way_or_a_little_more_is_fine() -> None:
    assert over_paths('S', None, STRAIGHT, ELSEWHERE, (), ELSEWHERE) == 'S S S S S'
    assert over_paths('S', FAR, ROUND) == 'S S'
    assert over_paths('S', FAR, ROUND, prox_len='6.0', length_factor='0.5') == 'S S0S'
    assert over_paths('S', STRAIGHT, ROUND, length_factor='5') == 'S S'


# -- motion ------------------------------------------------------------------------------------------------------------


class Robot:
    """Where the robots of these tests are."""

    place: ClassVar[Position | None] = (0.0, 0.0)
    velocity: ClassVar[float] = 0.0


class ByDistance(DistanceController):
    """The robot is where the test says."""

    def position(self) -> Position | None:
        return Robot.place


class BySpeed(SpeedController):
    """The robot is as fast as the test says."""

    def speed(self) -> float:
        return Robot.velocity


@pytest.fixture(autouse=True)
def robot() -> None:
    Robot.place, Robot.velocity = (0.0, 0.0), 0.0


def beside(body: str, clock: ManualClock | None = None) -> tuple[Tree, list[str]]:
    """Next to a leaf that runs, in a control that keeps the status of the node."""
    return make(f'<PipelineSequence>{body}{step("R", 9)}</PipelineSequence>', clock, extra=(ByDistance, BySpeed))


def test_distance_controller_begins_its_child_whenever_the_robot_has_moved_on() -> None:
    tree, calls = beside(f'<ByDistance distance="2">{step("SSRS")}</ByDistance>')
    seen = []
    for x in (0.0, 1.9, 2.0, 3.0, 4.5, 4.6, 6.4, 6.5, 6.6):
        Robot.place = (x, 0.0)
        calls.clear()
        assert tree.tick_once() is NodeStatus.RUNNING
        seen.append(calls[0] if calls[0] != '9R' else '')
    # At 4.6 the child succeeds, so the next 2 m begin there.
    assert seen == ['0S', '', '0S', '', '0R', '0S', '', '', '0S']


def test_distance_controller_halts_its_child_when_the_robot_is_lost() -> None:
    body = f'<Fallback><ByDistance distance="2">{step("R")}</ByDistance>{step("R", 1)}</Fallback>'
    tree, calls = make(body, extra=(ByDistance,))
    tree.tick_once()
    Robot.place = None
    calls.clear()
    assert tree.tick_once() is NodeStatus.RUNNING
    assert calls == ['0!', '1R']


def test_distance_controller_counts_from_where_it_begins_and_fails_when_lost() -> None:
    tree, calls = make(f'<ByDistance name="by">{step("F")}</ByDistance>', extra=(ByDistance,))
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.lines() == ['F_0: Step returned FAILURE', 'by: ByDistance: the child failed']
    Robot.place = None
    calls.clear()
    assert tree.tick_once() is NodeStatus.FAILURE
    assert (tree.failure.path, tree.failure.reason) == ('by', 'ByDistance: it is not known where the robot is')
    assert calls == []
    Robot.place = (5.0, 5.0)
    assert tree.tick_once() is NodeStatus.FAILURE
    assert calls == ['0F']


def test_distance_controller_that_was_lost_from_the_beginning_goes_on_when_the_robot_is_found() -> None:
    tree, calls = make(
        f'<IfThenElse><ByDistance distance="2">{step("RS")}</ByDistance>{step("S", 1)}</IfThenElse>',
        extra=(ByDistance,),
    )
    seen = []
    for Robot.place in (None, (4.0, 0.0), (4.0, 0.0)):
        seen.append(NAMES[tree.tick_once()])
    assert (seen, calls) == (['F', 'R', 'S'], ['0R', '0S', '1S'])


@pytest.mark.parametrize(('velocity', 'period'), [(0.5, 2.0), (1.5, 0.8), (2.5, 0.5), (9.0, 0.5), (-1.0, 2.0)])
def test_speed_controller_follows_the_speed(velocity: float, period: float) -> None:
    clock = ManualClock()
    limits = 'min_rate="0.5" max_rate="2" min_speed="0.5" max_speed="2.5"'
    tree, calls = beside(f'<BySpeed {limits}>{step("S")}</BySpeed>', clock)
    Robot.velocity = velocity
    tree.tick_once()
    assert calls == ['0S', '9R']
    assert tree.next_wake == 0.5
    clock.set(0.4)
    tree.tick_once()
    assert calls[2:] == ['9R']
    clock.set(0.5)
    tree.tick_once()
    assert calls[3:] == ['0S', '9R']
    assert tree.next_wake == pytest.approx(0.5 + period)
    clock.set(0.5 + period)
    tree.tick_once()
    assert calls[5:] == ['0S', '9R']
    tree.halt()
    assert tree.next_wake is None


def test_speed_controller_goes_on_after_a_speed_that_is_no_number() -> None:
    clock = ManualClock()
    tree, calls = beside(f'<BySpeed min_rate="0.5" max_rate="2" max_speed="1">{step("S")}</BySpeed>', clock)
    tree.tick_once()
    for Robot.velocity, now, due in ((math.nan, 0.5, 2.5), (1.0, 2.5, 3.0)):
        clock.set(now)
        tree.tick_once()
        assert (calls.count('0S'), tree.next_wake) == (2 if now < 1.0 else 3, due)


def test_speed_controller_begins_anew_when_the_goal_changes_and_ticks_a_child_that_runs() -> None:
    clock = ManualClock()
    tree, calls = beside(f'<BySpeed goal="{{goal}}">{step("SRS")}</BySpeed>', clock)
    tree.blackboard.set('goal', (1,))
    tree.tick_once()
    clock.set(0.1)
    tree.tick_once()
    tree.blackboard.set('goal', (2,))
    tree.tick_once()
    tree.tick_once()
    assert calls == ['0S', '9R', '9R', '0R', '9R', '0S', '9R']
    assert tree.next_wake == 1.1


@pytest.mark.parametrize('port', ['min_rate', 'max_rate'])
def test_speed_controller_refuses_a_rate_that_is_none(port: str) -> None:
    clock = ManualClock()
    tree, _ = beside(f'<BySpeed {port}="0">{step("S")}</BySpeed>', clock)
    with pytest.raises(NodeExecutionError, match=rf'\[{port}\] has to be a positive rate, not 0.0'):
        for time in (0.0, 1.0):
            clock.set(time)
            tree.tick_once()


def test_speed_controller_with_one_speed_for_both_limits_has_two_rates() -> None:
    clock = ManualClock()
    tree, _ = beside(f'<BySpeed min_speed="1" max_speed="1">{step("S")}</BySpeed>', clock)
    for velocity, period in ((0.9, 10.0), (1.0, 1.0)):
        Robot.velocity = velocity
        tree.tick_once()
        assert tree.next_wake is not None
        clock.set(tree.next_wake)
        tree.tick_once()
        assert tree.next_wake == pytest.approx(clock.now() + period)
        clock.set(tree.next_wake)


# -- pause and resume --------------------------------------------------------------------------------------------------


def pausable(*scripts: str) -> tuple[Tree, list[str], PauseResumeController]:
    tree, calls = make(control('PauseResumeController', *scripts), extra=(PauseResumeController,))
    node = tree.root
    assert isinstance(node, PauseResumeController)
    assert node.state.name == 'RESUMED'
    return tree, calls, node


def test_pausing_halts_the_work_and_resuming_begins_it_again() -> None:
    tree, calls, node = pausable('RRRS', 'R', 'RS', 'S')
    assert NAMES[tree.tick_once()] == 'R'
    assert node.pause()
    assert tree.take_wake()
    assert NAMES[tree.tick_once()] == 'R'
    assert node.state.name == 'ON_PAUSE'
    # The child for the transition completes, and the one for the pause follows at once.
    assert NAMES[tree.tick_once()] == 'R'
    assert node.state.name == 'PAUSED'
    assert not node.pause()
    assert node.resume()
    assert not node.resume()
    assert [NAMES[tree.tick_once()] for _ in range(3)] == ['R', 'R', 'S']
    assert calls == ['0R', '0!', '2R', '2S', '1R', '1!', '3S', '0R', '0R', '0S']


def test_children_that_are_left_out_are_passed_over() -> None:
    tree, calls, node = pausable('RS')
    tree.tick_once()
    assert node.pause()
    assert NAMES[tree.tick_once()] == 'R'
    assert node.state.name == 'PAUSED'
    assert NAMES[tree.tick_once()] == 'R'
    assert node.resume()
    assert NAMES[tree.tick_once()] == 'S'
    assert calls == ['0R', '0!', '0S']


def test_a_pause_during_the_way_back_is_a_pause() -> None:
    tree, calls, node = pausable('R', 'S', 'S', 'R')
    for request in (None, node.pause, node.resume):
        if request is not None:
            assert request()
            tree.take_wake()
        tree.tick_once()
    assert node.state.name == 'ON_RESUME'
    assert not node.resume()
    assert node.pause()
    tree.take_wake()
    tree.tick_once()
    assert node.state.name == 'PAUSED'
    assert calls == ['0R', '0!', '2S', '1S', '3R', '3!', '2S', '1S']


@pytest.mark.parametrize('scripts', [('F',), ('R', 'S', 'F'), ('R', 'F')])
def test_a_failure_of_any_child_is_that_of_the_node(scripts: tuple[str, ...]) -> None:
    tree, _, node = pausable(*scripts)
    status = tree.tick_once()
    if status is NodeStatus.RUNNING:
        node.pause()
        status = tree.tick_once()
    assert status is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.path == f'F_{len(scripts) - 1}'
    assert all(node.status is NodeStatus.IDLE for node in tree.nodes)


def test_what_does_not_run_cannot_be_paused_and_a_halt_ends_a_pause() -> None:
    tree, calls, node = pausable('K', 'R')
    assert not node.pause()
    assert NAMES[tree.tick_once()] == 'S'
    tree, calls, node = pausable('R', 'R')
    tree.tick_once()
    node.pause()
    tree.tick_once()
    tree.halt()
    assert node.state.name == 'RESUMED'
    assert not node.resume()
    assert NAMES[tree.tick_once()] == 'R'
    assert calls == ['0R', '0!', '1R', '1!', '0R']
    with pytest.raises(TreeLoadError, match='has 1 to 4 children, not 5'):
        pausable('S', 'S', 'S', 'S', 'S')


def test_the_last_request_that_was_accepted_from_another_thread_counts() -> None:
    tree, _, node = pausable('R', 'R', 'S', 'S')
    tree.tick_once()
    accepted: list[str] = []

    def ask() -> None:
        while accepted.count('resume') < 10:
            for request in (node.pause, node.pause, node.resume):
                if request():
                    accepted.append(request.__name__)

    other = threading.Thread(target=ask)
    other.start()
    while other.is_alive() or tree.wake_pending:
        tree.take_wake()
        tree.tick_once()
    assert node.state.name == ('PAUSED' if accepted[-1] == 'pause' else 'RESUMED')
