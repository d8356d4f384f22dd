# SPDX-License-Identifier: BSD-3-Clause
"""Programs of users in a world: how they start and end, their signals, threads, time, random numbers and network."""

from __future__ import annotations

import atexit
import datetime
import importlib
import logging
import os
import random
import secrets
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy
import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from std_msgs.msg import Int32

from flexbt_testing.one_process.network import Link
from flexbt_testing.one_process.programs import Program
from flexbt_testing.one_process.scheduler import SCHEDULER
from flexbt_testing.one_process.world import World


def bare_world(seed: int = 0) -> World:
    return World(seed, [Program('', 'idle', main=lambda: time.sleep(1e6))])


@pytest.fixture
def bare() -> Iterator[World]:
    """Yield a world without a robot."""
    with bare_world() as made:
        yield made


# Signals


def spin(told: list[str]) -> None:
    rclpy.init()
    try:
        rclpy.spin(rclpy.create_node('spinning'))
    except ExternalShutdownException:
        told.append('shut down')


def spin_after_a_handler_of_its_own(told: list[str]) -> None:
    signal.signal(signal.SIGTERM, lambda *_: told.append('handled'))
    spin(told)


def handle_after_rclpy(told: list[str]) -> None:
    rclpy.init()
    signal.signal(signal.SIGTERM, lambda *_: told.append('handled'))
    time.sleep(5.0)


def pause(told: list[str]) -> None:
    signal.signal(signal.SIGTERM, lambda *_: told.append('handled'))
    signal.pause()


def ignore(told: list[str]) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    time.sleep(5.0)
    told.append('slept')


def leave(told: list[str]) -> None:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(5))
    try:
        time.sleep(5.0)
    finally:
        told.append('left')


def shut_down(told: list[str]) -> None:
    rclpy.init()
    signal.signal(signal.SIGTERM, lambda *_: rclpy.shutdown())
    with suppress(ExternalShutdownException):
        rclpy.spin(rclpy.create_node('ending'))
    told.append('shut down')


def sleep(_told: list[str]) -> None:
    time.sleep(5.0)


@pytest.mark.parametrize(
    ('program', 'told', 'code'),
    [
        (spin, ['shut down'], 0),
        (spin_after_a_handler_of_its_own, ['handled', 'shut down'], 0),
        (handle_after_rclpy, ['handled'], 0),
        (pause, ['handled'], 0),
        (ignore, ['slept'], 0),
        (leave, ['left'], 5),
        (shut_down, ['shut down'], 0),
        (sleep, [], -signal.SIGTERM),
    ],
)
def test_sigterm_does_what_it_does_on_a_computer(
    bare: World, program: Callable[[list[str]], None], told: list[str], code: int
) -> None:
    heard: list[str] = []
    process = bare.launch(partial(program, heard))
    bare.run(1.0)
    bare.terminate(program.__name__)
    bare.run_while(lambda: process.is_alive, 'the program')
    assert sorted(heard) == told
    assert process.exit_code == code


def test_sigterm_reaches_a_stopped_process_when_it_goes_on(bare: World) -> None:
    process = bare.launch(partial(sleep, []))
    bare.hold_up('sleep')
    bare.terminate('sleep')
    bare.run(10.0)
    assert process.is_alive
    bare.resume('sleep')
    bare.run(1.0)
    assert process.exit_code == -signal.SIGTERM


# Starts and ends


def test_the_end_of_a_program_waits_for_its_threads(bare: World) -> None:
    told: list[str] = []

    def write(text: str) -> None:
        time.sleep(2.0)
        told.append(text)

    def leave() -> None:
        threading.Thread(target=write, args=['thread']).start()
        threading.Thread(target=write, args=['daemon'], daemon=True).start()
        pool = ThreadPoolExecutor(2)
        pool.submit(write, 'pool').result()
        threading.Timer(1.0, write, ['timer']).start()

    process = bare.launch(leave)
    bare.run(3.0)
    assert process.is_alive
    bare.run(10.0)
    assert (sorted(told), process.exit_code) == (['daemon', 'pool', 'thread', 'timer'], 0)


