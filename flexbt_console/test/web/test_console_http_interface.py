# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP interface: a mission over HTTPS, users with roles, and what is refused."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import json
import re
import ssl
import subprocess
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import pytest
from aiohttp.test_utils import TestClient, TestServer
from http_support import CERTIFICATE, ROBOT, Client, Site
from hypothesis import given
from hypothesis import strategies as st
from web_support import PLAN, WebRobot, WebRobots

from flexbt_common.files import alone_in
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import parse
from flexbt_console.commands.spec import Role
from flexbt_console.errors import ExitCode, UsageError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    CommandKind,
    CommandResult,
    ExecutiveSnapshot,
    ExecutiveState,
    OperatorCommand,
    ResultCode,
    UserdataScope,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.json_form import encode_json
from flexbt_console.ui import http_interface
from flexbt_console.ui.http_interface import (
    BODY_BYTES,
    QUICK_BYTES,
    HttpInterface,
    description,
    line_of,
    offered,
    perform,
)
from flexbt_console.ui.station import Attention, Station
from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.users import User, read_users, token_hash, write_users
from flexbt_core.clock.clock import ManualClock
from flexbt_core.values.json_data import load_json
from flexbt_testing.waiting import DEADLINE, wait_until

STOP: Final = OperatorCommand('s', CommandKind.STOP, 'bob')


def test_what_waits_for_a_live_link_is_not_sent_after_a_stop() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)

    class Link(RobotLink):
        def live_view(self, timeout: float) -> View:
            """Return the view once another program has stopped the robot, and the link is there again."""
            mirror.give(STOP, timeout)
            mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))
            return mirror.view()

        def wait_for(self, inspect: Any, timeout: float) -> Any:
            return inspect(mirror.view())

        def send(self, command: OperatorCommand, timeout: float, label: str) -> None:
            mirror.give(command, timeout, label)

        def settled(self, command_id: str, timeout: float) -> TrackedCommand | None:
            return mirror.command(command_id)

    link = Link()
    station = Station(mirror, link, CommandBuilder('ann'), 5.0, Attention(clock), '')
    code, answer = perform(parse(['autonomy', 'high']), station, link)
    assert (code, mirror.due_commands(True)) == (ExitCode.REFUSED, [STOP]), answer
    assert 'a STOP was given while this waited' in answer['reason']


def test_a_start_that_is_repeated_waits_for_the_run_that_it_has_started() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)

    def show(number: int, **parts: Any) -> None:
        mirror.receive_snapshot(ExecutiveSnapshot('e', number, **parts), Transit(0.0, 0.0))

    class Link(RobotLink):
        def live_view(self, timeout: float) -> View:
            return mirror.view()

        def wait_for(self, inspect: Any, timeout: float, every: float | None = None) -> Any:
            return inspect(mirror.view())  # it waits no longer

        def send(self, command: OperatorCommand, timeout: float, label: str) -> None:
            mirror.give(command, timeout, label)
            applied = (CommandResult(command.id, ResultCode.APPLIED),)
            show(2, state=ExecutiveState.RUNNING, run_id='r1', results=applied)

        def settled(self, command_id: str, timeout: float) -> TrackedCommand | None:
            return mirror.command(command_id)

    show(1, run_id='r0', outcome='done')
    station = Station(mirror, Link(), CommandBuilder('ann'), 5.0, Attention(clock), '')
    start = partial(perform, parse(['start', 'Drive', '--unseen', '--wait', '--wait-timeout', '1']), station, Link())
    assert start('c1')[0] is ExitCode.TIMEOUT
    show(3, run_id='r1', outcome='failed')
    code, answer = start('c1')
    assert (code, answer['outcome']) == (ExitCode.OK, 'failed')
    show(4, run_id='r2', outcome='done')  # of another operator
    code, answer = start('c1')
    assert code is ExitCode.REFUSED and 'another run was started meanwhile' in answer['reason']


class ProgramRobot(WebRobot):
    """A robot as programs command it."""

    def live_view(self, timeout: float) -> View:
        """See :class:`ExecutiveLink`."""
        return self.mirror.view()

    def wait_for(self, inspect: Any, timeout: float) -> Any:
        """See :class:`ExecutiveLink`."""
        return inspect(self.mirror.view())

    def settled(self, command_id: str, timeout: float) -> TrackedCommand | None:
        """See :class:`ExecutiveLink`."""
        found = partial(self.mirror.command, command_id)
        wait_until(lambda: (one := found()) is None or one.state is not CommandState.PENDING, 'the answer')
        return found()


