# SPDX-License-Identifier: BSD-3-Clause
"""Runs a world in IR-SIM, in its own Python: see simulator.py. Prints the seconds that the steps took, as JSON.

Usage: _irsim_probe.py WORLD.yaml COMMANDS.json
"""

import json
import sys
import time

import irsim
import matplotlib
import numpy

matplotlib.use('Agg')


def main() -> int:
    with open(sys.argv[2]) as file:  # noqa: PTH123 - as short as can be
        commands = json.load(file)
    env = irsim.make(sys.argv[1], display=False, save_ani=False, log_level='ERROR')
    ids = list(range(len(commands[0])))
    actions = [[numpy.array(one).reshape(2, 1) for one in step] for step in commands]
    env.step(actions[0], ids)  # what is made at the first step
    start, processor = time.perf_counter(), time.process_time()
    for action in actions[1:]:
        env.step(action, ids)
    took, used = time.perf_counter() - start, time.process_time() - processor
    moved = [float(numpy.hypot(*(robot.state[:2, 0] - robot.init_state[:2, 0]))) for robot in env.robot_list]
    seen = [int(robot.get_lidar_scan()['ranges'].size) for robot in env.robot_list]
    print(json.dumps({'seconds': took, 'processor': used, 'moved': moved, 'beams': seen, 'version': irsim.__version__}))
    return 0


if __name__ == '__main__':
    sys.exit(main())
