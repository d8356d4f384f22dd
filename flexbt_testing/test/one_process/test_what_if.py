# SPDX-License-Identifier: BSD-3-Clause
"""What a mission would have become: children of a world, and the first difference of two courses."""

from __future__ import annotations

import random
import re
import subprocess
import sys
import tempfile
import time
from multiprocessing import Pipe
from pathlib import Path

import pytest

from flexbt_common.errors import ResourceError
from flexbt_common.files import resolve_file
from flexbt_msgs.msg import BehaviorStructure, StateStructure
from flexbt_testing.one_process.coverage import Coverage
from flexbt_testing.one_process.forks import Fork, ForkError, Leaf
from flexbt_testing.one_process.live import RealTime
from flexbt_testing.one_process.programs import Program
from flexbt_testing.one_process.scheduler import SCHEDULER
from flexbt_testing.one_process.what_if import Course, Event, compare, read_change
from flexbt_testing.one_process.world import World

TREE = 'flexbt_demo_behaviors/navigate/navigate.xml'


def edited_tree(folder: Path, before: str, after: str) -> Path:
    """Return a file with the tree of demonstration 1, changed."""
    text = resolve_file(TREE).read_text()
    assert before in text
    file = folder / 'edited.xml'
    file.write_text(text.replace(before, after))
    return file


def to_the_office(world: World) -> None:
    world.run_until(world.asks('/AskGoal'), within=120)
    world.answer('/AskGoal', 'office')
    world.run_until(world.asks('/AskGoal'), within=120)


@pytest.mark.world(motion='abstract')
def test_another_tree_from_five_seconds_on(world: World, tmp_path: Path) -> None:
    edited = edited_tree(tmp_path, '<RateController hz="1.0">', '<RateController hz="0.1">')
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run(5.0)
    found = world.what_if(lambda world: world.swap(TREE, edited), to_the_office)
    assert found.difference is not None and found.difference.before is not None and found.difference.after is not None
    assert found.difference.who == 'tree Navigate'
    assert found.difference.before.what == found.difference.after.what == 'ComputePathToPose RUNNING'
    assert found.difference.after.time - found.difference.before.time == pytest.approx(9.0, abs=0.2)
    assert found.difference.time > 30.0, 'the tree that ran at 5 s was swapped, too'
    assert '<RateController hz="1.0">' in resolve_file(TREE).read_text(), 'the file of the parent was swapped'


@pytest.mark.world('goals', motion='abstract')
def test_another_behavior_in_yaml_from_its_next_start_on(world: World, tmp_path: Path) -> None:
    name, edited = 'flexbt_demo_behaviors/goals/reach_goal.yaml', tmp_path / 'edited.yaml'
    edited.write_text(resolve_file(name).read_text().replace('LoadTree', 'Load'))
    found = world.what_if(lambda world: world.swap(name, edited), lambda world: world.start('Reach Goal'))
    assert found.difference is not None and found.difference.before is not None and found.difference.after is not None
    assert (found.difference.before.what, found.difference.after.what) == ('enters /LoadTree', 'enters /Load')


@pytest.mark.world(motion='abstract')
def test_had_it_been_confirmed(world: World) -> None:
    world.start('Navigate', autonomy='Low')
    world.answer('/AskGoal', 'kitchen')
    world.run_until(world.asks('/Drive'), within=90)
    found = world.what_if(lambda world: world.confirm('/Drive'), lambda world: world.run(10.0))
    assert found.difference is not None and found.difference.after is not None
    assert found.difference.who == 'executive'
    assert found.difference.before is None
    assert found.difference.after.what == 'leaves /Drive by done (outcome)'
    assert found.before.ends[0].startswith('in /Drive; ')
    assert found.after.ends[0].startswith('in /AskGoal; ')
    assert re.match(
        r'first difference at \d+\.\d\d s, executive\n'
        r'  as it was: nothing more\n'
        r'  changed:   leaves /Drive by done \(outcome\) at \d+\.\d\d s\n'
        r'the ends\n',
        str(found),
    ), str(found)


@pytest.mark.seeds(2)
def test_a_child_goes_on_as_the_world_itself_and_leaves_it_alone(world: World) -> None:
    SHARED.append('a global of the program')
    world.start('Navigate')
    world.answer('/AskGoal', 'corridor')
    world.run(6.0)
    draw = random.getstate()
    assert world.fork(lambda _world: random.getstate()).result() == draw, 'Python seeds it anew in a fork'
    log = next(world.home.rglob('onboard_executive.jsonl'))
    length = log.stat().st_size
    found = world.what_if(lambda _world: SHARED.clear(), stop_later)
    assert found.difference is None, str(found)
    assert found.before.events == found.after.events
    assert (random.getstate(), SHARED.pop()) == (draw, 'a global of the program')
    assert log.stat().st_size == length, 'a child has written into the files of this world'
    assert world.course(stop_later) == found.before
    assert log.stat().st_size > length