def test_what_waits_for_the_node_is_not_sent_after_a_stop() -> None:
    robot = ProgramRobot()

    class Busy(WebRobots):
        """The node is busy; meanwhile somebody stops the robot."""

        def open(self, name: str, operator: str = '') -> None:
            robot.mirror.give(STOP, 5.0)
            super().open(name, operator)

    async def ask() -> tuple[int, Any]:
        robots = Busy({'/robot': robot.station()})
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        async with TestClient(TestServer(interface.application())) as client:
            answer = await client.post('/robots/robot/commands/autonomy', json={'level': 'high'})
            return answer.status, await answer.json()

    status, answer = asyncio.run(asyncio.wait_for(ask(), DEADLINE))
    assert (status, robot.sent) == (409, []), answer


def test_a_stop_waits_for_no_long_body_that_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, begun, go_on, load = ProgramRobot(), threading.Event(), threading.Event(), load_json

    def slow(text: str, **options: Any) -> Any:
        if len(text) > QUICK_BYTES:
            begun.set()
            assert go_on.wait(DEADLINE)
        return load(text, **options)

    async def ask() -> None:
        robots = WebRobots({'/robot': robot.station()})
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        async with TestClient(TestServer(interface.application())) as client:
            path = '/robots/robot/commands'
            long = asyncio.create_task(client.post(f'{path}/autonomy', json={'level': 'high', 'reason': 'x' * 20_000}))
            try:
                assert await asyncio.to_thread(begun.wait, DEADLINE)
                assert (await client.post(f'{path}/stop')).status == 200
            finally:
                go_on.set()
            assert (await long).status == 409  # it was requested before the stop

    monkeypatch.setattr(http_interface, 'load_json', slow)
    asyncio.run(asyncio.wait_for(ask(), DEADLINE))


def test_a_request_that_is_repeated_after_its_timeout_is_the_same_command() -> None:
    robot = ProgramRobot(answers=False)
    robot.show(PLAN)
    asking = ThreadPoolExecutor(1)

    def asked(name: str, key: str) -> Future[tuple[ExitCode, Any]]:
        stops = robot.mirror.view().stops
        return asking.submit(perform, parse([name]), robot.station(), robot, key, stops)

    def unanswered(name: str, key: str) -> None:
        count = len(robot.sent)
        answer = asked(name, key)
        robot.wait_sent(count + 1)
        robot.clock.advance(10.0)
        robot.show(PLAN)
        robot.mirror.due_commands(True)
        assert answer.result(DEADLINE)[0] is ExitCode.TIMEOUT

    unanswered('confirm', 'a')
    robot.show(executive_id='f')  # it was restarted, and the decision is gone
    answer = asked('confirm', 'a')
    first, second = robot.wait_sent(2)
    assert second == replace(first, executive_id='f')
    robot.show(results=(CommandResult('a', ResultCode.APPLIED),))
    assert answer.result(DEADLINE)[0] is ExitCode.OK
    assert asked('confirm', 'a').result(DEADLINE)[0] is ExitCode.OK and len(robot.sent) == 2
    unanswered('pause', 'b')
    robot.mirror.give(STOP, 5.0)
    assert asked('pause', 'b').result(DEADLINE)[0] is ExitCode.TIMEOUT and len(robot.sent) == 3  # not after a stop
    for _ in range(2):
        unanswered('stop', 'c')


def test_what_is_read_is_that_of_now_also_with_a_key() -> None:
    robot, key = ProgramRobot(), {'Idempotency-Key': 'k'}

    async def ask() -> list[str]:
        robots, told = WebRobots({'/robot': robot.station()}), []
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        async with TestClient(TestServer(interface.application())) as client:
            for behavior in ('Patrol', 'Drive'):
                robot.show(behavior=behavior)
                answer = await client.post('/robots/robot/commands/status', json={}, headers=key)
                told.append((await answer.json())['behavior'])
        return told

    assert asyncio.run(asyncio.wait_for(ask(), DEADLINE)) == ['Patrol', 'Drive']


def test_an_operator_is_present_while_he_reads_the_events_which_end_with_the_server() -> None:
    async def read() -> list[tuple[str, str]]:
        robots = WebRobots({'/robot': WebRobot().station()})
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        application = interface.application()
        served = TestClient(TestServer(application))
        async with served as client, client.get('/robots/robot/events') as events:
            assert await events.content.readline()
            present = list(robots.present)
            await application.shutdown()
            assert (await events.content.read()).endswith(b'\n')
            return present

    assert asyncio.run(asyncio.wait_for(read(), DEADLINE)) == [('/robot', 'ann')]


