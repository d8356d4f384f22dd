# SPDX-License-Identifier: BSD-3-Clause
"""Liveliness of real processes: a kill is noticed in a fraction of a second, an orderly end at once."""

from __future__ import annotations

import contextlib
import functools
import queue
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from flexbt_common import discovery
from flexbt_common.lifecycle import liveliness
from flexbt_common.lifecycle.liveliness import (
    LEASE_SECONDS,
    REPEAT_SECONDS,
    START_SECONDS,
    LivelinessToken,
    LivelinessWatch,
    ProcessIdentity,
)
from flexbt_common.lifecycle.managed_node import NodeScope
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import implementation
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.runtime.health import Hang
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

PROGRAM = """
import sys
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import run_node

def setup(runtime):
    LivelinessToken(runtime)
    print('ready', flush=True)

sys.exit(run_node('living', setup))
"""


WATCHER = """
import sys
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.runtime.node_runtime import run_node

def setup(runtime):
    LivelinessWatch(runtime, 'living', lambda alive: print(alive, flush=True))

sys.exit(run_node('watcher', setup))
"""


ARGUMENTS = ('--ros-args', '-r', '__ns:=/robot1')


@contextlib.contextmanager
def start(program: str = PROGRAM) -> Iterator[PythonProcess]:
    """Provide a living process. It is killed at the end of the block, if it was not before."""
    with python_process(['-c', program, *ARGUMENTS]) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == 'ready\n'
            yield process
        finally:
            process.kill()


def latest() -> float:
    """Return when a death that was just now has to be noticed at the latest, in uncontended time. A process that is new
    waits longer for the first assertion.
    """
    return uncontended_time() + max(LEASE_SECONDS, ProcessIdentity.started() + START_SECONDS - time.monotonic()) + 1.5


def alive_writers(runtime: NodeRuntime) -> set[bytes]:
    """Return those of the token's topic that the middleware takes for alive, also those that were killed lately."""
    endpoints = runtime.node.get_publishers_info_by_topic('/robot1/living/alive')
    return {bytes(endpoint.endpoint_gid) for endpoint in endpoints}


def test_the_clock_goes_on_while_a_token_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    with NodeRuntime.open('living') as runtime:
        token, late, was_told = LivelinessToken(runtime), threading.Event(), []
        # After the token, on the clock's thread.
        runtime.health.on_late(lambda problem: late.set() if problem else None)
        create = runtime.node.create_publisher

        def slow(*args: Any, **options: Any) -> Any:
            was_told.append(late.wait(DEADLINE / 6.0))
            return create(*args, **options)

        monkeypatch.setattr(runtime.node, 'create_publisher', slow)
        token.add_name('/robot2/living')
        assert was_told == [True]


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('name', ['living', '/robot1/living'])
def test_death_and_return_are_noticed(name: str) -> None:
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        changes: queue.Queue[tuple[bool, float]] = queue.Queue()
        watch = LivelinessWatch(runtime, name, lambda alive: changes.put((alive, uncontended_time())))

        def shown() -> bool | None:
            return watch.alive

        assert shown() is None
        ended: set[bytes] = set()
        for how in (signal.SIGKILL, signal.SIGTERM):
            with start() as process:
                assert changes.get(timeout=DEADLINE)[0] is True
                assert shown() is True
                (token,) = alive_writers(runtime) - ended
                assert not watch.has_ended(token)
                limit = latest()
                process.send_signal(how)
                alive, noticed = changes.get(timeout=DEADLINE)
                assert not alive and shown() is False
                assert noticed < limit
                ended.add(token)
                if reports_writers():
                    process.wait(DEADLINE)
                    assert all(map(watch.has_ended, ended))
        watch.close()
        runtime.call(changes.queue.clear)
        with start() as process:
            assert changes.empty()
            process.kill()