def test_a_program_sees_its_own_threads_and_can_wait_for_them(bare: World) -> None:
    told: list[list[str]] = []

    def work() -> None:
        threading.Thread(target=time.sleep, args=[5.0], name='of another').start()

    def join() -> None:
        threading.Thread(target=time.sleep, args=[1.0], name='own').start()
        told.append([thread.name for thread in threading.enumerate() if thread is not threading.main_thread()])
        for thread in threading.enumerate():
            if thread is not threading.main_thread():
                thread.join()
        told.append([str(threading.active_count())])

    bare.launch(work)
    process = bare.launch(join)
    bare.run(2.0)
    assert (told, process.exit_code) == ([['own'], ['1']], 0)


def test_what_is_registered_for_the_end_of_a_program_is_called_then(bare: World) -> None:
    told: list[str] = []

    def write() -> None:
        time.sleep(1.0)
        told.append('thread')

    def leave() -> None:
        for text in ('first', 'second', 'not'):
            atexit.register(note := partial(told.append, text))
        atexit.unregister(note)
        atexit.register(lambda: 1 / 0)
        threading.Thread(target=write).start()
        sys.exit(3)

    process = bare.launch(leave)
    bare.run(2.0)
    assert (told, process.exit_code) == (['thread', 'second', 'first'], 3)


def test_an_executor_of_events_calls_what_is_due(bare: World) -> None:
    told: list[float] = []

    def tick() -> None:
        rclpy.init()
        node = rclpy.create_node('ticking')
        executor = EventsExecutor()
        executor.add_node(node)
        node.create_timer(1.0, lambda: told.append(bare.now))
        executor.spin_until_future_complete(rclpy.Future(), timeout_sec=3.5)

    bare.launch(tick)
    bare.run(5.0)
    assert len(told) == 3


@pytest.mark.parametrize('rest', [0.0, 1e-9])
def test_a_program_that_rests_for_no_time_lets_the_others_go_on(bare: World, rest: float) -> None:
    told: list[float] = []

    def poll() -> None:
        threading.Timer(0.02, told.append, [bare.now]).start()
        while not told:
            time.sleep(rest)

    program = bare.launch(poll)
    bare.run(1.0)
    assert (program.exit_code, len(told)) == (0, 1)


def test_os_exit_ends_its_process_only(bare: World) -> None:
    def leave() -> None:
        threading.Thread(target=lambda: os._exit(3)).start()
        time.sleep(1e6)

    process = bare.launch(leave)
    bare.run(1.0)
    assert (process.is_alive, process.exit_code) == (False, 3)


def test_functions_of_one_name_run_side_by_side(bare: World) -> None:
    told: list[int] = []

    def write(number: int) -> None:
        time.sleep(1.0)
        told.append(number)

    processes = [bare.launch(partial(write, number)) for number in range(3)]
    bare.kill('write_2')
    bare.run(2.0)
    assert told == [0, 2]
    assert [process.name for process in processes] == ['write', 'write_2', 'write_3']


def test_what_does_not_fit_the_moment_is_told(bare: World) -> None:
    bare.terminate('idle')
    wrong: dict[Callable[[], Any], str] = {
        lambda: bare.kill('idel'): "there is no process 'idel'; did you mean 'idle'?",
        lambda: bare.terminate('idel'): "there is no process 'idel'; did you mean 'idle'?",
        lambda: bare.restart('idel'): "there is no process 'idel'; did you mean 'idle'?",
        lambda: bare.cut('idel', 1.0): "there is no process 'idel'; did you mean 'idle'?",
        lambda: bare.launch('idel'): "there is no program 'idel'; did you mean 'idle'? Give others as",
        lambda: bare.launch('idle'): 'idle runs already',
        lambda: bare.restart('idle'): 'idle runs; kill it, or terminate it and wait for its end, first',
        lambda: bare.start('Navigate'): 'no program of this world is an onboard_executive',
    }
    for call, problem in wrong.items():
        with pytest.raises(AssertionError) as told:
            call()
        assert str(told.value).startswith(problem)