def test_a_stop_waits_for_no_answer_that_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, begun, go_on, write = ProgramRobot(), threading.Semaphore(0), threading.Event(), encode_json

    def slow(value: Any) -> str:
        if 'stop' not in str(value):
            begun.release()
            assert go_on.wait(DEADLINE)
        return write(value)

    async def ask() -> None:
        robots = WebRobots({'/robot': robot.station()})
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        async with TestClient(TestServer(interface.application())) as client:
            path = '/robots/robot'
            reads = client.get('/robots'), client.get(path), client.post(f'{path}/commands/log')
            long = [asyncio.create_task(one) for one in reads]
            events = await client.get(f'{path}/events')
            try:
                for _ in long:
                    assert await asyncio.to_thread(begun.acquire, timeout=DEADLINE)
                assert (await client.post(f'{path}/commands/stop')).status == 200
            finally:
                go_on.set()
            assert [(await one).status for one in long] == [200] * 3
            assert await events.content.readline()
            events.close()

    monkeypatch.setattr(http_interface, 'encode_json', slow)
    asyncio.run(asyncio.wait_for(ask(), DEADLINE))


def test_the_list_of_robots_tells_how_many_it_lacks() -> None:
    async def listed() -> Any:
        robots = WebRobots({'/robot': ProgramRobot().station()})
        robots.fleet.note_left_out(3)
        interface = HttpInterface(robots, robots.station, Access(), lambda user: 'ann')
        async with TestClient(TestServer(interface.application())) as client:
            return await (await client.get('/robots')).json()

    known = asyncio.run(asyncio.wait_for(listed(), DEADLINE))
    assert ([one['robot'] for one in known['robots']], known['left_out']) == (['robot'], 3)


def test_a_mission_is_driven_by_programs_and_events_tell_of_it(site: Site, executives: Any) -> None:
    executives(ROBOT, heartbeat=0.2)
    observer, operator = site.client('observer'), site.client('operator')
    wait_until(lambda: observer.ask('GET', f'/robots/{ROBOT}')[1].get('link') == 'live', 'the robot')
    assert [one['robot'] for one in observer.ask('GET', '/robots')[1]['robots']] == [ROBOT]
    heard: list[str] = []
    thread = threading.Thread(target=listen, args=(observer, heard), daemon=True)
    thread.start()
    wait_until(lambda: heard, 'the first event')

    status, refused = observer.command('start', {'name': 'Drive'})
    assert status == 403 and 'start needs the role operator; observer has observer' in refused['reason']
    status, behaviors = observer.command('behaviors')
    assert status == 200 and 'Drive' in json.dumps(behaviors)

    # The same request four times at once, as a program does that lost the answer: the run is started once.
    with ThreadPoolExecutor(4) as pool:
        started = [pool.submit(operator.command, 'start', {'name': 'Drive'}, Idempotency_Key='k1') for _ in range(4)]
        answers = [one.result() for one in started]
    assert {(status, answer['result']) for status, answer in answers} == {(200, 'applied')}, answers
    assert len({answer['id'] for _, answer in answers}) == 1
    run = observer.ask('GET', f'/robots/{ROBOT}')[1]['run_id']
    status, answer = operator.command('start', {'name': 'Drive'})
    assert status == 409 and answer['reason'], 'another key: a second start'
    assert observer.ask('GET', f'/robots/{ROBOT}')[1]['run_id'] == run

    wait_until(lambda: observer.ask('GET', f'/robots/{ROBOT}')[1]['decisions'], 'the question')
    status, answer = operator.command('input', {'value': '1 2 0'})
    assert (status, answer['result']) == (200, 'applied'), answer
    status, answer = operator.command('force', {'path': '/Accept', 'outcome': 'failed'})
    assert status == 403 and 'maintainer' in answer['reason']
    status, answer = operator.command('stop')
    assert (status, answer['result']) == (200, 'applied')
    wait_until(lambda: not observer.ask('GET', f'/robots/{ROBOT}')[1]['active_states'], 'the end')
    wait_until(lambda: any('"idle"' in text or 'preempted' in text for text in heard), lambda: heard[-3:])


