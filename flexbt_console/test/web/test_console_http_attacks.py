# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP interface under attack: tokens, floods, damaged requests, replays, races, and certificates."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
import os
import socket
import ssl
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession, WSCloseCode, WSMsgType, web
from aiohttp.test_utils import make_mocked_request
from http_support import CERTIFICATE, ROBOT, Client, Site, console, served

from flexbt_console.ui.http_interface import BODY_BYTES, BURST, MOST_AT_ONCE, RATE, HttpInterface
from flexbt_console.ui.web.access import Access
from flexbt_core.clock.rates import SenderRates
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_testing.nodes.scripted_executive import ScriptedExecutive
from flexbt_testing.waiting import DEADLINE, wait_until

MOST_OF_USER = MOST_AT_ONCE // 2
STATUS = f'/robots/{ROBOT}'
PATH = f'/api/robots/{ROBOT}/commands'


@pytest.fixture
def robot(site: Site, executives: Any) -> ScriptedExecutive:
    """Start a robot that the site sees."""
    executive: ScriptedExecutive = executives(ROBOT, heartbeat=0.2)
    observer = site.client('observer')

    def is_seen() -> bool:
        known = observer.ask('GET', STATUS)[1]
        return bool(known.get('link') == 'live' and known.get('executive_id') == executive.status.executive_id)

    wait_until(is_seen, 'the robot')
    return executive


def raw(site: Site, data: bytes) -> bytes:
    """Send bytes as they are, and return all that comes until the server closes the connection or falls silent."""
    with connected(site) as connection:
        connection.sendall(data)
        received = b''
        with contextlib.suppress(OSError):
            while part := connection.recv(65_536):
                received += part
                if received.endswith(b'}'):
                    break
        return received


def connected(site: Site) -> ssl.SSLSocket:
    trusted = ssl.create_default_context(cafile=str(CERTIFICATE))
    plain = socket.create_connection(('localhost', site.port), timeout=DEADLINE)
    return trusted.wrap_socket(plain, server_hostname='localhost')


def head(site: Site, user: str, first: str, *lines: str) -> bytes:
    """Return the head of a request."""
    token = f'Authorization: Bearer {site.tokens[user]}'
    return '\r\n'.join([first, 'Host: localhost', token, *lines, '', '']).encode('latin-1')


def still_serves(site: Site) -> None:
    """Assert that the site answers another user at once."""
    assert site.client('maintainer').ask('GET', '/robots')[0] == 200


def test_a_token_counts_only_in_its_header_and_as_long_as_its_user_is_in_the_file(site: Site, robot: Any) -> None:
    bob = site.add('bob', 'operator')
    wait_until(lambda: bob.ask('GET', '/robots')[0] == 200, 'a user who was added while the console runs')
    token = bob.token
    for path in ('/robots?token=' + token, '/robots?access_token=' + token):
        assert Client(site.port).ask('GET', path)[0] == 401
    for authorization in (token, f'Basic {token}', f'Bearer {token} {token}', f'Bearer {token}x', 'Bearer \xff'):
        assert Client(site.port).ask('GET', '/robots', Authorization=authorization)[0] == 401, authorization
    assert bob.command('force', {'path': '/Accept', 'outcome': 'failed'})[0] == 403
    console('users', str(site.users), '--add', 'bob', '--role', 'maintainer')
    wait_until(lambda: bob.ask('GET', '/robots')[0] == 401, 'the end of the token that was replaced')
    bob = site.add('bob', 'observer')
    wait_until(lambda: bob.ask('GET', '/robots')[0] == 200, 'the new token')

    connection = bob.connection()
    connection.request('GET', f'/api{STATUS}/events', headers={'Authorization': f'Bearer {bob.token}'})
    stream = connection.getresponse()
    assert stream.readline().startswith(b'event: ')
    console('users', str(site.users), '--remove', 'bob')
    wait_until(lambda: bob.ask('GET', '/robots')[0] == 401, 'the end of a removed user')
    while stream.readline():  # what he listens to ends too
        pass
    assert bob.command('stop')[0] == 401
    kept = site.users.read_text()
    site.users.write_text('ann: [')
    still_serves(site)
    site.users.write_text(kept)
    assert site.client('observer').ask('GET', '/robots')[0] == 200