SHARED: list[str] = []


def stop_later(world: World) -> None:
    world.run(5.0)
    world.stop()
    world.run(2.0)


@pytest.mark.world(motion='abstract')
def test_a_child_can_be_forked_again_and_its_files_are_of_its_moment(world: World) -> None:
    (world.home / 'file').write_text('of the parent')

    def act(world: World) -> tuple[str, str, float]:
        text = (world.home / 'file').read_text()
        (world.home / 'file').write_text('of the child')
        world.run(2.0)
        return text, world.fork(lambda world: (world.home / 'file').read_text()).result(), world.now

    now = world.now
    child = world.fork(act)
    (world.home / 'file').write_text('written later')
    for _ in range(2):
        assert child.result() == ('of the parent', 'of the child', pytest.approx(now + 2.0, abs=0.01))
    assert world.now == now
    assert (world.home / 'file').read_text() == 'written later'


def test_a_child_has_files_of_its_own_where_the_temporary_directory_is_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'link').symlink_to(tmp_path, target_is_directory=True)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'link'))
    with World(0, [Program('', 'idle', main=lambda: time.sleep(1e6))]) as world:
        (world.home / 'file').write_text('of the parent')
        world.fork(lambda world: (world.home / 'file').write_text('of the child')).result()
        assert (world.home / 'file').read_text() == 'of the parent'