def test_a_world_without_programs_has_no_robot() -> None:
    with World(0, []) as world:
        world.run(1.0)
        assert (world.processes, world.robots) == ({}, {})


def test_there_is_one_world_at_a_time(bare: World) -> None:
    with pytest.raises(RuntimeError, match=r'the world of \S+test_there_is_one_world_at_a_time is open'):
        World()
    bare.run(1.0)
    assert bare.processes['idle'].is_alive


def test_what_was_planned_for_after_the_end_does_not_happen() -> None:
    told: list[str] = []
    with bare_world() as world:
        world.at(world.now + 1.0, lambda: told.append('at'))
        branch = world.branch_at(world.now + 1.0, lambda _world: None)
    time.sleep(2.0)
    assert (told, branch.side) == ([], None)


def test_the_first_of_several_errors_is_told(bare: World) -> None:
    bare.at(bare.now + 1.0, lambda: bare.kill('first'))
    bare.at(bare.now + 1.0, lambda: bare.kill('second'))
    with pytest.raises(AssertionError, match='first'):
        bare.run(5.0)
    bare.run(5.0)


# Time and random numbers


def test_the_seed_decides_all_random_numbers_and_dates() -> None:
    def draw(found: list[Any]) -> None:
        zone = datetime.UTC
        found += [random.random(), secrets.token_hex(), os.urandom(4), numpy.random.rand(), os.getrandom(4)]
        random.seed()
        found += [random.random(), random.Random().random(), random.Random(1).random()]
        found += [numpy.random.default_rng().random(), datetime.datetime.now(), datetime.datetime.now(zone)]
        found += [datetime.datetime.utcnow(), datetime.date.today(), time.ctime(), time.strftime('%X'), time.gmtime()]
        found += [time.clock_gettime_ns(time.CLOCK_MONOTONIC), time.thread_time_ns()]
        assert time.clock_gettime(time.CLOCK_REALTIME) == time.time()

    def drawn(seed: int) -> list[Any]:
        found: list[Any] = []
        with bare_world(seed) as world:
            world.launch(partial(draw, found))
            world.run(1.0)
        return found

    first = drawn(3)
    assert len(first) == 18
    assert drawn(3) == first
    assert not {*drawn(4)[:7]} & {*first[:7]}
    assert first[7] == random.Random(1).random()


def test_neither_addresses_nor_earlier_worlds_decide_the_order_of_threads_and_nodes() -> None:
    def wait_for_pool() -> None:
        with ThreadPoolExecutor(6) as pool:
            for seconds in (5, 1, 4, 2, 3, 6):
                pool.submit(time.sleep, seconds)

    def spin_nodes(told: list[int]) -> None:
        rclpy.init()
        executor = SingleThreadedExecutor()
        nodes = [rclpy.create_node(f'node_{number}') for number in range(5)]
        for number, node in enumerate(nodes):
            node.create_timer(1.0, partial(told.append, number))
            executor.add_node(node)
        executor.spin_until_future_complete(rclpy.Future(), timeout_sec=2.5)

    def run(junk: int) -> tuple[list[int], int]:
        kept, told = [bytearray(1000 * junk) for _ in range(junk)], list[int]()
        with bare_world(3) as world:
            world.launch(wait_for_pool)
            world.launch(partial(spin_nodes, told))
            world.run(10.0)
            assert len(kept) == junk and len(told) == 10
            return told, SCHEDULER.now

    assert len({str(run(junk)) for junk in range(6)}) == 1