def test_the_page_of_a_user_who_is_removed_ends(site: Site) -> None:
    asyncio.run(watch_a_page_end(site))


async def watch_a_page_end(site: Site) -> None:
    """Open a page, and remove its user."""
    eve = site.add('eve', 'operator')
    trusted = ssl.create_default_context(cafile=str(CERTIFICATE))
    address = f'https://localhost:{site.port}/link'
    async with ClientSession() as session, session.ws_connect(address, ssl=trusted) as page:
        await page.send_json({'hello': eve.token})
        assert 'hello' in await page.receive_json(timeout=DEADLINE)
        removal = asyncio.create_task(asyncio.to_thread(console, 'users', str(site.users), '--remove', 'eve'))
        async with asyncio.timeout(DEADLINE):
            while (message := await page.receive()).type is WSMsgType.TEXT:
                pass  # it answers pings, also while the console starts
        await removal
        # What the server says. Its own code is another one if the connection ends before it has answered.
        assert (message.type, message.data) == (WSMsgType.CLOSE, WSCloseCode.POLICY_VIOLATION)


def test_wrong_tokens_keep_nobody_out(site: Site) -> None:
    with ThreadPoolExecutor(8) as pool:
        wrong = [pool.submit(Client(site.port, f'{number}').ask, 'GET', '/robots') for number in range(200)]
        right = [pool.submit(site.client('operator').ask, 'GET', '/robots') for _ in range(20)]
        assert {one.result()[0] for one in right} == {200}
        assert {one.result()[0] for one in wrong} == {401}


@pytest.mark.parametrize(
    'body',
    [
        b'{"name": "Drive", "name": "Rob"}',
        b'{"name": NaN}',
        b'{"name": Infinity}',
        b'{"name": "\xff"}',
        b'{"name": {"name": {}}}',
        b'[' * 400_000,
        b'{"a":' * 100_000,
        b'"Drive"',
        b'null',
        b'\x00',
        b'{"name": true}',
        b'{"name": "Drive", "autonomy": ["high"]}',
        b'{"name": "Drive", "wait": "yes"}',
        b'{"name": "Drive", "wait": 1}',
        b'{"name": 1e999}',
        b'{"__class__": "x"}',
    ],
)
def test_a_damaged_body_is_told_and_has_no_effect(site: Site, robot: ScriptedExecutive, body: bytes) -> None:
    status, answer = site.client('operator').command('start', body)
    assert status == 400 and answer['reason'] and len(json.dumps(answer)) < 3000
    assert robot.received == []


def test_large_and_odd_fields_are_answered_briefly(site: Site, robot: ScriptedExecutive) -> None:
    operator = site.client('operator')
    large = 'x' * (BODY_BYTES - 100)
    for body in (
        {'name': large},
        {'name': '\ud800'},
        {'name': 'a\x00b\x1b[2J'},
        {'name': 'Drive', 'input': [large]},
        {'name': 'Drive', 'input': ['a'] * 100_000},
        {'name': 'Drive', 'autonomy': large},
        {large: 'Drive'},
        {'name': '--help'},
        {'name': 10**4000},
    ):
        status, answer = operator.command('start', body)
        assert status in (400, 409, 413), (status, str(answer)[:300])
        assert len(json.dumps(answer)) < 5000
    assert not robot.applied
    for name, value in (('Idempotency-Key', 'k' * 7000), ('Idempotency-Key', '\xff\xfe'), ('Content-Type', 'x' * 7000)):
        status, answer = operator.command('start', {'name': 'Drive'}, **{name.replace('-', '_'): value})
        assert status in (400, 415) and len(json.dumps(answer)) < 3000, (name, status, str(answer)[:200])
    packed = gzip.compress(b' ' * 200_000_000)
    assert operator.command('start', packed, Content_Encoding='gzip')[0] in (400, 413, 415)
    assert not robot.applied
    paths = '/robots/%ff%fe', '/robots/..%2f..', f'{STATUS}/commands/%00', '/recordings/..%2f..%2fx', '/x' * 3000
    for path in paths:
        status, answer = operator.ask('POST' if 'commands' in path else 'GET', path, {} if 'commands' in path else None)
        assert status in (400, 404, 414), (path[:80], status)
    still_serves(site)


