# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that block, raise and return nonsense on a live server: each spoils its own goal, and nothing else."""

from __future__ import annotations

import math
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch, ProcessIdentity
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import Encoding, from_entry, to_entry
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_msgs.action import BtExecute, BtLoad, BtSetData
from flexbt_server.actions.tree_goals import RunningTree, TreeGoals
from flexbt_server.bt_server import BtServer
from flexbt_server.runs.run_events import RunAdopted
from flexbt_server.runs.tree_run import TickOverrunWarner
from flexbt_testing.behavior_trees import faulty_leaves as bt_faulty_leaves
from flexbt_testing.behavior_trees.faulty_leaves import Held, Work, tree_threads
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import (
    Client,
    Navigation,
    ServerWorld,
    document,
    install_nodes,
    open_server_world,
)
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

Result = BtExecute.Result
BUSY = pytest.mark.dds('a thread never waits, and is interrupted by the interpreter')


@pytest.fixture(scope='session', autouse=True)
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('site')
    install_nodes(directory, server_nodes.__name__)
    return directory


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    """Yield a server that is soon tired of waiting, and that has nothing left at the end."""
    Held.reset()
    try:
        with open_server_world(cancel_timeout=0.3) as opened:
            yield opened
    finally:
        Held.release.set()
    wait_until(lambda: not tree_threads(), 'the end of the threads')
    assert not Work.running()


def quickest_answer(world: ServerWorld) -> float:
    """Seconds for a goal, the best of a few: the machine has other things to do as well."""

    def measure() -> float:
        began = uncontended_time()
        assert world.client.execute('Other').result.code == Result.SUCCESS
        return uncontended_time() - began

    return min(measure() for _ in range(5))


