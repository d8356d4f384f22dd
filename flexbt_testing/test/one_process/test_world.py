# SPDX-License-Identifier: BSD-3-Clause
"""Missions of whole robots in one process, as users test theirs."""

from __future__ import annotations

import gc
import logging
import math
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
import weakref
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.logging import LoggingSeverity, get_logger_effective_level, set_logger_level
from std_msgs.msg import String
from std_srvs.srv import Trigger

from flexbt_common.runtime.node_runtime import run_node
from flexbt_console.errors import ConsoleError
from flexbt_core.errors import FlexbtError
from flexbt_msgs.srv import SetFault
from flexbt_testing.one_process.boundary import BOUNDARY, OutsideWorldError
from flexbt_testing.one_process.coverage import Coverage
from flexbt_testing.one_process.graph import DOMAIN
from flexbt_testing.one_process.programs import Program, named_programs
from flexbt_testing.one_process.scheduler import COLLECTION, SCHEDULER, Process, StuckWorldError
from flexbt_testing.one_process.world import World


@pytest.fixture
def bare() -> Iterator[World]:
    """Yield a world without a robot."""
    idle = Program('', 'idle', main=lambda: time.sleep(1e6))
    with World(0, [idle]) as made:
        yield made


def test_the_robot_gets_to_the_kitchen(world: World) -> None:
    world.start('Navigate', autonomy='High')
    world.answer('/AskGoal', 'kitchen')
    world.run_until(world.asks('/AskGoal'), within=90)
    assert world.robot.near('kitchen', 0.15)
    assert world.states == ['/AskGoal', '/Drive', '/AskGoal']
    assert world.transitions[-2:] == [('/AskGoal', 'received'), ('/Drive', 'done')]
    assert world.blackboard('goal')['pose']['position']['x'] == pytest.approx(world.place('kitchen').x)
    assert world.asks('/AskGoal') and not world.ended()
    world.decline('/AskGoal')
    world.run_until(lambda _view: world.ended())
    assert world.ended('finished')(world.view) and not world.ended('failed')(world.view)
    assert repr(world.ended('failed')) == 'the end of the run by failed'
    assert world.outcome == 'finished'


def test_a_bt_server_that_dies_stops_the_robot(world: World) -> None:
    world.start('Navigate', autonomy='High')
    world.answer('/AskGoal', 'kitchen')
    world.run(5.0)
    assert world.robot.length > 0.5
    world.kill('bt_server')
    world.run(2.0)
    assert world.robot.at_rest
    world.restart('bt_server')
    world.run(10.0)
    world.stop()


def test_a_box_in_the_way_is_driven_around(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'corridor')
    world.drop_obstacle('box', 6.0, 4.45, 0.3, 0.3)
    world.at(world.now + 20.0, lambda: world.take_away('box'))
    world.run_until(world.asks('/AskGoal'), within=120)
    assert world.robot.near('corridor')
    assert world.robot.length > 10.4


@pytest.mark.world(motion='abstract', limit=3.0)
def test_a_world_ends_at_the_limit_of_its_mark(world: World) -> None:
    world.run(1.5)
    with pytest.raises(StuckWorldError, match=r'passed its limit, \d\.\d+ s after its begin; .*limit=7200'):
        world.run(2.0)


