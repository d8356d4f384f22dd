# SPDX-License-Identifier: BSD-3-Clause
"""Messages on their way: real services, which fail in every way, and a program that is killed at any moment."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from email import message_from_bytes
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from flexbt_console.alerts import calling, delivered, store
from flexbt_console.alerts.calling import BURST, MOST_LISTED, Calling, check_lines, send_test
from flexbt_console.alerts.escalation import SeenNeed, SeenRobot
from flexbt_console.alerts.store import Store, acknowledge
from flexbt_console.errors import ConsoleError, RefusedError, UsageError
from flexbt_console.mirror.fleet import Urgency
from flexbt_testing.waiting import DEADLINE, wait_until


class Service:
    """A real HTTP server. ``got`` are the messages that it has accepted; ``act`` may do something else before."""

    def __init__(self) -> None:
        self.got: list[dict[str, Any]] = []
        self.asked = 0
        self.act: Callable[[BaseHTTPRequestHandler], bool] = lambda handler: True
        service = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers['Content-Length']))
                service.asked += 1
                if service.act(self):
                    service.got.append(json.loads(body))
                    self.send_response(200)
                    self.send_header('Content-Length', '0')
                    self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(('127.0.0.1', 0), Handler)
        self._server.daemon_threads = True
        self.address = f'json://127.0.0.1:{self._server.server_port}/SECRETPATH'
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def titles(self) -> list[str]:
        return [one['title'] for one in self.got]


class Lines:
    """A log in memory."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.info = self.warning = self.error = self.lines.append

    def __str__(self) -> str:
        return '\n'.join(self.lines)


@pytest.fixture
def service() -> Iterator[Service]:
    service = Service()
    yield service
    service.close()


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calling, 'FIRST_PAUSE', 0.2)
    monkeypatch.setattr(calling, 'PERIOD', 0.1)


def write(folder: Path, rules: str, **contacts: str | list[str]) -> Path:
    people = folder / 'people.yaml'
    people.write_text(json.dumps(contacts))
    people.chmod(0o600)
    (folder / 'alerts.yaml').write_text(f'contacts: people.yaml\ntime_zone: UTC\n{rules}')
    return folder / 'alerts.yaml'


RULE = 'rules: [{when: [decision, moved, silent, failed, fault], call: anna}]\n'


def asks(*keys: str, robot: str = '/a') -> list[SeenRobot]:
    return [SeenRobot(robot, True, tuple(SeenNeed(Urgency.DECISION, key, 0.0, f'asks {key}') for key in keys))]


def children(process: int) -> list[int]:
    """Return the processes that the threads of a process have started."""
    found = []
    for task in Path(f'/proc/{process}/task').glob('*/children'):
        with contextlib.suppress(OSError):  # a thread that has ended
            found += [int(one) for one in task.read_text().split()]
    return found


class Program:
    """The program in this process, on robots of the test: :attr:`robots`."""

    def __init__(self, file: Path, state: Path) -> None:
        self.robots: Sequence[SeenRobot] = []
        self.unwatched = 0
        self.log = Lines()
        self._is_closed = False
        self.store = Store(state)
        self.calling = Calling(file, self.store, lambda: self.robots, self.log, lambda: self.unwatched)

    def run(self, condition: Callable[[], Any]) -> None:
        """Run until the condition is true."""
        end = time.monotonic() + 2 * DEADLINE

        def is_done() -> bool:
            assert time.monotonic() < end, f'not in time:\n{self.log}'
            return bool(condition())

        self.calling.run(is_done)

    def is_idle(self) -> bool:
        return not self.store.memory.calls

    def close(self) -> None:
        """End it, and what it sends. Harmless when it has ended."""
        for sender in children(os.getpid()):
            with contextlib.suppress(ProcessLookupError):
                os.kill(sender, signal.SIGKILL)
        if not self._is_closed:
            self._is_closed = True
            self.store.close()


@pytest.fixture
def programs(tmp_path: Path) -> Iterator[Callable[[Path], Program]]:
    started: list[Program] = []

    def start(file: Path) -> Program:
        started.append(Program(file, tmp_path / 'state' / 'alerts.db'))
        return started[-1]

    yield start
    for program in started:
        program.close()
        assert 'SECRET' not in str(program.log)
    for file in (tmp_path / 'state').iterdir():
        assert b'SECRET' not in file.read_bytes()


