# SPDX-License-Identifier: BSD-3-Clause
"""The node ``simulator``: steps a world, publishes the topics of its robots, and provides the standard services of
simulators.

It publishes /clock and, for each robot, map, odom, pose, scan, tf, tf_static, amcl_pose, battery_state, bumper and
robot_description; it subscribes to cmd_vel and initialpose. The robots of a world file have namespaces of their names,
which include the transform topics, as with Nav2. The standard services of simulators (simulation_interfaces) are in the
namespace of the node: they add, move and remove entities, and pause, step and reset the world.
"""

from __future__ import annotations

import sys

from flexbt_common import names
from flexbt_common.runtime.node_runtime import run_node

from .core import SimulatorCore
from .entity_services import EntityServices
from .services import DoorServices, FaultService, KeepoutServer, TimeServices


class Simulator(SimulatorCore):
    """The simulator on a running node, with its services."""

    def _connect(self) -> None:
        self._doors = DoorServices(self)
        self._keepout = KeepoutServer(self)
        super()._connect()
        self._serve_entities()
        EntityServices(self)
        TimeServices(self)
        FaultService(self)
        self._token.set_ready(True)

    def _serve_entities(self) -> None:
        self._doors.update()
        self._keepout.update()


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``simulator``."""
    return run_node(names.SIMULATOR, Simulator, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
