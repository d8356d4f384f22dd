# SPDX-License-Identifier: BSD-3-Clause
"""What systemd is told of a node: that it is ready, that it is alive as long as it answers, and that it ends."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.lifecycle import systemd
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.lifecycle.systemd import SystemdReports
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.waiting import DEADLINE, wait_until


class Systemd:
    """The socket of systemd."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self.heard: list[str] = []

    def take(self) -> list[str]:
        """Return all reports so far."""
        while True:
            try:
                self.heard.append(self._end.recv(100).decode())
            except BlockingIOError:
                return self.heard


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Systemd]:
    monkeypatch.setattr(systemd, 'PERIOD', 0.0)
    address = str(tmp_path / 'notify')
    monkeypatch.setenv('NOTIFY_SOCKET', address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.setblocking(False)
        end.bind(address)
        yield Systemd(end)


def test_a_node_reports_that_it_is_ready_alive_and_ending(manager: Systemd) -> None:
    with NodeRuntime.open('watched') as runtime:
        token = LivelinessToken(runtime)
        wait_until(lambda: 'WATCHDOG=1' in manager.take(), 'alive')
        assert 'READY=1' not in manager.heard
        token.set_ready(True)
        token.set_ready(True)
    assert (manager.take().count('READY=1'), manager.heard[-1]) == (1, 'STOPPING=1')


def test_a_node_that_hangs_does_not_report_that_it_is_alive(manager: Systemd) -> None:
    with NodeRuntime.open('watched') as runtime, NodeRuntime.open('other') as other:
        LivelinessToken(runtime)
        wait_until(lambda: 'WATCHDOG=1' in manager.take(), 'alive')
        late, go_on, beats = threading.Event(), threading.Event(), list[float]()
        other.health.on_beat(lambda: beats.append(time.monotonic()))
        runtime.health.on_late(lambda problem: late.set())
        runtime.post(lambda: go_on.wait(DEADLINE))
        assert late.wait(DEADLINE)
        manager.take().clear()
        seen = len(beats)
        wait_until(lambda: len(beats) > seen + 5, 'several beats of a node that answers')
        assert manager.take() == []
        go_on.set()


def test_without_systemd_nothing_is_sent_and_nothing_fails(tmp_path: Path) -> None:
    for environment in ({}, {'NOTIFY_SOCKET': str(tmp_path / 'gone')}, {'NOTIFY_SOCKET': '@flexbt-nobody'}):
        reports = SystemdReports(environment)
        reports.beat()
        reports.ready(True)
        reports.ending()
