# SPDX-License-Identifier: BSD-3-Clause
"""A tick of a C++ leaf through bt_plugin_host, of a Python leaf, and of the C++ leaf in BehaviorTree.CPP's executor.

The leaf adds two integers, of which one is on the blackboard, and writes the sum there. The figures are medians, in
microseconds for each tick of a tree that consists of it. It needs flexbt_plugin_host, built with its tests where
BehaviorTree.CPP is installed.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.ports import INT, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.cpp_nodes import host_command
from flexbt_testing.nodes.server_world import document, open_server_world


class AddInPython(SyncAction):
    ports = {'a': input_port(INT), 'b': input_port(INT), 'sum': output_port(INT)}

    def tick(self) -> NodeStatus:
        self.set_output('sum', self.get_input('a') + self.get_input('b'))
        return NodeStatus.SUCCESS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--ticks', type=int, default=5000, help='of each leaf')
    ticks = parser.parse_args().ticks
    programs = Path(host_command()[0]).parent
    library = programs / 'libtest_nodes.so'
    figures = {}
    with open_server_world(plugins=[str(library)]) as world:
        services = world.server.goals._services
        services.trees.registry.register('AddInPython', AddInPython)
        for name in ('AddInPython', 'Add'):
            services.trees.load([], document(f'<{name} a="1" b="{{n}}" sum="{{n}}"/>'))
            board = Blackboard()
            board.set('n', 0)
            tree = Tree(services.trees.find('Main').library, 'Main', blackboard=board, services=services)
            figures[name] = statistics.median(seconds(tree.tick_exactly_once) for _ in range(ticks))
            assert board.get('n') == ticks
    case = {'xml': document('<Add a="1" b="{n}" sum="{n}"/>'), 'bb': {'n': 0}, 'ops': [['time', ticks // 50]] * 50}
    line = json.dumps(case).encode() + b'\n'
    answer = subprocess.run([programs / 'run_tree', library], input=line, stdout=subprocess.PIPE, check=True).stdout
    figures['BehaviorTree.CPP'] = statistics.median(json.loads(answer))
    for name, value in figures.items():
        print(f'{name:17}{value * 1e6:8.1f} us, {figures["Add"] / value:5.1f} times as fast as through the host')


def seconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


if __name__ == '__main__':
    main()
