# SPDX-License-Identifier: BSD-3-Clause
"""A console that serves its HTTP interface to users with roles, and a client of it."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import ssl
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from flexbt_testing.waiting import DEADLINE

CERTIFICATE = Path(__file__).with_name('localhost.pem')
"""Made for these tests alone: its key is in the same file."""


class Client:
    """A program with the token of a user."""

    def __init__(self, port: int, token: str = '') -> None:
        self.port, self.token = port, token

    def connection(self) -> http.client.HTTPSConnection:
        """Return a new connection, which trusts the certificate."""
        trusted = ssl.create_default_context(cafile=str(CERTIFICATE))
        return http.client.HTTPSConnection('localhost', self.port, timeout=DEADLINE, context=trusted)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        """Return the status and the JSON of an answer."""
        with contextlib.closing(self.connection()) as connection:
            sent = {
                'Authorization': f'Bearer {self.token}',
                **{key.replace('_', '-'): it for key, it in headers.items()},
            }
            data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
            if data is not None:
                sent.setdefault('Content-Type', 'application/json')
            connection.request(method, f'/api{path}', data, sent)
            answer = connection.getresponse()
            told = answer.read()
            return answer.status, json.loads(told) if answer.getheader('Content-Type', '').startswith(
                'application/json'
            ) else told

    def command(self, name: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        return self.ask('POST', f'/robots/{ROBOT}/commands/{name}', body, **headers)


ROBOT = f'http{os.getpid()}'


@dataclass
class Site:
    """A running console: its home directory, the file of its users and their tokens, and its port."""

    home: Path
    users: Path
    tokens: dict[str, str]
    port: int = 0

    def client(self, user: str) -> Client:
        return Client(self.port, self.tokens.get(user, ''))

    def add(self, user: str, role: str) -> Client:
        """Add a user."""
        done = console('users', str(self.users), '--add', user, '--role', role)
        self.tokens[user] = done.stdout.split('now: ')[1].split()[0]
        return self.client(user)


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Yield a console with the users observer, operator and maintainer."""
    home = tmp_path_factory.mktemp('site')
    site = Site(home, home / 'users.yaml', {})
    for role in ('observer', 'operator', 'maintainer'):
        site.add(role, role)
    kept = site.users.read_text()
    assert site.users.stat().st_mode & 0o777 == 0o600 and not any(token in kept for token in site.tokens.values())
    with served(site):
        yield site


@contextlib.contextmanager
def served(site: Site) -> Iterator[None]:
    """Serve a site during a ``with`` block."""
    words = ['web', '--users', str(site.users), '--certificate', str(CERTIFICATE), '--port', '0', '--namespace', ROBOT]
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexbt_console', *words],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'HOME': str(site.home)},
    )
    assert process.stdout is not None
    address = process.stdout.readline()
    assert 'https://127.0.0.1:' in address and 'token' not in address, address
    site.port = int(address.split(':')[2].split('/')[0])
    try:
        yield
    finally:
        process.kill()
        process.communicate()


def console(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, '-m', 'flexbt_console', *words], capture_output=True, text=True, check=True)
