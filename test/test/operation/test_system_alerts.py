# SPDX-License-Identifier: BSD-3-Clause
"""A person is called, once, also after a restart: about a robot that waits for a decision, and then dies, and about an
incident; and acknowledges from another computer.
"""

from __future__ import annotations

import contextlib
import json
import signal
import sqlite3
import threading
from collections.abc import Iterator
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer, run_console, start_console
from flexbt_testing.waiting import wait_until

RULES = """\
contacts: people.yaml
page: http://station:8465/
robots: /
rules: [{when: [decision, silent], call: anna, over: true}]
"""
DEADLINE = 120.0


@pytest.fixture
def calls() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the address of a service, and what it has got."""
    got: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append(json.loads(self.rfile.read(int(self.headers['Content-Length']))))
            self.send_response(200)
            self.send_header('Content-Length', '0')
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f'json://127.0.0.1:{server.server_port}/SECRET', got
    server.shutdown()
    server.server_close()


def test_a_person_is_called_when_a_robot_waits_and_when_it_dies(
    tmp_path: Path, calls: tuple[str, list[dict[str, Any]]]
) -> None:
    address, got = calls
    people, rules = tmp_path / 'people.yaml', tmp_path / 'alerts.yaml'
    people.write_text(f'anna: {address}')
    people.chmod(0o600)
    rules.write_text(RULES)
    words = ('alerts', str(rules), '--state', str(tmp_path / 'alerts.db'))
    said = ''
    with Stack(tmp_path) as stack:
        stack.start('onboard_executive', {'use_sim_time': 'false'})
        console_answer('start', 'Inspect Site', 'duration=0.1', '--input', 'site=string:"gate"', '--autonomy', 'off')
        (decision,) = wait_until(lambda: console_answer('status')['decisions'], 'decision', DEADLINE)
        for is_last in (False, True):
            with start_console(*words) as program:
                wait_until(lambda: got, 'a call', DEADLINE)
                if is_last:
                    stack.end('onboard_executive', signal.SIGKILL, DEADLINE)
                    wait_until(lambda: any('is silent' in one['title'] for one in got), lambda: got, DEADLINE)
                else:
                    checked = run_console(*words, '--check')
                    assert checked.returncode == 0 and 'now /: /Look wants done' in checked.stdout, checked
                program.send_signal(signal.SIGINT)
                said += ''.join(program.communicate(timeout=DEADLINE))
                assert program.returncode == 0, said
    assert [one['title'] for one in got] == ['/ waits for a decision', '/ is silent']
    assert f'http://station:8465/?robot=/&decision={decision["id"]}' in got[0]['message'].splitlines()
    assert 'SECRET' not in said
    acknowledge = got[1]['message'].splitlines()[-1].rpartition(': ')[2].split()
    acknowledged = run_console(*acknowledge, *words[2:])
    assert acknowledged.stdout.startswith(f'acknowledged {acknowledge[-1]}  /:'), acknowledged


INCIDENT_RULES = """\
contacts: people.yaml
page: http://station:8465/
robots: /
rules: [{when: incident, call: anna, then: [{after: 1 s, call: anna}, {after: 1 h, call: anna}]}]
"""


def post(port: int, token: str, body: object) -> tuple[int, Any]:
    """Acknowledge on a page; return the status and the JSON of the answer."""
    with contextlib.closing(HTTPConnection('127.0.0.1', port)) as connection:
        headers = {'Authorization': f'Bearer {token}', 'Content-Type': 'application/json'}
        connection.request('POST', '/api/robots/_/commands/alerts_acknowledge', json.dumps(body), headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())


def test_an_incident_calls_a_person_once_who_acknowledges_from_another_computer(
    tmp_path: Path, calls: tuple[str, list[dict[str, Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the page, as a user with a role. Alerts and black box are killed in between."""
    address, got = calls
    monkeypatch.setenv('HOME', str(tmp_path))
    people, rules, users = tmp_path / 'people.yaml', tmp_path / 'alerts.yaml', tmp_path / 'users.yaml'
    people.write_text(f'anna: {address}')
    people.chmod(0o600)
    rules.write_text(INCIDENT_RULES)
    tokens = {}
    for name in ('observer', 'operator'):
        told = run_console('users', str(users), '--add', name, '--role', name)
        tokens[name] = told.stdout.splitlines()[0].rpartition(': ')[2]
    box = {'ring': str(tmp_path / 'ring'), 'after': '0.1', 'use_sim_time': 'false'}
    with Stack(tmp_path) as stack:
        stack.start('onboard_executive', {'use_sim_time': 'false'})
        stack.start('black_box', box)
        wait_until(lambda: 'begins to find' in stack.output('black_box'), 'the black box', DEADLINE)
        folder = console_answer('incident')['folder']
        with start_console('alerts', str(rules)) as program:
            wait_until(lambda: len(got) == 2, 'both calls', DEADLINE)
            program.kill()
        stack.kill('black_box')
        stack.start('black_box', box)
        wait_until(lambda: stack.output('black_box').count('begins to find') == 2, 'the black box', DEADLINE)
        with start_console('alerts', str(rules)) as program:
            wait_until(lambda: any('black box itself' in one['message'] for one in got), lambda: got, DEADLINE)
            program.kill()
        mine = [one for one in got if folder in one['message']]
        assert len(mine) == 2 and mine[0]['title'] == '/ has an incident', got
        lines = mine[0]['message'].splitlines()
        assert lines[0] == f'{folder}: somebody has asked for it' and 'http://station:8465/?robot=/' in lines
        number = int(lines[-1].rpartition(' ')[2])
        with start_console('web', '--users', str(users), '--port', '0') as page:
            assert page.stdout is not None
            port = int(page.stdout.readline().split(':')[2].split('/')[0])
            wait_until(lambda: post(port, tokens['observer'], {'number': [number]})[0] == 403, 'a refusal', DEADLINE)
            assert post(port, tokens['operator'], {'number': [number], 'state': '/etc/passwd'})[0] == 400
            assert post(port, tokens['operator'], {'number': [99]})[0] == 409
            status, told = post(port, tokens['operator'], {'number': [number]})
            assert status == 200 and folder in str(told), told
            page.kill()
        with start_console('alerts', str(rules)) as program:
            wait_until(
                lambda: acknowledged_by(tmp_path / '.ros/flexbt/alerts.db')[number], 'the acknowledgment', DEADLINE
            )
            program.kill()
        assert acknowledged_by(tmp_path / '.ros/flexbt/alerts.db')[number].startswith('operator@')


def acknowledged_by(file: Path) -> dict[int, str]:
    """Return who has acknowledged the things that the program remembers on disk."""
    with contextlib.closing(sqlite3.connect(file)) as connection:
        rows = connection.execute("SELECT id, value FROM memory WHERE kind = 'thing'").fetchall()
    return {number: json.loads(text)['acknowledged'] for number, text in rows}