def test_what_a_module_draws_as_it_is_imported_leaves_the_seed_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'module_that_draws.py').write_text('import uuid\nNUMBER = uuid.uuid4()\n')
    monkeypatch.syspath_prepend(tmp_path)

    def drawn() -> list[uuid.UUID]:
        found: list[uuid.UUID] = []

        def draw() -> None:
            importlib.import_module('module_that_draws')
            found.append(uuid.uuid4())

        with bare_world(3) as world:
            world.launch(draw)
            world.run(1.0)
        return found

    first = drawn()
    assert first and drawn() == first


def test_a_date_goes_on_with_the_clock_of_the_world(bare: World) -> None:
    before = datetime.datetime.now(datetime.UTC)
    bare.run(3600.0)
    assert round((datetime.datetime.now(datetime.UTC) - before).total_seconds()) == 3600
    assert time.localtime(0.0) == time.localtime(0)
    assert time.strftime('%Y', time.gmtime(0)) == '1970'

    class InUtc(logging.Formatter):
        converter = time.gmtime  # type: ignore[assignment]

    record = logging.makeLogRecord({'created': 0.0})
    assert InUtc().formatTime(record, '%H') == '00'


# Liveliness and the network


def test_a_lease_that_is_renewed_by_itself_ends_with_the_process(bare: World) -> None:
    told: list[tuple[int, int, int]] = []
    leased = QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1.0))

    def drive() -> None:
        rclpy.init()
        node = rclpy.create_node('driver')
        node.create_publisher(Int32, 'wheels', leased)
        rclpy.spin(node)

    def note(event: Any) -> None:
        told.append((round(bare.now - began), event.alive_count, event.not_alive_count))

    node, began = bare.observer.node, bare.now
    events = SubscriptionEventCallbacks(liveliness=note)
    bare.observer.call(lambda: node.create_subscription(Int32, 'wheels', print, leased, event_callbacks=events))
    bare.launch(drive)
    for act in (bare.hold_up, bare.resume, bare.kill):
        bare.run(5.0)
        act('drive')
    bare.run(60.0)
    assert told == [(0, 1, 0), (6, 0, 1), (10, 1, 0), (16, 0, 1), (35, 0, 0)]


def test_a_loss_is_a_probability() -> None:
    link = Link(loss=0.9)
    for name, value in (('loss', 1.0), ('loss', -0.1), ('delay', -1.0), ('rate', float('inf'))):
        with pytest.raises(ValueError, match=name):
            setattr(link, name, value)
    assert link == Link(loss=0.9)


def test_a_misspelled_link_or_disk_is_told(bare: World) -> None:
    for wrong in (bare.network.link(), bare.disk):
        with pytest.raises(AttributeError, match='dely'):
            wrong.dely = 0.1  # type: ignore[union-attr]
    bare.network.hosts['idle'] = 'base'
    bare.network.link('robot', 'base').delay = 0.1
    for act in (bare.network.link, partial(bare.network.cut, 1.0)):
        with pytest.raises(ValueError, match=r"no host 'robto'; there are base, operator, robot\. First give"):
            act('robto', 'operator')


def test_processes_that_are_cut_off_reach_nobody_and_keep_their_links(bare: World) -> None:
    one, other, operator = (SCHEDULER.process(name) for name in ('one', 'other', 'operator'))
    network = bare.network
    network.link().rate = 1.0
    network.cut_off('one', 5.0)
    network.cut_off('other', 5.0)
    assert network.is_cut
    for source, target in ((one, other), (other, one), (one, operator), (operator, other)):
        assert network(source, target, False) is None
        assert (network(source, target, True) or 0) >= 5e9
    assert network(SCHEDULER.main.process, one, False) == 0, 'the test looks into it'
    bare.run(6.0)
    assert network(one, other, False) == 0
    network(one, operator, False)
    assert (network(one, operator, False) or 0) > 0, 'the rate of the link'
