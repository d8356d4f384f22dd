# SPDX-License-Identifier: BSD-3-Clause
"""Runs an executable one thread of which can be made to hang, as a callback that does not return would.

Usage: python -m flexbt_testing.system.hold_up FIFO EXECUTABLE [ARGUMENT ...]

A line that is written to FIFO names a method that the thread calls again and again, and seconds:
``flexbt_common.runtime.node_runtime.NodeRuntime._run_posted 3.0``. Its next call takes longer by this time. The
interpreter goes on, and with it all other threads of the process: a stopped process (SIGSTOP) is another case.
``interpreter 3.0`` has the whole interpreter hang, as a collection of garbage or a call of C does that keeps the GIL,
while the middleware goes on.
"""

from __future__ import annotations

import ctypes
import importlib
import runpy
import sys
import threading
import time
from pathlib import Path
from typing import Any

EXECUTOR = 'flexbt_common.runtime.node_runtime.NodeRuntime._run_posted'
"""Called in each turn of the executor of a node."""

RUN = 'flexbt_core.state_machine.engine.run.MachineRun.step'
"""Called whenever something has happened to the run of a behavior."""

TREE = 'flexbt_core.behavior_tree.engine.tick_control.TickControl.tick'
"""Called when a tree of the BT server is to be ticked."""

WORLD = 'flexbt_sim.simulator.core.SimulatorCore._step'
"""Called for each step of the simulated world."""

CLOCK = 'flexbt_common.runtime.health.Health._ask'
"""Called by the thread of the wall's clock, which keeps all deadlines of a process, some times a second."""

INTERPRETER = 'interpreter'
"""Instead of a method."""

THREADS = {
    'bt_server': {'executor': EXECUTOR, 'tree': TREE, 'clock': CLOCK},
    'navigation': {'executor': EXECUTOR},
    'onboard_executive': {'executor': EXECUTOR, 'run': RUN, 'clock': CLOCK},
    'simulator': {'executor': EXECUTOR, 'world': WORLD},
}
"""Threads by executable whose hang stops the robot, each with a method that it calls again and again. With the clocks
of navigation and simulator it drives on, and stops when it is commanded to: their executors do both."""


def hold_up(method: str, seconds: float) -> None:
    """Make the next call of a method, by its qualified name, take this much longer."""
    if method == INTERPRETER:
        ctypes.PyDLL(None).poll(None, 0, round(1000.0 * seconds))  # a call by PyDLL keeps the GIL
        return
    path, _, name = method.rpartition('.')
    module, _, class_name = path.rpartition('.')
    owner = getattr(importlib.import_module(module), class_name)
    original = getattr(owner, name)

    def held(*arguments: Any, **options: Any) -> Any:
        setattr(owner, name, original)
        time.sleep(seconds)
        return original(*arguments, **options)

    setattr(owner, name, held)


def listen(fifo: Path) -> None:
    """Hold up whatever is written to a FIFO, from now on."""
    threading.Thread(target=_listen, args=(fifo,), daemon=True).start()


def _listen(fifo: Path) -> None:
    while True:  # it ends with each who has written
        for line in fifo.read_text().splitlines():
            method, seconds = line.split()
            hold_up(method, float(seconds))


def main() -> None:
    """Run the executable, and listen."""
    fifo, *command = sys.argv[1:]
    listen(Path(fifo))
    sys.argv = command
    runpy.run_path(command[0], run_name='__main__')


if __name__ == '__main__':
    main()