@pytest.mark.seeds(2)
@pytest.mark.world(motion='abstract')
def test_pauses_faults_and_forced_outcomes(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run(5.0)
    world.pause()
    world.run(1.0)
    length = world.robot.length
    world.run(1.0)
    assert world.robot.length == length
    world.resume()
    world.run(5.0)
    assert world.robot.length > length
    world.fail_goal('follow_path', 60)
    world.run_until(lambda view: '/Drive' in world.decisions)
    assert world.decisions['/Drive'].outcome == 'failed'
    world.choose('/Drive', 'canceled')
    world.answer('/AskGoal', 'office')
    world.force('/Drive', 'failed')
    world.run_until(world.asks('/AskGoal'))
    assert [outcome for path, outcome in world.transitions if path == '/Drive'] == ['canceled', 'failed']


@pytest.mark.world(motion='abstract')
def test_a_fault_of_an_abstract_robot_lasts_until_it_is_over_or_ended(world: World) -> None:
    def ask(**request: Any) -> None:
        fault = SetFault.Request(fault='server_fails', parameters='{server: follow_path, error_code: 100}', **request)
        assert world.ask(SetFault, 'set_fault', fault).success

    def has_failed() -> bool:
        driven = world.robot.length
        world.start('Navigate', autonomy='Low')
        world.answer('/AskGoal', 'kitchen')
        world.run(1.0)
        world.stop()
        world.run(1.0)
        return world.robot.length == driven

    assert not has_failed()
    for seconds in (-1.0, math.nan):
        with pytest.raises(AssertionError, match='give times that are not negative'):
            world.fail_goal('follow_path', seconds)
    world.fail_goal('follow_path', 1.0)
    world.run(0.9)
    world.fail_goal('follow_path', 5.0)
    world.run(0.5)
    assert has_failed(), 'the end of the first one has ended the second one'
    world.run(5.0)
    ask(after=0.5)
    world.run(20.0)
    assert has_failed()
    ask(clear=True)
    assert not has_failed()


@pytest.mark.world(motion='abstract')
def test_a_drive_of_an_abstract_robot_takes_its_length_divided_by_its_speed_however_often_it_is_planned(
    world: World,
) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run_until(lambda view: view.active_paths == ('/Drive',))
    began = world.now
    world.run_until(world.asks('/AskGoal'))
    assert world.robot.length / (world.now - began) == pytest.approx(0.3, rel=0.01)


@pytest.mark.world(motion='abstract')
def test_an_operator_without_a_link_misses_nothing(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run(1.0)
    began = world.now
    world.cut('operator', 60.0)
    world.run_while(lambda: world.transitions[-1] != ('/Drive', 'done'), 'the drive')
    assert world.now - began < 58.0
    assert not world.view.live
    assert world.view.active_paths == ('/Drive',)
    world.run_until(lambda view: view.live)
    assert 60.0 <= world.now - began < 63.0
    world.answer('/AskGoal', 'dock')
    world.run_until(world.asks('/AskGoal'))
    assert world.robot.near('dock')


def test_a_program_may_end_its_own_process(world: World) -> None:
    response = world.ask(SetFault, 'set_fault', SetFault.Request(fault='server_dies'))
    assert response.success, response.message
    world.run(1.0)
    assert world.processes['navigation'].exit_code == -9
    assert [name for name, process in world.processes.items() if not process.is_alive] == ['navigation']


@pytest.mark.world(motion='abstract')
def test_a_question_is_open_until_an_answer_is_accepted(world: World) -> None:
    world.start('Navigate')
    with pytest.raises(ConsoleError, match="'nowhere' is neither a place"):
        world.answer('/AskGoal', 'nowhere')
    with pytest.raises(ConsoleError, match="no outcome 'left'"):
        world.choose('/AskGoal', 'left')
    world.answer('/AskGoal', 'kitchen')
    waits: dict[Callable[[Any], object], str] = {
        world.asks('/AskGaol'): "a question of /AskGaol (there is no such state; did you mean '/AskGoal'?): not within",
        world.ended('finnished'): "the end of the run by finnished (the behavior has no such outcome; did you mean '",
        lambda _view: False: 'the condition: not within 1 s; the executive is RUNNING in /Drive',
    }
    for condition, problem in waits.items():
        with pytest.raises(AssertionError) as told:
            world.run_until(condition, within=1.0)
        assert str(told.value).startswith(problem)


def test_the_coverage_has_the_outcomes_by_which_behaviors_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coverage = Coverage()
    monkeypatch.setattr('flexbt_testing.one_process.world.COVERAGE', coverage)
    with World(0, named_programs('', tmp_path, tmp_path, motion='abstract')) as world:
        world.start('Navigate')
        world.stop()
        world.run_until(world.ended('preempted'))
        assert 'behavior Navigate: outcomes 0 of 2; never finished, failed' in coverage.lines()
        world.start('Navigate')
        world.decline('/AskGoal')
        world.run_until(world.ended('finished'))
        assert 'behavior Navigate: outcomes 1 of 2; never failed' in coverage.lines()


@pytest.mark.world(motion='abstract')
def test_an_argument_may_be_a_value(world: World) -> None:
    with pytest.raises(AssertionError, match='there is no level 2; there are Off, Low, High, Full'):
        world.start('Inspection', 2)  # type: ignore[arg-type]
    world.start('Inspection', duration=3.0)
    assert world.view.running


@pytest.mark.world(motion='abstract')
def test_what_happens_at_a_time_may_fail_the_test(world: World) -> None:
    world.at(world.now + 1.0, lambda: world.kill('nobody'))
    with pytest.raises(AssertionError, match="there is no process 'nobody'"):
        world.run(60.0)
    assert world.now < 10.0


def test_a_world_that_does_not_get_ready_leaves_nothing_behind() -> None:
    before = dict(os.environ)
    world = World(0, [Program('', 'onboard_executive', main=lambda: time.sleep(1e6))])
    with pytest.raises(AssertionError, match=r'is ready \(missing: the executive\): not within 180 s'), world:
        pass
    assert os.environ == before
    assert not world.home.exists()
    assert World.current is None
    assert world.processes['onboard_executive'].exit_code == -signal.SIGTERM
    subprocess.run(['true'], check=True)


@pytest.mark.parametrize(
    ('ends', 'code'),
    [
        (lambda: None, 0),
        (lambda: 2, 2),
        (lambda: sys.exit(), 0),
        (lambda: sys.exit(0), 0),
        (lambda: sys.exit(3), 3),
        (lambda: sys.exit('why'), 1),
        (lambda: [][0], 1),
    ],
)
def test_a_program_has_the_exit_code_that_its_process_would_have(
    bare: World, ends: Callable[[], object], code: int
) -> None:
    program = bare.launch(ends)
    bare.run_while(lambda: program.is_alive, 'the program')
    assert program.exit_code == code


def test_the_end_of_a_program_ends_what_it_had(bare: World) -> None:
    kept: list[Any] = []
    lock = threading.Lock()

    def leave() -> None:
        lock.acquire()
        rclpy.init()
        kept.append(rclpy.create_node('left'))
        later = threading.Timer(5.0, kept.append, ['still there'])
        later.daemon = True
        later.start()

    def names() -> list[str]:
        return bare.observer.node.get_node_names()

    bare.launch(leave)
    bare.run(1.0)
    assert lock.acquire(timeout=1.0)
    assert 'left' in names()
    bare.run_while(lambda: 'left' in names(), 'the middleware')
    assert len(kept) == 1


def test_a_program_that_spins_without_waiting_does_not_hold_the_clock(bare: World) -> None:
    heard: list[str] = []

    def poll() -> None:
        rclpy.init()
        node = rclpy.create_node('polling')
        node.create_subscription(String, 'words', lambda message: heard.append(message.data), 10)
        while not heard:
            rclpy.spin_once(node, timeout_sec=0)

    program = bare.launch(poll)
    publisher = bare.observer.node.create_publisher(String, 'words', 10)
    bare.run_while(lambda: not publisher.get_subscription_count(), 'the program')
    bare.run(0.5)
    publisher.publish(String(data='hello'))
    bare.run_while(lambda: program.is_alive, 'the program')
    assert heard == ['hello']


def test_the_log_of_a_process_is_told_by_itself(bare: World) -> None:
    told: list[tuple[Process, str]] = []

    def talk() -> None:
        rclpy.init()
        node = rclpy.create_node('talker')
        while True:
            node.get_logger().info('hello')
            time.sleep(1.0)

    DOMAIN.on_message = lambda process, topic, _sample: told.append((process, topic))
    first = bare.launch(talk)
    bare.run(2.5)
    bare.kill('talk')
    second = bare.launch(talk)
    bare.run(2.5)
    bare.kill('talk')
    assert [process for process, topic in told if topic == '/rosout'] == [first] * 3 + [second] * 3


def test_a_further_program_may_have_parameters(bare: World) -> None:
    process = bare.launch(Program('flexbt_onboard', 'stop_guard', {'motion_actions': ['spin']}, 'base'))
    bare.run(1.0)
    assert bare.processes['base/stop_guard'] is process and process.is_alive
    with pytest.raises(AssertionError, match='base/stop_guard runs already'):
        bare.launch(Program('flexbt_onboard', 'stop_guard', namespace='base'))
    told = r"^home/stop_guard: there is no parameter 'motion_action', .*did you mean 'motion_actions'"
    with pytest.warns(UserWarning, match=told):
        bare.launch(Program('flexbt_onboard', 'stop_guard', {'motion_action': ['spin']}, 'home'))
        bare.run(1.0)
    bare.launch(Program('flexbt_onboard', 'stop_guard', {'motion_actions': ['a b']}))
    bare.run(1.0)
    assert bare.processes['stop_guard'].exit_code == 1, 'it has got the parameter'


@pytest.mark.world('night_watch', motion='abstract', speed=2.0)
def test_a_demonstration_with_two_robots(world: World) -> None:
    for name, mission in world.robots.items():
        other = 'beta' if name == 'alpha' else 'alpha'
        mission.start('Night Watch', rooms='lab' if name == 'alpha' else 'archive', home=f'{name}_dock', partner=other)
    world.run(20.0)
    assert all(('/GetMap', 'received') in mission.transitions for mission in world.robots.values()), world.transitions
    assert all(mission.robot.length > 1.0 for mission in world.robots.values())
    world.robots['beta'].stop()


@pytest.mark.world('nav2_robot')
def test_a_client_program_of_nav2(world: World) -> None:
    program = world.launch('flexbt_demo_behaviors/deliveries')
    world.run_until(world.asks('/Ask'), within=120)
    assert world.robot.near('shelf')
    world.choose('/Ask', 'home')
    world.run_while(lambda: program.is_alive, 'the program')
    assert program.exit_code == 0
    assert world.robot.near('dock')


@pytest.mark.world('nav2_robot', motion='abstract')
def test_a_client_program_of_nav2_that_is_terminated_as_the_robot_drives_ends(world: World) -> None:
    program = world.launch('flexbt_demo_behaviors/deliveries')
    world.run_while(lambda: world.robot.at_rest, 'the program')
    world.terminate('deliveries')
    world.run(0.5)
    assert program.exit_code == 143


def test_programs_with_rclpy_have_each_their_default_context(world: World) -> None:
    heard: list[str] = []

    def serve() -> None:
        rclpy.init()
        node = rclpy.create_node('server')

        def answer(_request: Any, response: Any) -> Any:
            response.message = f'{node.get_name()} answers'
            return response

        node.create_service(Trigger, 'ask', answer)
        rclpy.spin(node)

    def ask() -> None:
        rclpy.init()
        node = rclpy.create_node('client')
        client = node.create_client(Trigger, 'ask')
        while not client.wait_for_service(timeout_sec=1.0):
            pass
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(node, future)
        heard.append(future.result().message)
        node.destroy_node()
        rclpy.shutdown()

    first = world.launch(ask)
    world.launch(serve)
    world.run_while(lambda: first.is_alive, 'the client')
    assert heard == ['server answers']
    assert first.exit_code == 0
    world.kill('serve')


LEAVING: dict[str, Callable[[], object]] = {
    'socket.connect': lambda: socket.socket().connect(('127.0.0.1', 9)),
    'socket.getaddrinfo': lambda: urllib.request.urlopen('http://weather.invalid'),
    'socket.bind': lambda: socket.create_server(('127.0.0.1', 0)),
    'socket.sendto': lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'x', ('127.0.0.1', 9)),
    'socket.socketpair': socket.socketpair,
    'subprocess.Popen': lambda: subprocess.run(['true'], check=True),
    'os.kill': lambda: os.kill(os.getpid(), signal.SIGTERM),
    'signal.alarm': lambda: signal.alarm(1),
    'signal.setitimer': lambda: signal.setitimer(signal.ITIMER_REAL, 1.0),
    'os.rename': lambda: Path('/var/tmp/of_a_world').rename('/var/tmp/other'),  # noqa: S108
    'os.remove': lambda: Path('/var/tmp/of_a_world').unlink(missing_ok=True),  # noqa: S108
    'os.mkdir': lambda: Path('/var/tmp/of_a_world').mkdir(),  # noqa: S108
    'opens': lambda: Path('/var/tmp/of_a_world').write_text('x'),  # noqa: S108
}


@pytest.mark.parametrize('what', LEAVING)
@pytest.mark.world(motion='abstract')
def test_code_that_leaves_the_world_is_stopped(world: World, tmp_path: Path, what: str) -> None:
    errors: list[Exception] = []

    def leave() -> None:
        (tmp_path / 'allowed').write_text('x')
        (Path.home() / 'allowed').write_text('x')
        (Path.home() / 'allowed').rename(Path.home() / 'moved')
        (tmp_path / 'own' / 'inner').mkdir(parents=True)
        shutil.rmtree(tmp_path / 'own')
        Path('/tmp').mkdir(exist_ok=True)  # noqa: S108 - which is there
        try:
            LEAVING[what]()
        except OutsideWorldError as error:
            errors.append(error)

    program = world.launch(leave)
    world.run_while(lambda: program.is_alive, 'the program')
    [error] = errors
    assert re.match(rf'leave .*{what}.*not in a simulated world\. Use instead: ', str(error)), error
    assert what in BOUNDARY.crossings[0]
    subprocess.run(['true'], check=True)  # the test may


def test_a_failed_test_says_what_the_robot_did_and_how_to_repeat_it(tmp_path: Path) -> None:
    (tmp_path / 'pytest.ini').write_text('[pytest]\naddopts = -p flexbt_testing.world\n')
    (tmp_path / 'test_it.py').write_text(
        'import time\n'
        'import pytest\n'
        'from flexbt_testing.world import Program\n'
        'def never():\n'
        "    return [Program('', 'onboard_executive', main=lambda: time.sleep(1e6))]\n"
        "@pytest.mark.world('test_it:never')\n"
        'def test_that_is_not_ready(world):\n'
        '    pass\n'
        "@pytest.mark.world(motion='abstract')\n"
        '@pytest.mark.seeds(2)\n'
        'def test_it(world):\n'
        "    world.start('Navigate')\n"
        "    world.answer('/AskGoal', 'kitchen')\n"
        '    world.run(3.0)\n'
        "    assert world.robot.near('kitchen') or not world.seed\n"
    )

    def run(command: list[str]) -> str:
        ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ran.returncode == 1, ran.stdout + ran.stderr
        return ran.stdout

    told = run([sys.executable, '-m', 'pytest', '--mission-coverage'])
    assert re.search(r'1 failed, 1 passed, (\d+ warnings, )?1 error', told)
    assert re.search(r'^again: .*FLEXBT_SEED=0 .*is_not_ready\[0\]', told, re.MULTILINE)
    assert 'operator: answers /AskGoal with kitchen' in told
    assert 'm from kitchen, more than 0.3 m' in told
    assert 'behavior Navigate: transitions 2 of 8; never /LoadTree failed, ' in told
    [again] = re.findall(r"^again: (.*FLEXBT_SEED=1 .*'test_it.py::test_it\[1\]')$", told, re.MULTILINE)
    repeated = run(['env', *shlex.split(again.replace('python3', sys.executable))])
    assert '1 failed' in repeated
    story = [line for line in told.splitlines() if ' s  ' in line]
    assert story and story == [line for line in repeated.splitlines() if ' s  ' in line]


@pytest.mark.parametrize(
    ('name', 'motion', 'reason'),
    [
        ('nightwatch', 'full', "there is no world 'nightwatch'; did you mean 'night_watch'? Give a demonstration ("),
        ('missing.yaml', 'full', 'missing.yaml: not a file name; expected package/relative/path'),
        ('no_module:programs', 'full', "the world 'no_module:programs': there is no module 'no_module'"),
        ('json:load', 'full', "the world 'json:load' has no option 'speed'"),
        ('json:laods', 'full', "the world 'json:laods': json has no function 'laods'; did you mean 'loads'?"),
        ('', 'fast', "there is no motion 'fast'; choose 'full' or 'abstract'"),
    ],
)
def test_a_wrong_name_is_told(tmp_path: Path, name: str, motion: str, reason: str) -> None:
    with pytest.raises((LookupError, FlexbtError), match=re.escape(reason)):
        named_programs(name, tmp_path, tmp_path, motion, **({'speed': 2.0} if name == 'json:load' else {}))


MARKS = """
import os
import signal
import pytest
from std_msgs.msg import String

@pytest.mark.seeds(count=2)
@pytest.mark.world(name='nav2_robot', motion='abstract')
def test_by_names(world):
    assert 'abstract_robot' in world.processes

@pytest.mark.world('nav2_robot', 'abstract')
def test_by_place(world):
    assert 'abstract_robot' in world.processes
    with pytest.raises(AssertionError, match='must be of type'):
        String().data = 5

@pytest.mark.world(motion='abstract')
def test_that_is_interrupted(world):
    world.at(world.now + 1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    world.run(100.0)
    print('was not interrupted')
"""


def test_marks_fields_and_interrupts(tmp_path: Path) -> None:
    (tmp_path / 'test_marks.py').write_text(MARKS)
    (tmp_path / 'test_seeds.py').write_text('import pytest\n@pytest.mark.seeds(0)\ndef test_it(world):\n    pass\n')
    words = [sys.executable, '-m', 'pytest', '-s', '-p', 'flexbt_testing.world', '--continue-on-collection-errors', '.']
    environment = {name: value for name, value in os.environ.items() if name != 'ROS_PYTHON_CHECK_FIELDS'}
    ran = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert 'the mark seeds(0) needs a number of seeds from 1' in ran.stdout
    assert re.search(r'^=+ 3 passed, (\d+ warnings, )?1 error', ran.stdout, re.MULTILINE), ran.stdout + ran.stderr
    assert 'KeyboardInterrupt' in ran.stdout
    assert 'was not interrupted' not in ran.stdout


def test_a_world_collects_its_garbage_at_times_of_its_own(bare: World) -> None:
    class Circle:
        def __init__(self) -> None:
            self.own = self

    assert not gc.isenabled()
    gone = weakref.ref(Circle())
    bare.run(60.0)
    assert gone() is not None
    before = SCHEDULER.switches
    while gone() is not None:
        assert SCHEDULER.switches - before < 2 * COLLECTION
        time.sleep(0.0)
        threading.Thread(target=lambda: None).start()


TWICE = """
import hashlib
from flexbt_testing.one_process.world import World
from flexbt_testing.one_process.scheduler import SCHEDULER

for _ in range(2):
    made, hash = World(5), hashlib.sha256()
    SCHEDULER.trace = lambda task, now: hash.update(b'%d %d;' % (task.id, now))
    with made:
        print(hash.hexdigest())
"""


def test_the_first_world_of_an_interpreter_is_as_all_later_ones() -> None:
    """It loads the compiled loops of the robot."""
    ran = subprocess.run([sys.executable, '-c', TWICE], capture_output=True, text=True, check=True)
    first, second = ran.stdout.split()
    assert first == second


def test_what_a_program_changes_of_the_interpreter_ends_with_it() -> None:
    handlers, folder = logging.getLogger().handlers[:], Path.cwd()

    def warn() -> None:
        os.chdir(Path.home())
        set_logger_level('chatty', LoggingSeverity.DEBUG)
        run_node('warning', lambda _runtime: logging.getLogger('library').warning('beware'), [])

    with World(0, [Program('', 'idle', main=partial(run_node, 'idle', lambda _runtime: None, []))]) as world:
        world.launch(warn)
        world.run(2.0)
        assert [(one[1].name, one[3], one[4]) for one in DOMAIN.log] == [('warn', 'warning', 'library: beware')]
        world.kill('warn')
    with World(0, [Program('', 'idle', main=lambda: None)]):
        assert get_logger_effective_level('chatty') == LoggingSeverity.INFO
    assert logging.getLogger().handlers == handlers
    assert Path.cwd() == folder


def test_a_topic_of_the_test_reaches_a_program(world: World) -> None:
    got: list[str] = []

    def listen() -> None:
        rclpy.init()
        node = rclpy.create_node('listener')
        node.create_subscription(String, 'words', lambda message: got.append(message.data), 10)
        rclpy.spin(node)

    world.launch(listen)
    publisher = world.observer.node.create_publisher(String, 'words', 10)
    world.run_while(lambda: not publisher.get_subscription_count(), 'the listener')
    publisher.publish(String(data='hello'))
    world.run_while(lambda: not got, 'the listener')
    world.kill('listen')


FLEXBE_BEHAVIOR = """
from flexbe_core import Autonomy, Behavior, EventState, OperatableStateMachine
from flexbe_states.operator_decision_state import OperatorDecisionState


class SpinState(EventState):
    '''A state that calls rclpy and the clock of Python, as states do.'''

    def __init__(self, seconds):
        super().__init__(outcomes=['done'])
        self._seconds = seconds

    def on_enter(self, userdata):
        self._end = self._node.get_clock().now().nanoseconds + 1e9 * self._seconds

    def execute(self, userdata):
        if self._node.get_clock().now().nanoseconds >= self._end:
            return 'done'


class ChooseSM(Behavior):

    def __init__(self, node):
        super().__init__()
        self.name = 'Choose'
        OperatableStateMachine.initialize_ros(node)
        SpinState.initialize_ros(node)
        OperatorDecisionState.initialize_ros(node)

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add('Spin', SpinState(2.0), transitions={'done': 'Ask'})
            OperatableStateMachine.add(
                'Ask', OperatorDecisionState(outcomes=['yes', 'no'], hint='well?', suggestion='yes'),
                transitions={'yes': 'finished', 'no': 'failed'}, autonomy={'yes': Autonomy.Full, 'no': Autonomy.Full})
        return machine
"""


def test_a_behavior_of_flexbe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = 'flexbe_of_world'
    for name, text in {
        f'share/ament_index/resource_index/packages/{package}': '',
        f'share/{package}/package.xml': f'<package format="3"><name>{package}</name><version>1.0.0</version>'
        '<export><flexbe_behaviors/><build_type>ament_cmake</build_type></export></package>',
        f'lib/{package}/manifest/choose.xml': f'<behavior name="Choose"><executable package_path="{package}.choose_sm" '
        'class="ChooseSM"/><author/><date/><description/></behavior>',
        f'python/{package}/__init__.py': '',
        f'python/{package}/choose_sm.py': FLEXBE_BEHAVIOR,
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=':')
    monkeypatch.syspath_prepend(str(tmp_path / 'python'))
    for answer, outcome in (('yes', 'finished'), ('no', 'failed')):
        with World(1, named_programs('', tmp_path, tmp_path, 'abstract'), writable=[tmp_path]) as world:
            world.start('Choose')
            before = world.now
            world.run_until(world.asks('/Ask'))
            assert world.now - before > 1.5
            assert world.decisions['/Ask'].outcome == 'yes'
            world.choose('/Ask', answer)
            world.run_until(world.ended(outcome))
            assert world.transitions == [('/Spin', 'done'), ('/Ask', answer)]