@pytest.mark.world(motion='abstract')
def test_a_world_branches_whatever_task_waits_then(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    branch = world.branch_at(world.now + 1.0, World.stop)
    course = world.course(lambda world: world.run(3.0))
    if isinstance(branch.side, Leaf):
        branch.side.end(lambda: course)
    assert isinstance(branch.side, Fork)
    assert branch.side.result().ends[0].startswith('preempted; ')
    assert course.ends[0].startswith('in /Drive; ')


@pytest.mark.world(motion='abstract')
def test_what_fails_in_a_child_is_told(world: World, tmp_path: Path) -> None:
    with pytest.raises(ForkError, match="there is no process 'nobody'"):
        world.fork(lambda world: world.kill('nobody')).result()
    world.start('Navigate')
    found = world.what_if(lambda world: world.kill('onboard_executive'), lambda world: world.answer('/AskGoal', 'dock'))
    assert len(found.before.ends) == 1
    assert found.after.ends[1].startswith('AssertionError: ')
    found = world.what_if(lambda world: world.kill('bt_sever'), lambda world: world.run(1.0))
    assert found.difference is not None and found.difference.after is not None
    assert found.difference.after[1:3] == ('the test', 'fails')
    with pytest.raises(AssertionError, match='Folow'):
        world.swap(TREE, edited_tree(tmp_path, '<FollowPath ', '<Folow '))
    with pytest.raises(AssertionError, match='there is no file'):
        world.swap(TREE, tmp_path / 'missing.xml')
    with pytest.raises(ResourceError, match=r'navigat\.xml.*did you mean'):
        world.swap(TREE.replace('gate.xml', 'gat.xml'), tmp_path / 'edited.xml')


def course(*events: tuple[float, str, str], end: float = 100.0) -> Course:
    return Course([Event(*event) for event in events], end)


def test_the_first_difference_is_of_what_one_has_decided() -> None:
    a, b, c = (1.0, 'executive', 'a'), (2.0, 'executive', 'b'), (3.0, 'tree T', 'c')
    assert compare(course(a, b, c), course(a, b, c)).difference is None
    assert compare(course(a, c, b), course(c, a, b)).difference is None, 'the order between two is of nobody'
    assert compare(course(a, b), course(b, a)).difference is not None
    assert compare(course(a), course((1.09, *a[1:]))).difference is None
    later = compare(course(a, b), course(a, (2.2, *b[1:]), c)).difference
    assert later is not None and (later.time, later.who) == (2.0, 'executive')
    more = compare(course(a, b), course(a, b, c)).difference
    assert more is not None and (more.before, more.time, more.who) == (None, 3.0, 'tree T')
    assert compare(course(a, b, end=2.5), course(a, b, c)).difference is None, 'it was not there any more at 3 s'
    assert compare(course(a, b, c), course(a, b, end=2.5)).difference is None
    assert compare(course(a, b), course(a, (2.0, 'executive', 'x'), end=2.0)).difference is not None
    failed = (2.0, 'the test', 'fails')
    assert compare(course(a, failed, end=2.0), course(a, failed, end=2.0)).difference is None
    assert compare(course(a, end=2.0), course(a, failed, end=2.0)).difference is not None


def test_a_state_that_is_entered_again_has_taken_no_transition() -> None:
    coverage = Coverage()
    coverage.add_transition('B', '/S', 'done')
    coverage.add_transition('B', '/S', '')
    coverage.add_behavior(BehaviorStructure(behavior='B', states=[StateStructure(path='/S', outcomes=['done', 'no'])]))
    assert next(coverage.lines()) == 'behavior B: transitions 1 of 2; never /S no'


MISSION = """
import pytest

@pytest.mark.world(motion='abstract')
def test_kitchen(world):
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run_until(world.asks('/AskGoal'), within=90)
    assert world.robot.near('kitchen')
"""


def test_the_command_line_changes_a_test(tmp_path: Path) -> None:
    (tmp_path / 'test_it.py').write_text(MISSION)
    words = ['-m', 'pytest', '-p', 'flexbt_testing.world', 'test_it.py', '--what-if', '10 resume']
    ran = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert re.search(
        r'test_kitchen\[0\]: first difference at 10\.00 s, executive\n'
        r'  as it was: leaves /Drive by done \(outcome\) at 32\.10 s\n'
        r'  changed:   RESUME refused at 10\.00 s\n'
        r'the ends\n'
        r'  as it was: at 32\.12 s in /AskGoal; the robot at \(10\.00, 2\.30\), 9\.45 m driven\n'
        r'  changed:   at 10\.\d\d s in /Drive; the robot at .*\n'
        r'  changed:   at 10\.\d\d s AssertionError: RESUME: refused, the run is not paused',
        ran.stdout,
    ), ran.stdout


def test_what_was_to_happen_after_the_end_of_a_test_is_told(tmp_path: Path) -> None:
    (tmp_path / 'test_it.py').write_text(MISSION)
    for option, told in (('--what-if', ', before 36 s'), ('--live', ' already')):
        words = ['-m', 'pytest', '-p', 'flexbt_testing.world', 'test_it.py', option, '36 stop']
        ran = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert re.search(rf'test_kitchen\[0\]: the test has ended at 32\.\d\d s{told}\n', ran.stdout), ran.stdout
        assert len(re.findall(r'=+ 1 passed', ran.stdout)) == 1, 'a child of its tear-down would tell it, too'


@pytest.mark.parametrize(
    ('state', 'told'),
    [
        ('/Drve', r'the test has ended at 32\.\d\d s, and the change was not made: it still waits'),
        # The test has ended before the operator saw that the command was applied.
        ('/Drive', r'first difference at 10\.00 s, executive\n.*\n  changed: +FORCE applied at 10\.00 s'),
    ],
)
def test_a_change_that_waits_at_the_end_of_the_test_is_told_by_its_effect(
    tmp_path: Path, state: str, told: str
) -> None:
    (tmp_path / 'test_it.py').write_text(MISSION)
    words = ['-m', 'pytest', '-p', 'flexbt_testing.world', 'test_it.py', '--what-if', f'10 force {state} failed']
    ran = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert re.search(rf'test_kitchen\[0\]: {told}', ran.stdout) and 'no difference' not in ran.stdout, ran.stdout


@pytest.mark.world(motion='abstract')
def test_a_bridge_that_ends_ends_a_world_in_real_time(world: World) -> None:
    inner, outer = Pipe()
    outer.close()
    SCHEDULER.pace = RealTime(inner, print).wait
    with pytest.raises(RuntimeError, match='the bridge between the world and the middleware has ended'):
        world.run(1.0)
    assert SCHEDULER.pace is None


@pytest.mark.world('night_watch', motion='abstract')
def test_a_change_is_read_from_words(world: World) -> None:
    time, act = read_change('1.5 drop_obstacle box 6.0 4.45', world)
    with pytest.raises(AssertionError, match='an abstract robot meets no obstacles'):
        act()
    assert time == 1.5
    for text, problem in {
        '10 gamma.stop': "there is no robot 'gamma'",
        '10 beta.kill bt_server': "a robot has no method 'kill'",
        '10 cut operator': "missing a required argument: 'seconds'; expected SECONDS METHOD ARGUMENTS",
        '10': "a world has no method ''",
        'nan stop': 'nan is no time',
        '-1 stop': '-1 is no time',
        'x stop': "could not convert string to float: 'x'",
        '1 cut operator x': "could not convert string to float: 'x'",
        "1 'stop": 'No closing quotation',
    }.items():
        with pytest.raises(ValueError, match=re.escape(problem)):
            read_change(text, world)
    world.robots['beta'].start('Night Watch', rooms='archive', home='beta_dock', partner='alpha')
    _, act = read_change('1 beta.stop', world)
    act()
    world.robots['beta'].run_until(world.ended('preempted'))