def test_a_client_that_is_made_of_the_description_drives_a_mission(
    site: Site, executives: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    executives(ROBOT, heartbeat=0.2)
    operator = site.client('operator')
    wait_until(lambda: operator.ask('GET', f'/robots/{ROBOT}')[1].get('link') == 'live', 'the robot')
    (tmp_path / 'openapi.json').write_text(json.dumps(operator.ask('GET', '/openapi.json')[1]))
    words = ['generate', '--path', 'openapi.json', '--output-path', 'robots_client', '--meta', 'none']
    made = subprocess.run(
        [sys.executable, '-m', 'openapi_python_client', *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert made.returncode == 0 and 'WARNING' not in made.stdout + made.stderr, made
    monkeypatch.syspath_prepend(tmp_path)
    package = importlib.import_module('robots_client')

    def ask(name: str, body: str = '', **fields: Any) -> Any:
        call = importlib.import_module(f'robots_client.api.default.{name}')
        if body:
            fields['body'] = getattr(importlib.import_module('robots_client.models'), body)(**fields.pop('given'))
        return call.sync_detailed(ROBOT, client=client, **fields)

    trusted = ssl.create_default_context(cafile=str(CERTIFICATE))
    with package.AuthenticatedClient(
        f'https://localhost:{site.port}/api', operator.token, verify_ssl=trusted, timeout=DEADLINE
    ) as client:
        wrong = ask('start_command', 'StartCommandBody', given={'name': 'Drvie'})
        assert wrong.status_code == 409 and wrong.parsed.reason
        for _ in range(2):
            key = {'idempotency_key': 'generated'}
            started = ask('start_command', 'StartCommandBody', given={'name': 'Drive', 'autonomy': 'low'}, **key)
            assert started.status_code == 200 and started.parsed['result'] == 'applied'
        wait_until(lambda: ask('status_of_robot').parsed['decisions'], 'the question')
        assert ask('input_command', 'InputCommandBody', given={'value': '1 2 0'}).parsed['result'] == 'applied'
        wait_until(lambda: ask('status_of_robot').parsed['decisions'][0]['path'] == '/Accept', 'the next question')
        assert ask('confirm_command', 'ConfirmCommandBody', given={}).parsed['result'] == 'applied'
        wait_until(lambda: not ask('status_of_robot').parsed['decisions'], 'the drive')
        assert ask('stop_command', 'StopCommandBody', given={}).parsed['result'] == 'applied'


def listen(client: Client, heard: list[str]) -> None:
    """Add what a stream of events sends to a list."""
    connection = client.connection()
    connection.request('GET', f'/api/robots/{ROBOT}/events', headers={'Authorization': f'Bearer {client.token}'})
    answer = connection.getresponse()
    with contextlib.suppress(OSError, ValueError):
        while line := answer.readline():
            heard.append(line.decode())


def test_what_is_refused_and_why(site: Site) -> None:
    maintainer = site.client('maintainer')
    for token in ('', 'wrong', site.tokens['observer'][:-1]):
        assert Client(site.port, token).ask('GET', '/robots')[0] == 401
    for path, body, status, reason in (
        ('/robots/nobody/commands/start', {}, 404, "no robot 'nobody' was found"),
        (f'/robots/{ROBOT}/commands/strat', {}, 404, "did you mean 'start'?"),
        (f'/robots/{ROBOT}/commands/start', {}, 400, "'name' is missing"),
        (f'/robots/{ROBOT}/commands/start', {'name': ['a']}, 400, "'name' has to be a text or a number"),
        (f'/robots/{ROBOT}/commands/start', {'name': 'a', 'speed': 1}, 400, "start has no 'speed'"),
        (f'/robots/{ROBOT}/commands/synthesize', {'file': '/etc/passwd'}, 400, "synthesize has no 'file'"),
        (f'/robots/{ROBOT}/commands/start', b'{', 400, 'the body is not JSON'),
        (f'/robots/{ROBOT}/commands/start', b'[' * 100_000, 400, 'the body is not JSON'),
        (f'/robots/{ROBOT}/commands/start', [1], 400, 'the body has to be an object'),
        (f'/robots/{ROBOT}/commands/note', {'text': '--help'}, 503, ''),
        (f'/robots/{ROBOT}/commands/note', {'text': ['a', '--ros-args', 'b']}, 400, "'--ros-args' is for the command"),
        (f'/robots/{ROBOT}/commands/start', b' ' * (BODY_BYTES + 10), 413, ''),
    ):
        code, answer = maintainer.ask('POST', path, body)
        assert (code, reason in answer['reason']) == (status, True), (path, body if len(str(body)) < 99 else '', answer)
    assert maintainer.ask('POST', f'/robots/{ROBOT}/commands/note', b'{}', Content_Type='text/plain')[0] == 415
    assert maintainer.ask('GET', '/robots', Origin='https://elsewhere.example')[0] == 403
    assert maintainer.ask('GET', '/robots', Host='elsewhere.example')[0] == 421
    assert maintainer.ask('GET', '/incidents/..%2f..%2fx/y')[0] in (400, 404)


def test_the_description_has_each_command_once_and_nothing_hangs_in_the_air() -> None:
    known = description()
    identifiers = [one['operationId'] for path in known['paths'].values() for one in path.values()]
    assert len(identifiers) == len(set(identifiers))
    for spec in offered():
        assert f'/robots/{{robot}}/commands/{spec.name.replace(" ", "_")}' in known['paths']
    for path, methods in known['paths'].items():
        (operation,) = methods.values()
        named = {one['name'] for one in operation['parameters'] if one['in'] == 'path'}
        assert named == {part[1:-1] for part in path.split('/') if part.startswith('{')}, path
    assert json.loads(json.dumps(known)) == known


@given(st.data())
def test_what_the_schema_allows_is_a_line_and_nothing_else_is_in_it(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from([one for one in offered() if one.arguments]))
    text = st.text(max_size=20)
    given_ = {
        argument.name.lower().split('=')[0].replace(' ', '_'): data.draw(
            st.lists(text, min_size=1, max_size=3) if argument.repeated else text
        )
        for argument in spec.arguments
    }
    try:
        line = line_of(spec, given_)
    except UsageError:
        return  # such as a name with =, which two arguments share
    told = ' '.join(line.words)
    for value in given_.values():
        for one in value if isinstance(value, list) else [value]:
            assert str(one) in told, 'no text is an option, or lost'
    assert not line.options and line.spec.name.startswith(spec.name)


@pytest.mark.parametrize(
    ('given_', 'asked'),
    [
        ({}, ('', [])),
        ({'path': '/'}, ('/', [])),
        ({'key': ['speed', 'goal']}, ('', ['speed', 'goal'])),
        ({'path': '/Inner', 'key': ['speed']}, ('/Inner', ['speed'])),
    ],
)
def test_userdata_is_selected_by_its_machine_and_by_its_keys(
    given_: dict[str, Any], asked: tuple[str, list[str]]
) -> None:
    class Robot(ProgramRobot):
        def userdata(self, path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
            assert (path, [*keys]) == asked
            return ()

    robot, userdata = Robot(), next(spec for spec in offered() if spec.name == 'userdata')
    assert perform(line_of(userdata, given_), robot.station(), robot)[0] is ExitCode.OK


def test_of_users_that_are_added_at_the_same_time_none_is_lost(tmp_path: Path) -> None:
    file = tmp_path / 'users.yaml'
    command = [sys.executable, '-m', 'flexbt_console', 'users', str(file), '--add', 'bob']
    with contextlib.ExitStack() as stack:
        with alone_in(tmp_path):
            adding = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            waits = re.compile(rf'-> FLOCK .* {adding.pid} ')
            wait_until(
                lambda: waits.search(Path('/proc/locks').read_text()) or adding.poll() is not None, 'one that waits'
            )
            write_users(file, [User('ann', Role.OPERATOR, token_hash('t'))])
        assert adding.wait(DEADLINE) == 0
    assert sorted(one.name for one in read_users(file).values()) == ['ann', 'bob']
    without = subprocess.run([*command[:-2], '--role', 'observer'], capture_output=True, text=True)
    assert (without.returncode, '--role needs --add' in without.stderr) == (2, True)


def test_a_file_of_users_that_is_not_right_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'users.yaml'
    good = f'ann: {{role: operator, token: "{token_hash("t")}"}}\n'
    file.write_text(good)
    file.chmod(0o600)
    assert [(one.name, one.role) for one in read_users(file).values()] == [('ann', Role.OPERATOR)]
    for text, reason in (
        (good.replace('operator', 'oprator'), "there is no role 'oprator'; known: observer, operator, maintainer"),
        (good + good.replace('ann', 'bob'), 'the hash of a token of its own'),
        (good.replace('sha256:', ''), 'token has to be sha256:'),
        (good.replace('ann', '"a b"'), 'a name has letters, digits'),
        ('- ann\n', 'has to have an entry for each user'),
        ('ann: [', 'users.yaml'),
    ):
        file.write_text(text)
        with pytest.raises(UsageError, match=reason.replace('[', r'\[')):
            read_users(file)
    file.chmod(0o666)
    with pytest.raises(UsageError, match='others can change who may do what'):
        read_users(file)
