# SPDX-License-Identifier: BSD-3-Clause
"""Run an executable in which a thread can be made to hang, like a callback that does not return.

Usage: python -m flexbt_testing.system.hold_up FIFO EXECUTABLE [ARGUMENT ...]

A line written to FIFO names a method that the thread calls repeatedly, and seconds:
``flexbt_common.runtime.node_runtime.NodeRuntime._run_posted 3.0``. The next call takes this much longer. The
interpreter and all other threads of the process continue; a stopped process (SIGSTOP) is a different case.
``interpreter 3.0`` makes the whole interpreter hang, like garbage collection or a C call that holds the GIL, while the
middleware continues.
"""

from __future__ import annotations

import ctypes
import importlib
import runpy
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXECUTOR = 'flexbt_common.runtime.node_runtime.NodeRuntime._run_posted'
"""Called in each cycle of the executor of a node."""

RUN = 'flexbt_core.state_machine.engine.run.MachineRun.step'
"""Called after each event of a behavior's run."""

TREE = 'flexbt_core.behavior_tree.engine.tick_control.TickControl.tick'
"""Called for each tick of a tree in the BT server."""

WORLD = 'flexbt_sim.simulator.core.SimulatorCore._step'
"""Called for each step of the simulated world."""

CLOCK = 'flexbt_common.runtime.health.Health._ask'
"""Called several times a second by the thread of the wall clock, which enforces all deadlines of a process."""

INTERPRETER = 'interpreter'
"""Keyword that replaces the method, to make the whole interpreter hang."""

THREADS = {
    'bt_server': {'executor': EXECUTOR, 'tree': TREE, 'clock': CLOCK},
    'navigation': {'executor': EXECUTOR},
    'onboard_executive': {'executor': EXECUTOR, 'run': RUN, 'clock': CLOCK},
    'simulator': {'executor': EXECUTOR, 'world': WORLD},
}
"""By executable: threads whose hang stops the robot, each with a method that it calls repeatedly.

If the clock threads of navigation and simulator hang, the robot drives on and stops on command, because the executors
handle both.
"""


def hold_up(method: str, seconds: float, is_meant: Callable[[], bool] = lambda: True) -> None:
    """Make the next call of a method, by its qualified name, take this much longer: the next one that is meant."""
    if method == INTERPRETER:
        ctypes.PyDLL(None).poll(None, 0, round(1000.0 * seconds))  # PyDLL keeps the GIL during the call
        return
    path, _, name = method.rpartition('.')
    module, _, class_name = path.rpartition('.')
    owner = getattr(importlib.import_module(module), class_name)
    original = getattr(owner, name)

    def held(*arguments: Any, **options: Any) -> Any:
        if is_meant():
            setattr(owner, name, original)
            time.sleep(seconds)
        return original(*arguments, **options)

    setattr(owner, name, held)


def listen(fifo: Path) -> None:
    """Apply each line written to a FIFO, from now on."""
    threading.Thread(target=_listen, args=(fifo,), daemon=True).start()


def _listen(fifo: Path) -> None:
    while True:  # each writer ends one pass
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