def test_what_is_outside_of_recordings_and_incidents_is_not_reached(site: Site) -> None:
    observer = site.client('observer')
    recordings, incidents = (site.home / '.ros' / 'flexbt' / name for name in ('recordings', 'incidents'))
    incident = incidents / '20260101_000000_stop'
    incident.mkdir(parents=True)
    recordings.mkdir(parents=True, exist_ok=True)
    occurrence = {'kind': 'stop', 'time': 1.0, 'text': 'STOP'}
    (incident / 'incident.json').write_text(json.dumps({'robot': '/r', 'occurrences': [occurrence]}))
    (incident / 'incident.md').write_text('what happened')
    (incident / 'link.md').symlink_to(site.users)
    (incident / 'folder').symlink_to(site.home)
    os.mkfifo(incident / 'pipe.md')
    (recordings / 'out.mcap').symlink_to(site.users)
    listed = observer.ask('GET', '/incidents')[1]['incidents']
    assert [one['files'] for one in listed] == [['incident.json', 'incident.md']]
    name = incident.name
    assert observer.ask('GET', f'/incidents/{name}/incident.md') == (200, b'what happened')
    for path in (
        f'/incidents/{name}/link.md',
        f'/incidents/{name}/pipe.md',
        f'/incidents/{name}/folder/users.yaml',
        f'/incidents/{name}/../../../../users.yaml',
        f'/incidents/{name}/%2e%2e/%2e%2e/%2e%2e/%2e%2e/users.yaml',
        f'/incidents/{name}//etc/passwd',
        f'/incidents/%2e%2e/{name}/incident.md',
        '/recordings/../../../users.yaml',
        '/recordings/%2fetc%2fpasswd',
        '/recordings/out.mcap',
        '/recordings/out',
        f'/recordings/../incidents/{name}/incident.md',
    ):
        status, answer = observer.ask('GET', path)
        assert status in (400, 404) and b'role:' not in str(answer).encode(), (path, status, answer)


def test_the_same_request_has_its_effect_once_also_over_a_restart_and_another_one_is_told(
    site: Site, robot: ScriptedExecutive
) -> None:
    operator, maintainer = site.client('operator'), site.client('maintainer')
    key = {'Idempotency_Key': 'night-1'}
    status, first = operator.command('start', {'name': 'Drive'}, **key)
    assert (status, first['result']) == (200, 'applied')
    for client, name, body in (
        (operator, 'start', {'name': 'Drive', 'autonomy': 'high'}),
        (operator, 'note', {'text': 'x'}),
    ):
        status, answer = client.command(name, body, **key)
        assert status == 422 and 'another request had this Idempotency-Key' in answer['reason'], answer
    status, answer = maintainer.command('note', {'text': 'of another user'}, **key)
    assert (status, answer['result']) == (200, 'applied')
    again = Site(site.home, site.users, site.tokens)
    with served(again):  # as after a restart of the console
        client = again.client('operator')
        wait_until(lambda: client.ask('GET', STATUS)[1].get('link') == 'live', 'the robot')
        status, answer = client.command('start', {'name': 'Drive'}, **key)
        assert (status, answer['id']) == (200, first['id']), answer
    assert Counter(one.kind for one in robot.applied)[robot.applied[0].kind] == 1


def test_an_answer_that_is_repeated_is_not_refused_because_it_was_applied(site: Site, robot: ScriptedExecutive) -> None:
    operator = site.client('operator')
    assert operator.command('start', {'name': 'Drive'})[0] == 200
    answer = {'value': '1 2 0'}
    first = operator.command('input', answer, Idempotency_Key='answer-1')
    assert first[0] == 200, first
    assert operator.command('input', answer, Idempotency_Key='answer-1') == first
    assert operator.command('input', answer, Idempotency_Key='answer-2')[0] == 409


def test_of_two_operators_at_one_moment_one_answer_counts(site: Site, robot: ScriptedExecutive) -> None:
    clients = [site.client('operator'), site.client('maintainer')]
    with ThreadPoolExecutor(2) as pool:

        def both(name: str, *bodies: Any) -> list[int]:
            sent = [pool.submit(client.command, name, body) for client, body in zip(clients, bodies, strict=True)]
            return sorted(one.result()[0] for one in sent)

        assert both('start', {'name': 'Drive'}, {'name': 'Drive'}) == [200, 409]
        wait_until(lambda: clients[0].ask('GET', STATUS)[1]['decisions'], 'the question')
        codes = both('input', {'value': '1 2 0'}, {'value': '3 4 0'})
        assert codes[0] == 200 and codes[1] in (200, 400, 409)
        applied = [one for one in robot.applied if one.decision_id == 'd1']
        assert len(applied) == 1, 'one decision has one answer'