@pytest.mark.dds('another process takes part')
def test_a_node_that_is_killed_as_soon_as_it_is_seen_is_missed_too() -> None:
    """Before the middleware asserts its token for the first time."""
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        changes: queue.Queue[bool] = queue.Queue()
        LivelinessWatch(runtime, 'living', changes.put)
        for _ in range(3):
            with start() as process:
                assert changes.get(timeout=DEADLINE) is True
                process.kill()
                limit = latest()
                assert changes.get(timeout=DEADLINE) is False
                assert uncontended_time() < limit


@pytest.mark.dds('another process takes part')
def test_a_node_that_is_found_and_says_nothing_is_late_and_then_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that sent a goal and was stopped before its token was heard: what it drives has to come to rest."""
    monkeypatch.setattr(liveliness._SeenToken, '_receive', lambda token, received: None)
    monkeypatch.setattr(liveliness._SeenToken, '_liveliness_changed', lambda token, event: None)
    monkeypatch.setattr(liveliness, '_STARTED', time.monotonic() - START_SECONDS)
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        told = Told(runtime, timeout=1.0)
        with start():
            assert told.next() == ('late', True)
            assert told.watch.problem == 'it was found, and has not been heard yet'
            assert [told.next() for _ in range(2)] == [('late', False), ('alive', False)]


def test_a_node_that_says_nothing_is_not_reviewed_when_nobody_watches_it_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(liveliness, '_STARTED', time.monotonic() - START_SECONDS)
    reviews, passed = list[object](), threading.Event()
    review = liveliness._SeenToken._review

    def counted(token: liveliness._SeenToken) -> None:
        reviews.append(token)
        review(token)

    monkeypatch.setattr(liveliness._SeenToken, '_review', counted)
    with NodeRuntime.open('watcher') as runtime, NodeRuntime.open('silent') as silent:
        silent.call(lambda: silent.node.create_publisher(DiagnosticStatus, 'living/alive', liveliness._qos()))
        watch = LivelinessWatch(runtime, 'living')
        wait_until(lambda: watch.late, 'the silent node')
        watch.close()
        runtime.call(reviews.clear)
        runtime.call(lambda: runtime.post_in(1.0, passed.set))
        assert passed.wait(DEADLINE)
        assert len(reviews) <= 1


@pytest.mark.dds('another process takes part')
def test_a_watcher_that_was_killed_and_started_again_takes_nobody_for_dead() -> None:
    with start() as living:
        for _ in range(3):
            # No fork, which would not be as new as what it has loaded.
            command = [sys.executable, '-c', WATCHER, *ARGUMENTS]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watcher:
                assert watcher.stdout is not None and watcher.stdout.readline() == 'True\n'
                told, _, _ = select.select([watcher.stdout], [], [], 3 * LEASE_SECONDS)
                watcher.kill()
            assert not told
        living.kill()


@pytest.mark.dds('another process takes part')
def test_who_watches_a_token_that_is_watched_already_sees_life_and_death() -> None:
    changes: queue.Queue[tuple[int, bool]] = queue.Queue()

    def note(number: int, alive: bool) -> None:
        changes.put((number, alive))

    with NodeRuntime.open('watcher', namespace='/robot1') as runtime, start() as process:
        LivelinessWatch(runtime, 'living', functools.partial(note, 0))
        assert changes.get(timeout=DEADLINE) == (0, True)
        for number in (1, 2):  # one after the other, on a part of the node that ends
            with pytest.raises(queue.Empty):
                changes.get(timeout=1.2)  # longer than lease and grace: nobody is taken for dead
            scope = NodeScope(runtime)
            watch = LivelinessWatch(scope, '/robot1/living', functools.partial(note, number))
            assert changes.get(timeout=DEADLINE) == (number, True)
            if number == 1:
                scope.close()
        assert watch.alive is True
        process.kill()
        limit = latest()
        assert {changes.get(timeout=DEADLINE) for _ in range(2)} == {(0, False), (2, False)}
        assert uncontended_time() < limit
        with start() as again:
            assert {changes.get(timeout=DEADLINE) for _ in range(2)} == {(0, True), (2, True)}
            again.kill()
        scope.close()


@pytest.mark.dds('another process takes part')
def test_what_nobody_watches_is_heard_no_more_once_it_is_gone() -> None:
    changes: queue.Queue[bool] = queue.Queue()
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:

        def heard() -> int:
            return runtime.call(lambda: len(list(runtime.node.subscriptions)))

        scope = NodeScope(runtime)
        before = heard()
        for number in range(20):
            LivelinessWatch(scope, f'never_seen_{number}').close()
        wait_until(lambda: heard() == before, lambda: f'{heard()} subscriptions')
        for _ in range(2):
            with start() as process:
                watch = LivelinessWatch(scope, 'living', changes.put)
                assert changes.get(timeout=DEADLINE) is True
                watch.close()
                again = LivelinessWatch(scope, 'living', changes.put)  # while it lives: the same subscription
                assert changes.get(timeout=DEADLINE) is True
                with pytest.raises(queue.Empty):
                    changes.get(timeout=1.2)  # longer than lease and grace: it is not taken for dead
                again.close()
                assert heard() == before + 1
                process.kill()
                wait_until(lambda: heard() == before, lambda: f'{heard()} subscriptions')
        assert len(scope._before) <= len(scope._entities()) + 1  # the last one, until the next comes
        scope.close()


def test_a_node_that_lives_stays_alive() -> None:
    with NodeRuntime.open('here') as here, NodeRuntime.open('there') as there:
        LivelinessToken(there)
        changes: queue.Queue[bool] = queue.Queue()
        watch = LivelinessWatch(here, 'there', changes.put)
        assert changes.get(timeout=DEADLINE) is True
        with pytest.raises(queue.Empty):
            changes.get(timeout=1.2)
        assert watch.alive is True


class Told:
    """What a watch has told, in its order."""

    def __init__(self, runtime: NodeRuntime, timeout: float = 60.0) -> None:
        self._told: queue.Queue[tuple[str, bool]] = queue.Queue()
        self.watch = LivelinessWatch(
            runtime,
            'living',
            lambda alive: self._told.put(('alive', alive)),
            on_late=lambda late: self._told.put(('late', late)),
            timeout=timeout,
        )

    def next(self) -> tuple[str, bool]:
        return self._told.get(timeout=DEADLINE)


@pytest.mark.dds('another process takes part')
def test_a_process_that_was_stopped_is_late_and_then_as_before() -> None:
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime, start() as process:
        told = Told(runtime)
        assert told.next() == ('alive', True)
        for _ in range(2):
            process.send_signal(signal.SIGSTOP)
            assert told.next() == ('late', True)
            assert told.watch.alive and told.watch.age >= LEASE_SECONDS and told.watch.problem
            process.send_signal(signal.SIGCONT)
            assert told.next() == ('late', False)
        process.kill()
        while (last := told.next()) != ('alive', False):
            assert last[0] == 'late'


@pytest.mark.dds('another process takes part')
def test_a_process_that_is_late_for_too_long_is_gone_until_it_is_heard_again() -> None:
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime, start() as process:
        told = Told(runtime, timeout=1.0)
        assert told.next() == ('alive', True)
        process.send_signal(signal.SIGSTOP)
        assert [told.next() for _ in range(3)] == [('late', True), ('late', False), ('alive', False)]
        assert told.watch.age == 0.0
        process.send_signal(signal.SIGCONT)
        assert told.next() == ('alive', True)
        process.kill()


@pytest.mark.dds('another process takes part')
def test_a_process_that_is_killed_while_it_is_late_is_gone_at_once_and_another_one_can_take_its_place() -> None:
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        told = Told(runtime)
        with start() as process:
            assert told.next() == ('alive', True)
            process.send_signal(signal.SIGSTOP)
            assert told.next() == ('late', True)
            process.kill()
            assert [told.next() for _ in range(2)] == [('late', False), ('alive', False)]
        with start() as process:
            assert told.next() == ('alive', True)
            process.kill()


@pytest.mark.dds('another process takes part')
def test_a_process_that_takes_the_place_of_one_that_is_stopped_begins_anew() -> None:
    """The first one was not missed yet, or was late: it is gone before the other one is there."""
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        told = Told(runtime)
        with start() as process:
            assert told.next() == ('alive', True)
            process.send_signal(signal.SIGSTOP)
            assert told.next() == ('late', True)
            with start() as another:
                assert [told.next() for _ in range(3)] == [('late', False), ('alive', False), ('alive', True)]
                process.kill()
                another.kill()


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('end', [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize('is_first', [True, False])
def test_two_processes_of_one_name_are_late_until_one_of_them_ends(is_first: bool, end: signal.Signals) -> None:
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime, start() as first:
        told = Told(runtime)
        assert told.next() == ('alive', True)
        with start() as second:
            both = {str(first.pid), str(second.pid)}
            wait_until(lambda: both <= set(told.watch.problem.replace(',', '').split()), lambda: told.watch.problem)
            assert told.watch.late or not told.watch.alive
            (first if is_first else second).send_signal(end)
            wait_until(lambda: told.watch.alive and not told.watch.late, 'the one that is left')
            second.kill()
            first.kill()


def test_a_thread_that_does_not_answer_makes_the_process_late_with_the_reason() -> None:
    blocked, go_on = threading.Event(), threading.Event()

    def block() -> None:
        blocked.set()
        go_on.wait(DEADLINE)

    with NodeRuntime.open('watcher') as runtime, NodeRuntime.open('living') as living:
        LivelinessToken(living).set_ready(True)
        told = Told(runtime)
        assert told.next() == ('alive', True)
        living.post(block)
        assert blocked.wait(DEADLINE)
        assert told.next() == ('late', True)
        wait_until(lambda: 'the executor has not answered' in told.watch.problem, 'the reason')
        assert not told.watch.ready
        go_on.set()
        assert told.next() == ('late', False)
        wait_until(lambda: told.watch.ready, 'ready again')


def test_a_loop_that_does_not_come_to_rest_makes_the_process_late() -> None:
    go_on, rest = threading.Event(), threading.Event()

    def work() -> None:
        with living.health.loop('the loop', lambda: 'at the mill') as loop:
            with loop.resting():
                rest.wait(DEADLINE)
            go_on.wait(DEADLINE)

    with NodeRuntime.open('watcher') as runtime, NodeRuntime.open('living') as living:
        LivelinessToken(living)
        hangs: queue.Queue[Hang] = queue.Queue()
        living.health.on_hang(hangs.put)
        thread = threading.Thread(target=work)
        thread.start()
        told = Told(runtime)
        assert told.next() == ('alive', True)
        rest.set()
        assert told.next() == ('late', True)
        while (hang := hangs.get(timeout=DEADLINE)).name != 'the loop':
            assert 'its computer is busy' in hang.name
        assert hang.where == 'at the mill' and 'go_on.wait' in hang.stack
        go_on.set()
        assert told.next() == ('late', False)
        while not (hang := hangs.get(timeout=DEADLINE)).is_over or hang.name != 'the loop':
            assert 'its computer is busy' in hang.name
        thread.join(DEADLINE)


def test_a_process_that_cannot_go_on_says_so_until_it_ends() -> None:
    with NodeRuntime.open('watcher') as runtime, NodeRuntime.open('living') as living:
        LivelinessToken(living)
        told = Told(runtime)
        assert told.next() == ('alive', True)
        living.abort('the world has come to its end')
        assert told.next() == ('late', True)
        assert told.watch.problem == 'the world has come to its end'


def test_ready_is_what_the_node_says_while_it_is_alive() -> None:
    with NodeRuntime.open('here') as here:
        changes: queue.Queue[tuple[str, bool]] = queue.Queue()

        def note(what: str, value: bool) -> None:
            changes.put((what, value))

        watch = LivelinessWatch(here, 'there', functools.partial(note, 'alive'), functools.partial(note, 'ready'))
        for _ in range(2):  # another one in its place begins anew
            with NodeRuntime.open('there') as there:
                token = LivelinessToken(there)
                assert changes.get(timeout=DEADLINE) == ('alive', True)
                assert not watch.ready
                token.set_ready(True)
                assert changes.get(timeout=DEADLINE) == ('ready', True)
                token.set_ready(False)
                assert changes.get(timeout=DEADLINE) == ('ready', False)
                token.set_ready(True)
                assert changes.get(timeout=DEADLINE) == ('ready', True)
                late: queue.Queue[bool] = queue.Queue()
                with NodeRuntime.open('latecomer') as latecomer:
                    LivelinessWatch(latecomer, 'there', lambda _alive: None, late.put)
                    assert late.get(timeout=DEADLINE) is True
            assert {changes.get(timeout=DEADLINE) for _ in range(2)} == {('alive', False), ('ready', False)}


@pytest.mark.dds('another process takes part')
def test_a_process_that_went_on_is_ready_again_and_one_in_its_place_is_not() -> None:
    ready: queue.Queue[bool] = queue.Queue()
    program = PROGRAM.replace('LivelinessToken(runtime)', 'LivelinessToken(runtime).set_ready(True)')
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        watch = LivelinessWatch(runtime, 'living', lambda _alive: None, ready.put)
        with start(program) as process:
            assert ready.get(timeout=DEADLINE) is True
            process.send_signal(signal.SIGSTOP)
            assert ready.get(timeout=DEADLINE) is False
            process.send_signal(signal.SIGCONT)
            assert ready.get(timeout=DEADLINE) is True
            process.kill()
            assert ready.get(timeout=DEADLINE) is False
        alive: queue.Queue[bool] = queue.Queue()
        LivelinessWatch(runtime, 'living', alive.put)
        with start() as process:
            assert alive.get(timeout=DEADLINE) is True
            with pytest.raises(queue.Empty):
                ready.get(timeout=1.0)
            assert not watch.ready
            process.kill()


@pytest.mark.dds('it is about Fast DDS')
@pytest.mark.skipif(implementation() != FAST_DDS, reason='needs Fast DDS')
def test_a_profile_for_consoles_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a liveliness protocol, the middleware would crash."""
    with NodeRuntime.open('here') as here:
        monkeypatch.setenv(discovery.PROFILE, str(discovery.profile('radio_console')))
        with pytest.raises(RuntimeError, match=r'radio_robot\.xml'):
            LivelinessToken(here)
        monkeypatch.setenv(discovery.PROFILE, str(discovery.profile('radio_robot')))
        LivelinessToken(here)


@pytest.mark.dds('another process takes part')
def test_a_node_whose_assertions_are_not_told_is_alive_by_what_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middleware loses such events on a busy machine."""
    monkeypatch.setattr(liveliness._SeenToken, '_liveliness_changed', lambda token, event: None)
    monkeypatch.setattr(liveliness, '_STARTED', time.monotonic() - START_SECONDS)
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        told: queue.Queue[tuple[str, bool]] = queue.Queue()
        LivelinessWatch(
            runtime,
            'living',
            on_change=lambda alive: told.put(('alive', alive)),
            on_late=lambda late: told.put(('late', late)),
        )
        with start() as process:
            assert told.get(timeout=DEADLINE) == ('alive', True)
            before = time.monotonic()
            with contextlib.suppress(queue.Empty):  # late it is only where it had no processor for so long
                late = told.get(timeout=3.0 * REPEAT_SECONDS)
                assert time.monotonic() - before > REPEAT_SECONDS + LEASE_SECONDS, late
            process.kill()
            wait_until(lambda: ('alive', False) in told.queue, 'its end')
