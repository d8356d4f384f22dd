# SPDX-License-Identifier: BSD-3-Clause
"""A world that goes on in real time, while an operator at a console, or at the page, commands its robots."""

from __future__ import annotations

import select
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Final

from .world import World  # isort: skip - it prepares this interpreter

from flexbt_testing.nodes import world_bridge
from flexbt_testing.nodes.world_bridge import OF_OPERATOR, OF_ROBOT, BridgeEnd

from .scheduler import BOOT, SCHEDULER, SECOND, Alarm

_LOOK_SECONDS: Final = 0.05
_real_time: Final = partial(time.clock_gettime_ns, time.CLOCK_MONOTONIC)  # which no world replaces


class TakenOver(BaseException):
    """The script of a mission ends here, because an operator goes on."""


class RealTime:
    """The pace of real time: the clock of the world waits for it, and for what comes from outside meanwhile."""

    def __init__(self, connection: Connection, receive: Callable[[tuple[str, bytes]], None]) -> None:
        self._connection = connection
        self._receive = receive
        self._begin = _real_time() - SCHEDULER.now

    def wait(self, until: int) -> bool:
        """Wait until a time of the steady clock, ns. Return False if something has come before."""
        left = max(0, until - (_real_time() - self._begin))
        if not select.select([self._connection], [], [], left / SECOND)[0]:
            return True
        SCHEDULER.now = max(SCHEDULER.now, min(until, _real_time() - self._begin))
        try:
            self._receive(self._connection.recv())
        except EOFError:  # which must not end the task that happens to wait here
            SCHEDULER.pace = None
            SCHEDULER.throw(RuntimeError('the bridge between the world and the middleware has ended'))
        return False


def take_over_at(text: str) -> tuple[Alarm, list[str]]:
    """End the script of the world by :class:`TakenOver` at a time. Return its alarm and the arguments of the console.

    ``text`` is both, such as ``12.5 prompt``. Raises ValueError if the first word is no number.
    """
    seconds, *words = shlex.split(text) or ['']
    return SCHEDULER.call_at(BOOT + int(float(seconds) * SECOND), lambda: SCHEDULER.throw(TakenOver())), words


def take_over(world: World, console: Sequence[str] = ()) -> None:
    """Let a world go on in real time until a console ends, which is started in this terminal.

    ``console`` are further arguments of it, such as ``web`` for the page. Other consoles of the same ROS domain see the
    robots, too.
    """
    inner, outer = Pipe()
    program = [sys.executable, '-m', world_bridge.__name__, str(outer.fileno()), *world.robots]
    words = [*console, *(['--namespace', world.namespace] if world.namespace else [])]
    SCHEDULER.limit = None
    node = world.observer.node
    end = world.observer.call(lambda: BridgeEnd(node, list(world.robots), OF_ROBOT, OF_OPERATOR, inner.send))
    with subprocess.Popen(program, env=world.outside, pass_fds=[outer.fileno()], start_new_session=True) as bridge:
        outer.close()
        before = signal.getsignal(signal.SIGINT)
        SCHEDULER.pace = RealTime(inner, end.publish).wait
        try:
            with subprocess.Popen([sys.executable, '-m', 'flexbt_console', *words], env=world.outside) as process:
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the console
                while process.poll() is None:
                    SCHEDULER.sleep(_LOOK_SECONDS)
        finally:
            signal.signal(signal.SIGINT, before)
            SCHEDULER.pace = None
            inner.close()
            bridge.terminate()
