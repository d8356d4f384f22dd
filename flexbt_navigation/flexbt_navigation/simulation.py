# SPDX-License-Identifier: BSD-3-Clause
"""The nodes ``simulator`` and ``navigation`` in one process, like a component container. Poses, scans and commands are
passed in memory (intra_process.py), so a world that runs as fast as possible takes about half of the processor time.

Each robot that is in the world at the start has a node ``navigation`` in its namespace. Parameters are those of the
nodes: ``-p NAME:=VALUE`` applies to all nodes that have it, ``-p simulator:NAME:=VALUE`` to one. Killing the process,
or a fault that makes a server die, ends all of them.
"""

from __future__ import annotations

import sys
from functools import partial

from flexbt_common import names
from flexbt_common.middleware.fastdds import ignore_each_other
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_sim.intra_process import IntraProcessTopics
from flexbt_sim.simulator.node import Simulator

from .node import Navigation


class Simulation:
    """A simulator on a running node, and navigation servers on separate nodes."""

    def __init__(self, simulator: NodeRuntime, args: list[str] | None = None) -> None:
        """``args`` are those of the process, without its name; None for sys.argv. Must be called off the executor
        thread.

        Raises:
            SimulationError: as :class:`Simulator`.
        """
        self._simulator = simulator
        self._args = sys.argv[1:] if args is None else args
        self._in_process = IntraProcessTopics()
        for namespace in Simulator(simulator, self._in_process).namespaces:
            self._navigate(f'{simulator.node.get_namespace().rstrip("/")}/{namespace}'.rstrip('/') or '/')

    def _navigate(self, namespace: str) -> None:
        """Start the servers of a robot. They end with the simulator, and the simulator ends if they cannot continue."""
        # The first rule that matches applies. Put the name first, since the given arguments may rename the simulator.
        rules = (f'__node:={names.NAVIGATION}', f'__ns:={namespace}')
        there = ['--ros-args', *(word for rule in rules for word in ('-r', f'{names.NAVIGATION}:{rule}')), '--']
        runtime = NodeRuntime(names.NAVIGATION, args=[*there, *self._args], parameters={'use_sim_time': True})
        for other in self._simulator.further:  # else it reports all that it creates to them
            ignore_each_other(runtime.node, other.node)
        self._simulator.further.append(runtime)
        told = f'{names.NAVIGATION} in {namespace} cannot continue'
        runtime.on_failure(lambda: self._simulator.abort(f'{told}: {runtime.health.failure}'))
        Navigation(runtime, self._in_process)


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``simulation``."""
    return run_node(names.SIMULATOR, partial(Simulation, args=args), args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
