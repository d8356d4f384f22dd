# SPDX-License-Identifier: BSD-3-Clause
"""Forges what a console listens to: robots that do not exist, or trees that nobody runs.

Usage: python3 _forge.py robots COUNT RATE PARENT    statuses under the names /z0, /z1, ..., RATE a second for each
       python3 _forge.py names COUNT SECONDS PARENT  one status each, and after SECONDS others under other names
       python3 _forge.py trees COUNT NODES PARENT    COUNT runs of trees of NODES nodes, ten statuses a second in all
       (PARENT: the process with which it ends)
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from typing import Final

import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions

from flexbt_common import names
from flexbt_msgs.msg import ExecutiveStatus, TreeNode, TreeStatus, TreeStatusChange, TreeStructure

PR_SET_PDEATHSIG: Final = 1  # prctl(2)
TREE_STATUS_RATE: Final = 10.0


def main(kind: str, count: int, amount: float, parent: int) -> None:
    """Until the end of who has started it. A line on standard output says that all of it is there."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        return
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('forger')
    {'robots': forge_robots, 'names': forge_names, 'trees': forge_trees}[kind](node, count, amount)


def forge_robots(node: Node, count: int, rate: float) -> None:
    """Publish executives that run something, each with a status that goes on."""
    publishers = [
        node.create_publisher(ExecutiveStatus, f'/z{number}/{names.EXECUTIVE_STATUS}', names.transient_local_qos())
        for number in range(count)
    ]
    print('forges', flush=True)
    turn = 0
    while True:
        turn += 1
        began = time.monotonic()
        for number, publisher in enumerate(publishers):
            status = ExecutiveStatus(executive_id=f'z{number}', sequence=turn, heartbeat_period=1.0 / rate)
            status.state, status.run_id, status.behavior = ExecutiveStatus.RUNNING, f'r{number}', 'Forged'
            publisher.publish(status)
            if number % 100 == 99:
                time.sleep(max(0.0, began + (number + 1) / count / rate - time.monotonic()))
        time.sleep(max(0.0, began + 1.0 / rate - time.monotonic()))


def forge_names(node: Node, count: int, seconds: float) -> None:
    """Publish executives that come and go."""
    turn = 0
    while True:
        turn += 1
        publishers = []
        for number in range(count):
            topic = f'/z{turn}_{number}/{names.EXECUTIVE_STATUS}'
            publishers.append(node.create_publisher(ExecutiveStatus, topic, names.transient_local_qos()))
            publishers[-1].publish(ExecutiveStatus(executive_id=f'z{number}', sequence=1, heartbeat_period=1.0))
        if turn == 1:
            print('forges', flush=True)
        time.sleep(seconds)
        for publisher in publishers:
            node.destroy_publisher(publisher)


def forge_trees(node: Node, count: int, nodes: float) -> None:
    """Run of trees whose nodes all change."""
    structures = node.create_publisher(TreeStructure, names.TREE_STRUCTURE, names.transient_local_qos(count))
    statuses = node.create_publisher(TreeStatus, names.TREE_STATUS, names.transient_local_qos(count))
    size = int(nodes)
    tree = [
        TreeNode(uid=uid, parent=uid // 2, kind=uid % 6, name=f'node {uid}', registration='Sequence', path=f'p/{uid}')
        for uid in range(1, size + 1)
    ]
    for run in range(count):
        structures.publish(
            serialize_message(TreeStructure(run_id=f't{run}', number=1, behavior_tree=f'Forged{run}', nodes=tree))
        )
    print('forges', flush=True)
    sequence = 0
    while True:
        sequence += 1
        for run in range(count):
            began = time.monotonic()
            changes = [TreeStatusChange(uid=1 + (sequence + uid) % size, status=1 + uid % 3) for uid in range(1000)]
            status = TreeStatus(run_id=f't{run}', sequence=sequence, structure=1, changes=changes)
            status.statuses = bytes(1 + (uid + sequence) % 3 for uid in range(size))
            statuses.publish(status)
            time.sleep(max(0.0, began + 1.0 / TREE_STATUS_RATE - time.monotonic()))


if __name__ == '__main__':
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