def test_a_call_reaches_a_web_service_and_a_mail_server_once_and_its_end_too(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    from aiosmtpd.controller import Controller

    mails: list[Any] = []

    class Keep:
        async def handle_DATA(self, server: Any, session: Any, envelope: Any) -> str:
            mails.append(message_from_bytes(envelope.content))
            return '250 kept'

    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    mail_server = Controller(Keep(), '127.0.0.1', port)
    mail_server.start()
    try:
        mail = f'mailto://127.0.0.1:{port}/?from=flexbt@example.org&to=anna@example.org&mode=insecure'
        rules = 'page: http://station:8465\nrules: [{when: decision, call: anna, over: true}]'
        program = programs(write(tmp_path, rules, anna=[service.address, mail]))
        program.robots = [
            SeenRobot('/a', True, (SeenNeed(Urgency.DECISION, 'k', 0.0, '/Drive wants', '1 done*', 'd1'),))
        ]
        program.run(lambda: service.got and mails and program.is_idle())
        assert service.titles() == ['/a waits for a decision']
        assert 'http://station:8465/?robot=/a&decision=d1' in service.got[0]['message'].splitlines()
        assert service.got[0]['type'] == 'warning'
        (told,) = mails
        assert told['Subject'] == '/a waits for a decision' and '/Drive wants' in str(told)
        program.robots = asks()
        program.run(lambda: len(service.got) == len(mails) == 2 and program.is_idle())
        assert 'over since' in service.got[1]['title'] and service.got[1]['type'] == 'success'
    finally:
        mail_server.stop()


def test_nobody_is_called_about_robots_that_could_not_be_heard_as_the_computer_slept(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When it wakes up, all of them are as silent as the night was long, until the first message comes."""
    looks, night = itertools.count(1), 8 * 3600.0
    rules = 'rules: [{when: [decision, silent], call: anna, then: [{after: 1 min, call: ben}]}]'
    program = programs(write(tmp_path, rules, anna=service.address, ben=f'{service.address}/ben'))
    program.robots = [*asks('k'), *asks(robot='/b')]
    program.run(lambda: service.titles() == ['/a waits for a decision'] and program.is_idle())
    monkeypatch.setattr(calling, 'seconds_asleep', lambda: night)
    unreachable = (SeenNeed(Urgency.UNREACHABLE, '', night, 'unreachable'),)
    program.robots = [SeenRobot(name, False, unreachable) for name in ('/a', '/b')]
    program.run(lambda: next(looks) > 5)
    program.robots = [*asks(), *program.robots[1:]]  # somebody has answered it
    program.run(lambda: next(looks) > 10)
    assert program.is_idle() and len(service.got) == 1
    monkeypatch.setattr(calling, 'HEAR_SECONDS', 0.0)
    program.run(lambda: service.titles()[1:] == ['/b is silent'])


def refuse(code: int) -> Callable[[BaseHTTPRequestHandler], bool]:
    def act(handler: BaseHTTPRequestHandler) -> bool:
        handler.send_error(code, 'SECRETREASON')
        return False

    return act


def hang_up(handler: BaseHTTPRequestHandler) -> bool:
    handler.connection.shutdown(socket.SHUT_RDWR)
    return False


def drip(handler: BaseHTTPRequestHandler) -> bool:
    """Never end the answer, and never stop it."""
    handler.wfile.write(b'HTTP/1.1 200 OK\r\nX: ')
    never = threading.Event()
    try:
        while not never.wait(0.5):
            handler.wfile.write(b'SECRETDRIP')
    except OSError:
        return False
    return False


FAILURES = {
    'it answered 404 Not Found': refuse(404),
    'it answered 503 Service Unavailable': refuse(503),
    'apprise could not send it': hang_up,
    'it did not answer within 3 s': drip,
}


def test_a_service_that_fails_is_tried_again_and_holds_up_nobody(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calling, 'SEND_SECONDS', 3.0)
    for name in ('FIRST_PAUSE', 'LONGEST_PAUSE'):  # the others need not try often while one does not answer
        monkeypatch.setattr(calling, name, 4.0)
    failing = {f'c{number}': Service() for number in range(len(FAILURES))}
    try:
        for one, act in zip(failing.values(), FAILURES.values(), strict=True):
            one.act = act
        addresses = {contact: one.address for contact, one in failing.items()}
        file = write(
            tmp_path, f'rules: [{{when: decision, call: [{", ".join(failing)}, z]}}]', **addresses, z=service.address
        )
        program = programs(file)
        program.robots = asks('x')
        program.run(lambda: service.got)
        program.run(lambda: all(one.asked >= 2 for one in failing.values()))
        reasons = [f'address 1 of {one} was not reached: {why}' for one, why in zip(failing, FAILURES, strict=True)]
        program.run(lambda: all(one in str(program.log) for one in reasons))  # a busy machine ends some before that
        assert not any(one.got for one in failing.values())
        failing['c2'].act = refuse(503)  # whether it got the message before stays unknown
        program.run(lambda: 'address 1 of c2 was not reached: it answered 503' in str(program.log))
        for one in failing.values():
            one.act = lambda handler: True
        program.run(program.is_idle)
        assert [len(one.got) for one in (service, *failing.values())] == [1] * 5
        for (contact, one), why in zip(failing.items(), FAILURES, strict=True):
            # On a busy machine a process may also have been ended before it had sent anything.
            is_certain = why.startswith('it answered') and f'{contact} was not reached: it did not' not in str(
                program.log
            )
            assert ('This may be a repetition' in one.got[0]['message']) is not is_certain
    finally:
        for one in failing.values():
            one.close()


def test_no_way_of_failing_tells_an_address(
    tmp_path: Path,
    programs: Callable[[Path], Program],
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Addresses that lead nowhere, or that apprise does not know: each is tried once."""
    monkeypatch.setattr(calling, 'FIRST_PAUSE', 2 * DEADLINE)
    with socket.socket() as closed:
        closed.bind(('127.0.0.1', 0))
        port = closed.getsockname()[1]
    addresses = {
        'refused': f'json://SECRETUSER:SECRETPASSWORD@127.0.0.1:{port}/SECRETPATH',
        'no_name': 'json://SECRET.invalid/SECRETPATH',
        'no_tls': service.address.replace('json:', 'jsons:'),
        'no_mail': f'mailto://SECRETUSER:SECRETPASSWORD@127.0.0.1:{port}?from=a@example.org&to=SECRET@example.org',
        'nobody': 'slack://SECRETTOKEN',
        'nothing': 'SECRETTOKEN',
        'topic': service.address.replace('json:', 'ntfy:'),  # apprise itself shows it as no secret
    }
    service.act = refuse(403)
    program = programs(write(tmp_path, f'rules: [{{when: decision, call: [{", ".join(addresses)}]}}]', **addresses))
    program.robots = asks('x')
    program.run(lambda: all(f'address 1 of {name} was not reached' in str(program.log) for name in addresses))
    assert 'address 1 of refused was not reached: it refused the connection' in str(program.log)
    assert 'address 1 of topic was not reached: it answered 403 Forbidden' in str(program.log)
    assert 'address 1 of nothing was not reached: apprise does not know such an address' in str(program.log)
    with pytest.raises(UsageError, match='nobody: apprise does not know address 1') as unknown:
        check_lines(program.calling.rules, [])
    with pytest.raises(ConsoleError, match='JSON: it refused the connection') as refused:
        send_test(program.calling.rules, 'refused')
    assert 'SECRET' not in f'{unknown.value}{refused.value}{capfd.readouterr()}'


def test_a_flood_is_bundled(tmp_path: Path, programs: Callable[[Path], Program], service: Service) -> None:
    program = programs(write(tmp_path, RULE, anna=service.address))
    for wave in range(1, 11):
        program.robots = [asks(*map(str, range(10 * wave)), robot=f'/r{number}')[0] for number in range(5)]
        waiting = service.asked
        program.run(lambda waiting=waiting: service.asked > waiting or service.asked == BURST)  # type: ignore[misc]
    program.run(lambda: len(program.store.memory.things) == 500)
    assert len(service.got) == BURST
    first = service.got[0]
    assert first['title'] == '50 things: /r0 waits for a decision, ...'
    assert first['message'].count('\n- ') == MOST_LISTED - 1 and 'and 30 more' in first['message']


def test_a_call_that_waits_for_its_service_is_not_made_when_all_is_over_unsaid(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    service.act = refuse(500)
    program = programs(write(tmp_path, RULE.replace('anna', 'anna, over: true'), anna=service.address))
    program.robots = asks('x')
    program.run(lambda: 'was not reached' in str(program.log))
    program.robots = asks()
    program.run(lambda: not program.store.memory.things)
    service.act = lambda handler: True
    program.run(program.is_idle)
    (title,) = service.titles()
    assert title.startswith('/a waits for a decision (over since')


def test_a_call_whose_service_failed_before_the_quiet_hours_waits_for_their_end(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    rules = 'rules: [{when: decision, call: anna}, {when: moved, severity: critical, call: anna}]\n'
    service.act = refuse(500)
    program = programs(write(tmp_path, rules, anna=service.address))
    program.robots = asks('x')
    program.run(lambda: 'was not reached' in str(program.log))
    begin, end = (f'{datetime.now(UTC) + timedelta(hours=hours):%H:%M}' for hours in (-1, 1))
    write(tmp_path, f'quiet_hours: {{from: "{begin}", to: "{end}"}}\n{rules}', anna=service.address)
    program.run(lambda: 'was read again' in str(program.log))
    service.act = lambda handler: True
    needs = (*program.robots[0].needs, SeenNeed(Urgency.ALARM, 'r', 0.0, 'moves'))
    program.robots = [SeenRobot('/a', True, needs)]
    program.run(lambda: service.got)
    assert service.titles() == ['/a moves though it should stand']
    write(tmp_path, rules, anna=service.address)
    program.run(lambda: len(service.got) == 2)
    assert service.titles()[1] == '/a waits for a decision'


def test_an_acknowledgment_by_another_process_ends_the_escalation(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    program = programs(write(tmp_path, RULE, anna=service.address))
    state = program.store.file
    program.robots = asks('x')
    program.run(lambda: program.is_idle() and service.got)
    (text,) = acknowledge(state, [], 'eve')
    assert text == '1  /a: asks x'
    program.run(lambda: 'eve has acknowledged 1: /a' in str(program.log))
    assert program.store.memory.things[1].acknowledged == 'eve'
    with pytest.raises(RefusedError, match='nothing waits for anybody'):
        acknowledge(state, [], 'eve')
    with pytest.raises(RefusedError, match='nothing is there with the number 77'):
        acknowledge(state, [77], 'eve')
    program.robots = asks('x', 'y', 'z')
    program.run(lambda: len(service.got) == 2 and program.is_idle())
    with pytest.raises(RefusedError, match=r'name one of these:\n.*asks y\n.*asks z'):
        acknowledge(state, [], 'eve')


def test_a_full_disk_and_a_file_that_is_gone_are_told_and_calls_go_on(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = programs(write(tmp_path, RULE, anna=service.address))
    (pages,) = program.store._connection.execute('PRAGMA page_count').fetchone()

    def full(file: Path) -> sqlite3.Connection:
        connection = delivered.connect(file)
        connection.execute(f'PRAGMA max_page_count = {pages}')
        return connection

    monkeypatch.setattr(store, 'connect', full)
    program.store._open()
    program.robots = asks(*map(str, range(60)))
    program.run(lambda: service.got and program.is_idle())
    assert 'database or disk is full; calls go on' in str(program.log)
    monkeypatch.setattr(store, 'connect', delivered.connect)
    program.run(lambda: 'is written again' in str(program.log))
    program.store.file.unlink()
    program.robots = asks(*map(str, range(59)))
    program.run(lambda: str(program.log).count('is written again') == 2)
    program.close()
    again = programs(tmp_path / 'alerts.yaml')
    again.robots = asks(*map(str, range(59)), 'one more')
    again.run(lambda: len(service.got) == 2 and again.is_idle())
    assert '60 things' in service.got[0]['title'] and 'asks one more' in service.got[1]['message']


def test_changed_rules_count_and_wrong_ones_do_not(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    file = write(tmp_path, RULE.replace('decision, ', ''), anna=service.address)
    program = programs(file)
    program.robots = asks('x')
    file.write_text(file.read_text().replace('anna', 'nobody'))
    program.run(lambda: "there is no contact 'nobody'" in str(program.log))
    (tmp_path / 'people.yaml').chmod(0o644)
    program.run(lambda: 'do chmod 600' in str(program.log))
    assert not service.asked
    write(tmp_path, RULE, anna=service.address)
    program.run(lambda: service.got and program.is_idle())
    assert 'was read again: 1 rule' in str(program.log)


def test_that_nobody_is_called_about_further_robots_is_told_once(
    tmp_path: Path, programs: Callable[[Path], Program]
) -> None:
    program = programs(write(tmp_path, RULE, anna='json://127.0.0.1'))
    told = '6 more robots were found, and nobody is called about them: list all robots in "robots"'
    for program.unwatched in (0, 6, 6, 0, 6):
        looks = iter(range(2))
        program.calling.run(lambda looks=looks: next(looks))  # type: ignore[misc]
    assert str(program.log).count(told) == 2


def test_rules_with_a_file_of_contacts_that_comes_later_count_then(
    tmp_path: Path, programs: Callable[[Path], Program], service: Service
) -> None:
    file = write(tmp_path, RULE, anna=service.address)
    program = programs(file)
    file.write_text(file.read_text().replace('people.yaml', 'others.yaml'))
    program.run(lambda: 'others.yaml cannot be read' in str(program.log))
    fresh = tmp_path / 'fresh.yaml'
    fresh.write_bytes((tmp_path / 'people.yaml').read_bytes())
    fresh.chmod(0o600)
    fresh.rename(tmp_path / 'others.yaml')
    program.run(lambda: 'was read again' in str(program.log))
    assert str(program.log).count('cannot be read') == 1


DRIVER = """
import json, sys
from pathlib import Path
from flexbt_console.alerts import calling, store
from flexbt_console.alerts.escalation import SeenNeed, SeenRobot
from flexbt_console.alerts.store import Store
from flexbt_console.mirror.fleet import Urgency
calling.FIRST_PAUSE, calling.PERIOD, calling.BUNDLE_SECONDS = 0.2, 0.05, 0.5
class Log:
    def info(self, text): print(text, flush=True)
    warning = error = info
def look():
    keys = json.loads(Path(sys.argv[3]).read_text())
    return [SeenRobot('/a', True, tuple(SeenNeed(Urgency.DECISION, key, 0.0, f'asks {key}') for key in keys))]
calling.Calling(Path(sys.argv[1]), Store(Path(sys.argv[2])), look, Log()).run()
"""


class Killed:
    """The program as a process."""

    def __init__(self, tmp_path: Path, file: Path) -> None:
        self.keys = tmp_path / 'keys.json'
        self._words = [sys.executable, '-c', DRIVER, str(file), str(tmp_path / 'alerts.db'), str(self.keys)]
        self.log = tmp_path / 'log.txt'
        self.show([])
        self.start()

    def show(self, keys: Sequence[str]) -> None:
        fresh = self.keys.with_suffix('.new')
        fresh.write_text(json.dumps(keys))
        fresh.replace(self.keys)

    def start(self) -> None:
        with self.log.open('a') as log:
            self._process = subprocess.Popen(self._words, stdout=log, stderr=log)

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def sender(self) -> int:
        """Return the process that sends, or 0."""
        return next(iter(children(self._process.pid)), 0)


@pytest.fixture
def killed(tmp_path: Path, service: Service) -> Iterator[Killed]:
    program = Killed(tmp_path, write(tmp_path, RULE, anna=service.address))
    yield program
    program.kill()
    assert 'SECRET' not in program.log.read_text()


def told(service: Service) -> Counter[str]:
    """Return how often each thing was told."""
    lines = [line.strip() for one in service.got for line in one['message'].splitlines()]
    return Counter(line for line in lines if line.startswith('asks '))


def held_up(killed: Killed, service: Service) -> threading.Event:
    """Let a message be sent, and return while the service takes it; the event lets it go on."""
    taken, go_on = threading.Event(), threading.Event()

    def wait(handler: BaseHTTPRequestHandler) -> bool:
        taken.set()
        return go_on.wait(DEADLINE)

    service.act = wait
    killed.show(['x'])
    assert taken.wait(DEADLINE)
    return go_on


def test_a_program_that_is_killed_while_its_service_takes_a_message_does_not_send_it_again(
    killed: Killed, service: Service
) -> None:
    go_on = held_up(killed, service)
    killed.kill()
    killed.start()  # waits for the process that sends
    go_on.set()
    killed.show(['x', 'y'])
    wait_until(lambda: told(service)['asks y'], lambda: killed.log.read_text())
    assert told(service) == {'asks x': 1, 'asks y': 1}


def test_nothing_is_lost_when_the_process_that_sends_is_killed_and_a_repetition_says_so(
    killed: Killed, service: Service
) -> None:
    go_on = held_up(killed, service)
    os.kill(wait_until(killed.sender), signal.SIGKILL)
    go_on.set()
    wait_until(lambda: len(service.got) == 2, lambda: killed.log.read_text())
    assert 'This may be a repetition' in service.got[1]['message']


def test_a_program_that_is_killed_at_random_moments_tells_each_thing_once(killed: Killed, service: Service) -> None:
    chance = random.Random(5)
    keys: list[str] = []
    for number in range(10):
        keys.append(f'{number}.')
        killed.show(keys)
        pause = threading.Event()
        asked = service.asked
        # Any moment: while it starts, decides, writes, starts a process, that one loads, sends, and notes it.
        end = time.monotonic() + chance.uniform(0.0, 6.0)
        while time.monotonic() < end and (service.asked == asked or chance.random() < 0.9):
            pause.wait(0.05)
        killed.kill()
        killed.start()
    wait_until(lambda: len(told(service)) == len(keys), lambda: killed.log.read_text(), 2 * DEADLINE)
    assert told(service) == dict.fromkeys([f'asks {key}' for key in keys], 1)