def test_a_stop_finds_a_place_among_commands_that_wait_and_users_do_not_take_each_others(
    site: Site, executives: Any
) -> None:
    executive = executives(ROBOT, heartbeat=0.2)
    operator, maintainer = site.client('operator'), site.client('maintainer')
    wait_until(lambda: operator.ask('GET', STATUS)[1].get('link') == 'live', 'the robot')
    executive.do(lambda: setattr(executive.faults, 'swallow_commands', True))
    with ThreadPoolExecutor(3 * MOST_OF_USER) as pool:
        notes = [pool.submit(operator.command, 'note', {'text': 'x'}) for _ in range(2 * MOST_OF_USER)]
        wait_until(lambda: any(one.done() and one.result()[0] == 503 for one in notes), 'no place for more')
        others = [pool.submit(maintainer.command, 'behaviors'), pool.submit(operator.command, 'stop')]
        assert others[0].result()[0] == 200
        assert others[1].result()[0] in (200, 504), 'it was sent'
        assert Counter(one.result()[0] for one in notes) == {504: MOST_OF_USER, 503: MOST_OF_USER}
    assert ExecutiveCommand.STOP in {one.kind for one in executive.received}


def test_streams_that_nobody_reads_end_and_keep_nobody_out(site: Site, robot: ScriptedExecutive) -> None:
    first = f'GET /api{STATUS}/events HTTP/1.1'
    open_ = [connected(site) for _ in range(MOST_OF_USER + 5)]
    try:
        for one in open_:
            one.sendall(head(site, 'observer', first))
        answers = Counter(one.recv(12).split()[-1] for one in open_)
        assert answers == {b'200': MOST_OF_USER, b'503': 5}
        stream = connected(site)
        stream.sendall(head(site, 'operator', first))
        assert b'200' in stream.recv(100)
        still_serves(site)
        for one in open_:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b'\1\0\0\0\0\0\0\0')  # gone without a word
            one.close()

        def has_place() -> bool:
            with connected(site) as again:
                again.sendall(head(site, 'observer', first))
                return b'200' in again.recv(100)

        wait_until(has_place, 'places of the streams that are gone')
    finally:
        for one in [*open_, stream]:
            one.close()


def test_slow_and_half_requests_keep_nobody_out(site: Site) -> None:
    begun = head(site, 'operator', f'POST {PATH}/note HTTP/1.1', 'Content-Type: application/json', 'Content-Length: 90')
    stuck = [connected(site) for _ in range(120)]
    try:
        for number, one in enumerate(stuck):
            one.sendall(begun + b'{' if number % 2 else begun[:30])
        still_serves(site)
        body = stuck[1].recv(1000)
        assert b'408' in body.split(b'\r\n')[0], body
    finally:
        for one in stuck:
            one.close()


def test_a_request_that_two_servers_would_read_differently_is_refused(site: Site) -> None:
    smuggled = b'0\r\n\r\nGET /api/robots HTTP/1.1\r\nHost: localhost\r\n\r\n'
    line, kind = f'POST {PATH}/note HTTP/1.1', 'Content-Type: application/json'
    for lines in (
        ('Content-Length: 2', 'Content-Length: 3'),
        ('Content-Length: 2', 'Transfer-Encoding: chunked'),
        ('Transfer-Encoding: xchunked',),
        ('Transfer-Encoding: chunked', 'Transfer-Encoding: identity'),
        ('Content-Length: +2',),
        ('Content-Length: -1',),
        ('Content-Length : 2',),
        ('Content-Length: 2\n',),
        ('X: a\x00b',),
        (' folded: 1',),
    ):
        answer = raw(site, head(site, 'operator', line, kind, *lines) + smuggled)
        assert answer.split(b' ')[1] == b'400', (lines, answer[:200])
        assert answer.count(b'HTTP/1.') == 1, lines
    still_serves(site)