def start_now(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this process count as one that has just started."""
    now = time.monotonic()
    monkeypatch.setattr(ProcessIdentity, 'started', staticmethod(lambda: now))


def test_a_server_that_is_known_to_be_gone_is_not_waited_for_as_one_that_starts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    start_now(monkeypatch)
    with open_server_world(server_timeout=0.1, start_timeout=10.0 * DEADLINE) as world:
        token = LivelinessToken(world.navigation_runtime)
        token.set_ready(True)
        world.client.load_tree('<Spin/>')
        assert world.client.execute().result.code == Result.SUCCESS
        token.remove_name('/navigation')
        wait_until(lambda: world.client.execute().result.code == Result.FAILURE, 'the end of the server is known')
        assert 'no action server' in world.client.execute().result.message


@pytest.mark.parametrize('body', ['<HeldInTick/>', pytest.param('<HeldInTick busy="1"/>', marks=BUSY), '<HeldThread/>'])
def test_a_leaf_that_never_returns_is_given_up_and_holds_up_nobody(world: ServerWorld, body: str) -> None:
    world.client.load_tree(f'<Sequence><AlwaysSuccess/>{body}</Sequence>')
    world.client.load_tree('<AlwaysSuccess/>', 'Other')
    goal = world.client.execute()
    assert Held.entered.wait(DEADLINE)
    assert quickest_answer(world) < 0.1
    assert world.client.set(to_entry('a', 1, encoding=Encoding.TEXT)).code == BtSetData.Result.SUCCESS
    began, uncontended = time.monotonic(), uncontended_time()
    goal.call.cancel(DEADLINE)
    outcome, result = goal.wait(), goal.result
    assert time.monotonic() - began >= 0.3
    assert uncontended_time() - uncontended < 1.5
    assert (outcome.status, result.code) == (GoalStatus.ABORTED, Result.ERROR)
    assert result.message.startswith('canceled by the client; not halted in time: [Held')
    assert quickest_answer(world) < 0.1
    # The tree can be run again, while the thread of the first run is still held up.
    Held.release.set()
    assert world.client.execute().result.code == Result.SUCCESS
    assert len(goal.outcomes) == 1


def test_the_path_of_a_leaf_that_does_not_return_is_the_failed_node(world: ServerWorld) -> None:
    world.client.load_tree('<Inverter><Sequence name="outer"><HeldInTick name="arm"/></Sequence></Inverter>')
    goal = world.client.execute()
    assert Held.entered.wait(DEADLINE)
    goal.call.cancel(DEADLINE)
    assert goal.result.failed_node == 'arm'
    assert '[arm] does not return' in goal.result.message


def test_a_leaf_that_does_not_return_makes_the_server_late_until_its_run_is_given_up(world: ServerWorld) -> None:
    """And then nothing that the other leaves have begun goes on."""
    watch = LivelinessWatch(world.client.runtime, names.BT_SERVER)
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load_tree('<Parallel success_count="2"><Spin/><HeldInTick name="arm"/></Parallel>')
    goal = world.client.execute()
    wait_until(lambda: '[arm] does not return' in watch.problem, 'the server late')  # a busy one may be late before
    assert not goal.ended and spin.running
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.ERROR
    wait_until(lambda: spin.statuses == {0: 'canceled'}, 'the goal of the other leaf canceled')
    wait_until(lambda: not watch.late, 'the server as before')
    Held.release.set()


def test_a_leaf_that_does_not_return_from_its_halt_is_given_up(world: ServerWorld) -> None:
    world.client.load_tree('<HeldInHalt ms="60000"/>')
    goal = world.client.execute()
    wait_until(lambda: Work.running(), 'the leaf')
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.ERROR
    assert goal.result.failed_node.startswith('HeldInHalt')


def test_a_goal_that_waits_to_take_over_a_tree_that_blocks_gets_a_run_of_its_own(world: ServerWorld) -> None:
    world.client.load_tree('<HeldInTick/>')
    old = world.client.execute()
    assert Held.entered.wait(DEADLINE)
    new = world.client.execute()
    assert new.accepted.wait(DEADLINE)
    withdrawn = world.client.execute()
    assert new.result.code == Result.CANCELED, 'the newer one has taken the place of the one that waited before'
    withdrawn.call.cancel(DEADLINE)
    assert withdrawn.result.code == Result.CANCELED, 'a goal that waits can be canceled at once'
    newest = world.client.execute()
    old.call.cancel(DEADLINE)
    assert old.result.code == Result.ERROR
    assert not newest.ended
    Held.release.set()
    assert newest.result.code == Result.SUCCESS


def test_a_goal_is_not_held_back_for_ever_by_a_thread_that_does_not_return(world: ServerWorld) -> None:
    first = '<ForceSuccess><Timeout msec="50"><HeldThread name="held"/></Timeout></ForceSuccess>'
    world.client.load_tree(f'<Sequence>{first}<Spin name="turn" error_msg="{{why}}"/></Sequence>')
    result = world.client.execute(outputs=['why']).result
    assert result.failed_node == 'turn'
    why = 'the goal was not sent, because of what continues after a halt: [held]'
    assert why in from_entry(result.outputs[0]) and why in ''.join(result.reasons)
    assert world.navigation.count(names.SPIN) == 0
    Held.release.set()
    assert world.client.execute().result.code in (Result.SUCCESS, Result.FAILURE)  # the thread is in time now, or not


def test_servers_that_start_with_this_one_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    start_now(monkeypatch)
    parameters = {'server_timeout': 1.0, 'start_timeout': DEADLINE}
    with NodeRuntime.open('bt_server', parameters=parameters) as server, NodeRuntime.open('client') as client_runtime:
        BtServer(server)
        client = Client(client_runtime)
        client.load_tree('<Sequence><Spin/><ClearEntireCostmap/></Sequence>')
        goal = client.execute()
        wait_until(lambda: any(feedback.execution_time.sec >= 1 for feedback in goal.feedback), 'the server timeout')
        with NodeRuntime.open('navigation') as navigation:
            Navigation(navigation)
            assert goal.result.code == Result.SUCCESS, goal.result.message


@pytest.mark.parametrize('body', ['<HeldInTick/>', '<HeldThread/>', '<HeldInHalt ms="60000"/>', '<NeverRests/>'])
def test_the_end_of_the_server_waits_for_no_leaf_and_tells_the_client(body: str) -> None:
    Held.reset()
    with open_server_world() as world:
        world.client.load_tree(body)
        goal = world.client.execute()
        wait_until(lambda: (goal.feedback and goal.feedback[-1].active_nodes) or Held.entered.is_set(), 'the leaf')
        began = uncontended_time()
        world.server_runtime.close()
        assert uncontended_time() - began < 1.7
        assert goal.result.code == Result.ERROR
        assert goal.result.message.startswith('the BT server is shutting down; not halted in time')
        Held.release.set()
    wait_until(lambda: not tree_threads(), 'the end of the threads')


def test_a_goal_that_takes_a_tree_over_as_the_server_ends_has_the_time_to_halt_of_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    note = TreeGoals.note

    def note_late(goals: TreeGoals, running: RunningTree, event: Any) -> None:
        if isinstance(event, RunAdopted):  # the thread of the tree has told that, and nobody has heard it yet
            goals.stop_each('the BT server is shutting down', within=0.1)
        note(goals, running, event)

    Held.reset()
    with open_server_world(cancel_timeout=60.0) as world:
        world.client.load_tree('<NeverRests/>')
        world.client.execute()
        wait_until(lambda: any(one.run.tree for one in world.server.goals.running.all()), 'the tree')
        monkeypatch.setattr(TreeGoals, 'note', note_late)
        goal = world.client.execute()
        assert goal.result.code == Result.ERROR
        assert goal.result.message.startswith('the BT server is shutting down; not halted in time')
        Held.release.set()
    wait_until(lambda: not tree_threads(), 'the end of the threads')


def seconds_to_end(site: Path, busy: int, attempt: int) -> float:
    """From SIGTERM to the end of a process with a leaf that blocks; infinite when it was forced to end."""
    path = os.pathsep.join([str(site), str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')])
    namespace = f'/blocked_{os.getpid()}_{busy}_{attempt}'
    command = [sys.executable, '-m', 'flexbt_server.bt_server', '--ros-args', '-r', f'__ns:={namespace}']
    environment = os.environ | {'PYTHONPATH': path}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            with NodeRuntime.open('client', namespace=namespace) as client:
                user = Client(client)
                assert user.load(xml=document(f'<HeldInTick busy="{busy}"/>')).code == BtLoad.Result.SUCCESS
                goal = user.execute()
                wait_until(lambda: goal.feedback, 'the running tree')
                process.send_signal(signal.SIGTERM)
                began = uncontended_time()
                _, told = process.communicate(timeout=DEADLINE)
                took = uncontended_time() - began
        finally:
            process.kill()
    if process.returncode == 0 or 'after the stop; leaving it' in told:  # it was left before it was given up, or after
        return took
    # By the process itself, or by the watchdog of the fault handler.
    assert process.returncode == 1 and re.search(r'did not come to an end within|^Timeout \(', told, re.MULTILINE), told
    return math.inf


@pytest.mark.dds('the server is a process, which a signal ends')
@pytest.mark.parametrize('busy', [0, 1])
def test_the_process_ends_in_time_although_a_leaf_blocks(site: Path, busy: int) -> None:
    # The machine may have other things to do as well: one of three is in time.
    assert any(seconds_to_end(site, busy, attempt) < 2.0 for attempt in range(3))


@pytest.mark.parametrize('kind', bt_faulty_leaves.FAULTS)
def test_whatever_a_leaf_raises_ends_its_goal_and_names_it(world: ServerWorld, kind: str) -> None:
    world.client.load_tree(f'<RaisesInTick kind="{kind}" name="tick"/>', 'Tick')
    world.client.load_tree(f'<RaisesInThread kind="{kind}" name="thread"/>', 'Thread')
    world.client.load_tree(
        f'<Parallel failure_count="1"><RaisesInHalt kind="{kind}" ms="60000" name="halt"/>'
        '<Delay delay_msec="5"><AlwaysFailure/></Delay></Parallel>',
        'Halt',
    )
    for tree in ('Tick', 'Thread', 'Halt'):
        for _ in range(2):
            result = world.client.execute(tree).result
            assert (result.code, result.failed_node) == (Result.ERROR, tree.lower()), result.message
            assert 'fault in the BT server' not in result.message
    goal = world.client.execute('Halt')
    goal.call.cancel(DEADLINE)
    goal.wait()


def test_what_is_no_status_ends_the_goal_and_names_the_leaf(world: ServerWorld) -> None:
    for what in bt_faulty_leaves.NONSENSE:
        world.client.load_tree(f'<Sequence><AlwaysSuccess/><Returns what="{what}" name="leaf"/></Sequence>')
        result = world.client.execute().result
        assert (result.code, result.failed_node) == (Result.ERROR, 'leaf'), (what, result.message)


def test_scripts_that_raise_while_a_tree_halts_hide_nothing(world: ServerWorld) -> None:
    """Neither by what the run ended, nor one another."""
    halted = [f'<AlwaysSuccess name="halted {key}" _onHalted="{key} = 1"/>' for key in 'ab']
    body = f'<Sequence>{"".join(halted)}{{}}</Sequence>'
    leaf = '<AlwaysSuccess name="cause" _onSuccess="c = 1"/>'
    for last, shown, reason in ((leaf, 'cause', '_onSuccess'), ('<AlwaysFailure/>', 'AlwaysFailure::4', 'FAILURE')):
        world.client.load_tree(body.format(last))
        result = world.client.execute().result
        assert (result.code, result.failed_node) == (Result.ERROR, shown), result.message
        assert reason in result.reasons[0]
        told = [result.message.index(part) for part in (reason, 'while halting', '[halted a]', '[halted b]')]
        assert told == sorted(told), result.message
    world.client.load_tree(body.format('<AlwaysSuccess/>'))
    result = world.client.execute().result
    assert (result.code, result.failed_node) == (Result.ERROR, 'halted a')
    assert result.message.startswith('while halting')


@pytest.mark.parametrize(
    'reason', ['a\ud800b', 'a\0b', 'x' * 3_000_000, '\x1b[31mred', ''], ids=['surrogate', 'NUL', 'long', 'ESC', 'none']
)
def test_a_reason_of_any_text_reaches_the_client(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch, reason: str
) -> None:
    monkeypatch.setattr(bt_faulty_leaves.Fails, 'reason', reason)
    world.client.load_tree('<Fails name="leaf"/>')
    result = world.client.execute().result
    assert (result.code, result.failed_node) == (Result.FAILURE, 'leaf'), result.message[:300]
    assert len(result.message) < 20_000


@BUSY
def test_entries_may_change_at_any_moment_while_trees_tick_and_clients_read(world: ServerWorld) -> None:
    world.client.load_tree(
        '<Parallel success_count="1"><Scribbles count="20000"/><KeepRunningUntilFailure><ForceSuccess>'
        '<Sequence><Script code="mine := 1; other := mine + 1"/>'
        '<ForceSuccess><SetBlackboard value="{text}" output_key="copy"/></ForceSuccess></Sequence>'
        '</ForceSuccess></KeepRunningUntilFailure></Parallel>'
    )
    goal = world.client.execute(inputs={'text': 'none'}, outputs=['scribbled', 'other'])
    reads = 0
    while not goal.ended:
        world.client.get()
        reads += 1
    assert reads
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert [from_entry(entry) for entry in goal.result.outputs] == [20000, 2]


def test_a_machine_without_threads_refuses_the_goal_and_goes_on(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.client.load_tree('<AlwaysSuccess/>')
    start = threading.Thread.start

    def refuse(thread: threading.Thread) -> None:
        if thread.name.startswith('tree '):
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, 'start', refuse)
    for _ in range(2):
        result = world.client.execute().result
        assert result.code == Result.ERROR and "can't start new thread" in result.message
        assert not world.server.control._debugger._runs  # what reads the events of the run has its end
    monkeypatch.undo()
    assert world.client.execute().result.code == Result.SUCCESS


@pytest.mark.dds('a process whose files the system limits, which the middleware needs, too')
def test_a_process_without_free_file_descriptors_refuses_files_and_goes_on(tmp_path: Path) -> None:
    with open_server_world(allowed_directories=[str(tmp_path)]) as world:
        file = tmp_path / 'tree.xml'
        file.write_text(document('<AlwaysSuccess/>', 'FromFile'))
        world.client.load_tree('<InThread ms="5"/>')
        assert world.client.execute().result.code == Result.SUCCESS
        limits = resource.getrlimit(resource.RLIMIT_NOFILE)
        lowest_free = os.dup(0)
        os.close(lowest_free)
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free, limits[1]))
        try:
            loaded = world.client.load(str(file))
            executed = world.client.execute(str(file)).result
            running = world.client.execute().result
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        assert loaded.code == BtLoad.Result.FAILURE
        assert 'Too many open files' in loaded.message, loaded.message
        assert executed.code == Result.ERROR and 'Too many open files' in executed.message
        assert running.code == Result.SUCCESS, 'what is loaded runs on'
        assert world.client.execute(str(file)).result.code == Result.SUCCESS


def test_ticks_that_take_too_long_are_told_with_numbers_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_server_world(tick_rate=100.0) as world:
        told: list[str] = []
        logger = world.server_runtime.node.get_logger()
        monkeypatch.setattr(type(logger), 'warning', lambda self, message, **_: told.append(message))
        world.client.load_tree(
            '<Repeat num_cycles="25"><Sequence><Runs ms="1"/><Blocking ms="60"/></Sequence></Repeat>'
        )
        began = time.monotonic()
        assert world.client.execute().result.code == Result.SUCCESS
        took = time.monotonic() - began
    reports = [
        re.fullmatch(
            r'tree \[Main\]: (\d+) ticks took longer than the period of 0\.010 s \(parameter tick_rate\), '
            r'the longest (\d+\.\d{3}) s; no leaf should block',
            message,
        )
        for message in told
        if 'longer than the period' in message
    ]
    # The 24 blocks after the first report take 1.4 s at least; what a busy machine makes late counts too.
    assert 2 <= len(reports) <= 1 + int(took)
    numbers = [(int(report[1]), float(report[2])) for report in reports if report is not None]
    assert len(numbers) == len(reports), told
    assert numbers[0][0] == 1, 'the first is told at once'
    assert 0.06 <= max(longest for _, longest in numbers) <= took


def test_a_tree_that_keeps_waking_itself_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_server_world() as world:
        told: list[str] = []
        logger = world.server_runtime.node.get_logger()
        monkeypatch.setattr(type(logger), 'warning', lambda self, message, **_: told.append(message))
        world.client.load_tree('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>')
        goal = world.client.execute()
        wait_until(lambda: 'tree [Main] woke itself 10000 times in one tick; it may never end' in told, lambda: told)
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.CANCELED


def test_a_report_of_ticks_that_take_too_long_is_of_those_since_the_last_one() -> None:
    now = 0.0
    overruns = TickOverrunWarner('Main', 0.010, lambda: now)
    told = []
    for took, pause in ((0.010, 0.0), (0.02, 0.0), (0.06, 0.0), (0.02, 0.0), (0.005, 0.905), (0.04, 0.0)):
        now += took
        told += [warning] if (warning := overruns.note(took)) else []
        now += pause
    assert [message.split(': ')[1].split(' took')[0] for message in told] == ['1 ticks', '3 ticks']
    assert ['the longest 0.020 s' in told[0], 'the longest 0.060 s' in told[1]] == [True, True]


def test_the_rate_of_ticks_is_that_of_the_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks: list[float] = []
    uncontended: list[float] = []

    def tick(self: Any) -> Any:
        uncontended.append(uncontended_time())
        ticks.append(time.monotonic())
        time.sleep(0.02)  # counts as a part of the period
        return NodeStatus.SUCCESS

    monkeypatch.setattr(bt_faulty_leaves.Blocking, 'tick', tick)
    with open_server_world(tick_rate=20.0) as world:
        world.client.load_tree(
            '<Parallel success_count="2"><Runs ms="60000"/><KeepRunningUntilFailure><Blocking/>'
            '</KeepRunningUntilFailure></Parallel>'
        )
        goal = world.client.execute()
        wait_until(lambda: len(ticks) >= 42, 'the ticks')
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.CANCELED
    # All together: on a busy machine some come late, and the next one early.
    assert ticks[41] - ticks[0] > 40 * 0.05
    assert uncontended[41] - uncontended[0] < 42 * 0.05


def test_a_goal_for_a_tree_that_runs_is_answered_at_once(world: ServerWorld) -> None:
    world.client.load_tree('<Runs ms="60000"/>')
    goals = [world.client.execute()]
    wait_until(lambda: goals[0].feedback, 'the running tree')
    times = []
    for _ in range(5):
        began = uncontended_time()
        goals.append(SentGoal(world.client.executor, BtExecute.Goal(behavior_tree='Main')))
        assert goals[-1].accepted.wait(DEADLINE)
        times.append(uncontended_time() - began)
    assert min(times) < 0.05
    wait_until(lambda: goals[-1].feedback, 'the takeover')
    goals[-1].call.cancel(DEADLINE)
    assert [goal.result.code for goal in goals] == [Result.CANCELED] * 6
