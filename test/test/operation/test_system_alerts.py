# SPDX-License-Identifier: BSD-3-Clause
"""A robot that waits for a decision, and then dies: a person is called about both, once, also after a restart."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
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
    acknowledge = got[1]['message'].splitlines()[-1].split()  # To acknowledge: console ...
    acknowledged = run_console(*acknowledge[3:], *words[2:])
    assert acknowledged.stdout.startswith(f'acknowledged {acknowledge[-1]}  /:'), acknowledged