def test_a_certificate_that_has_expired_is_told_at_the_start(site: Site) -> None:
    expired = CERTIFICATE.with_name('expired.pem')
    told = f'--certificate {expired}: certificate has expired; browsers warn of it, and programs refuse it: renew it\n'
    for certificate, text in ((expired, told), (CERTIFICATE, '')):
        words = ['web', '--users', str(site.users), '--certificate', str(certificate), '--port', '0']
        command = [sys.executable, '-m', 'flexbt_console', *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as console:
            assert console.stdout is not None
            assert 'https://127.0.0.1:' in console.stdout.readline(), 'operators keep their page'
            console.terminate()
            assert console.communicate()[1] == text


def test_a_certificate_that_cannot_be_used_is_told_at_the_start(site: Site, tmp_path: Path) -> None:
    def made(name: str, *more: str) -> tuple[Path, Path]:
        key, certificate = tmp_path / f'{name}.key', tmp_path / f'{name}.pem'
        words = ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:prime256v1', '-subj', '/CN=localhost']
        subprocess.run(
            ['openssl', *words, '-keyout', str(key), '-out', str(certificate), *(more or ('-nodes',))],
            check=True,
            capture_output=True,
        )
        return certificate, key

    good, its_key = made('good')
    _, other_key = made('other')
    locked, locked_key = made('locked', '-passout', 'pass:secret')
    (tmp_path / 'empty.pem').touch()
    for certificate, key, reason in (
        (good, other_key, 'MISMATCH'),
        (tmp_path / 'empty.pem', its_key, 'cannot be used'),
        (tmp_path / 'none.pem', its_key, 'cannot be used'),
        (good, tmp_path, 'cannot be used'),
        (locked, locked_key, 'the key has a passphrase'),
        (good, tmp_path / 'no.key', f'with --key {tmp_path}/no.key: cannot be used: No such file or directory'),
        (its_key, good, 'cannot be used'),
    ):
        words = ['web', '--users', str(site.users), '--certificate', str(certificate), '--key', str(key), '--port', '0']
        ended = subprocess.run(
            [sys.executable, '-m', 'flexbt_console', *words], capture_output=True, text=True, timeout=DEADLINE
        )
        assert ended.returncode == 2 and reason in ended.stderr and 'Traceback' not in ended.stderr, (reason, ended)
    with pytest.raises(ssl.SSLCertVerificationError):  # who does not trust it sends nothing
        ssl.create_default_context().wrap_socket(
            socket.create_connection(('localhost', site.port), timeout=DEADLINE), server_hostname='localhost'
        )
    with socket.create_connection(('localhost', site.port), timeout=DEADLINE) as plain:
        plain.sendall(head(site, 'operator', 'GET /api/robots HTTP/1.1'))
        with contextlib.suppress(ConnectionError):
            assert b'robots' not in plain.recv(1000)
    still_serves(site)


def test_only_the_request_of_a_stop_is_free_of_the_limit() -> None:
    robots: Any = None
    interface = HttpInterface(robots, lambda mirror, link, name: robots, Access(), lambda user: 'ann')
    interface._rates = SenderRates(RATE, BURST, lambda: 0.0)

    async def ask(method: str, path: str) -> int:
        answer = await interface._known(make_mocked_request(method, path), lambda request: answered())
        return answer.status

    async def answered() -> web.Response:
        return web.Response()

    async def flood() -> None:
        path = '/api/incidents/any/commands/stop'
        assert {await ask('GET', path) for _ in range(BURST)} == {200}
        assert await ask('GET', path) == 429
        assert await ask('POST', f'{PATH}/stop') == 200

    asyncio.run(flood())


def test_a_flood_of_requests_is_limited_for_its_user_alone(site: Site) -> None:
    flooder, other = site.client('observer'), site.client('operator')
    with ThreadPoolExecutor(16) as pool:
        flood = [pool.submit(flooder.ask, 'GET', '/robots') for _ in range(600)]
        mine = [pool.submit(other.ask, 'GET', '/robots') for _ in range(10)]
        assert {one.result()[0] for one in mine} == {200}
        codes = Counter(one.result()[0] for one in flood)
    assert set(codes) <= {200, 429} and codes[200] >= 100, codes
