# SPDX-License-Identifier: BSD-3-Clause
"""Consoles and observers in separate processes, in any network, and with any middleware settings."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from multiprocessing.managers import BaseManager
from typing import Any, Final

from rclpy.serialization import serialize_message

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import parse
from flexbt_console.commands.registry import build
from flexbt_console.link.messages import record_of
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.link.surroundings_link import SurroundingsLink
from flexbt_console.mirror.command_tracker import TrackedCommand
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import ExecutiveSnapshot
from flexbt_console.mirror.view import View
from flexbt_msgs.msg import BehaviorList, BehaviorStructure, ExecutiveLog, ExecutiveStatus

from .networks import NetworkNamespace, enter

LOOK_SECONDS: Final = 0.02


@dataclass(slots=True)
class RemoteView:
    """The view of a console, and the first and last time it was read, in seconds of the monotonic clock."""

    first: float
    last: float
    live: bool
    snapshot: ExecutiveSnapshot | None


class RemoteConsole:
    """A console and its views. With a ``scan_period`` (0: no scan) it also shows the robot's surroundings."""

    def __init__(self, operator: str, scan_period: float | None = None) -> None:
        self._runtime = NodeRuntime('console', args=())
        self._mirror = Mirror(self._runtime.steady)
        self._link = ExecutiveLink(self._runtime, self._mirror, operator)
        if scan_period is not None:
            SurroundingsLink(self._runtime, self._mirror, scan_period=scan_period)
        self._make = CommandBuilder(operator)
        self._shown: list[RemoteView] = []
        self._end = threading.Event()
        self._eye = threading.Thread(target=self._watch, daemon=True)
        self._eye.start()

    def close(self) -> None:
        """Close the console properly."""
        self._end.set()
        self._eye.join()
        self._runtime.close()

    def view(self) -> View:
        """Return the current view."""
        return self._mirror.view()

    def shown(self) -> list[RemoteView]:
        """Return all views so far."""
        return list(self._shown)

    def send(self, *words: str, timeout: float = 30.0) -> str:
        """Send a command, written as on the command line, for the current view. Return its identifier."""
        command = build(parse(words), self._mirror.view(), self._make)
        return self._link.send(command, timeout).command.id

    def tracked(self, command_id: str) -> TrackedCommand | None:
        """Return the state of a command."""
        return self._mirror.command(command_id)

    def _watch(self) -> None:
        while not self._end.wait(LOOK_SECONDS):
            before, view, after = time.monotonic(), self._mirror.view(), time.monotonic()
            last = self._shown[-1] if self._shown else None
            if last is not None and (last.live, last.snapshot) == (view.live, view.snapshot):
                last.last = before
            else:
                self._shown.append(RemoteView(after, before, view.live, view.snapshot))


class RemoteObserver:
    """A record of what an executive publishes, and when. It is not an operator, and its link has no faults."""

    def __init__(self) -> None:
        self._runtime = NodeRuntime('observer', args=())
        self._published: dict[int, tuple[float, ExecutiveSnapshot]] = {}
        self._bytes = 0
        self._runtime.call(self._subscribe)

    def close(self) -> None:
        """Close the observer properly."""
        self._runtime.close()

    def published(self) -> dict[int, tuple[float, ExecutiveSnapshot]]:
        """Return the monotonic time and content of each status, by its sequence number."""
        return dict(self._published)

    def latest(self) -> ExecutiveSnapshot | None:
        """Return the newest status."""
        return self._published[max(self._published)][1] if self._published else None

    def payload(self) -> int:
        """Return the bytes of all serialized messages for consoles so far."""
        return self._bytes

    def _subscribe(self) -> None:
        for type, topic in (
            (BehaviorStructure, names.EXECUTIVE_STRUCTURE),
            (BehaviorList, names.EXECUTIVE_BEHAVIORS),
            (ExecutiveLog, names.EXECUTIVE_LOG),
        ):
            self._runtime.node.create_subscription(type, topic, self._count, names.transient_local_qos(names.LOG_DEPTH))
        self._runtime.node.create_subscription(
            ExecutiveStatus, names.EXECUTIVE_STATUS, self._on_status, names.transient_local_qos(100)
        )

    def _on_status(self, status: ExecutiveStatus) -> None:
        self._published[status.sequence] = (time.monotonic(), record_of(status))
        self._count(status)

    def _count(self, message: Any) -> None:
        self._bytes += len(serialize_message(message))


class _Process(BaseManager):
    """A manager that serves the classes above from another process."""


_Process.register('Console', RemoteConsole)
_Process.register('Observer', RemoteObserver)


@contextlib.contextmanager
def remote_console(
    network: NetworkNamespace, environment: Mapping[str, str], operator: str, scan_period: float | None = None
) -> Iterator[RemoteConsole]:
    """Provide a :class:`Console` in a process in that network; its values are copied between the processes."""
    with _remote(network, environment, 'Console', operator, scan_period) as console:
        yield console


@contextlib.contextmanager
def remote_observer(network: NetworkNamespace, environment: Mapping[str, str]) -> Iterator[RemoteObserver]:
    """Provide an observer in a process in that network; its values are copied between the processes."""
    with _remote(network, environment, 'Observer') as observer:
        yield observer


@contextlib.contextmanager
def _remote(network: NetworkNamespace, environment: Mapping[str, str], kind: str, *arguments: object) -> Iterator[Any]:
    process = _Process(ctx=multiprocessing.get_context('spawn'))
    process.start(_begin, (network.path, dict(environment)))
    with process:
        served = getattr(process, kind)(*arguments)
        yield served
        served.close()


def _begin(network: str, environment: Mapping[str, str]) -> None:
    enter(network)
    os.environ.update(environment)
