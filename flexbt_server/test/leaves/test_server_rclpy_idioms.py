# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of users that use rclpy as in a program of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rclpy
from std_srvs.srv import Trigger

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_msgs.action import BtExecute
from flexbt_testing.behavior_trees import faulty_leaves
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.server_world import install_nodes, open_server_world


@pytest.fixture(scope='module', autouse=True)
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('site')
    install_nodes(directory, server_nodes.__name__)
    return directory


def asks(node: Any) -> bool:
    client = node.create_client(Trigger, 'look')
    while not client.wait_for_service(timeout_sec=1.0):
        pass
    future = client.call_async(Trigger.Request())
    while rclpy.ok() and not future.done():
        rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
    return bool(future.result().success)


def with_a_node_of_its_own(_leaf: Any) -> bool:
    node = rclpy.create_node('helper')
    try:
        return asks(node)
    finally:
        node.destroy_node()


def with_the_node_of_the_server(leaf: Any) -> bool:
    return asks(leaf.services.runtime.node)


def by_a_call_that_blocks(leaf: Any) -> bool:
    client = leaf.services.runtime.node.create_client(Trigger, 'look')
    client.wait_for_service()
    return bool(client.call(Trigger.Request()).success)


def and_shuts_rclpy_down(leaf: Any) -> bool:
    is_answered = with_a_node_of_its_own(leaf)
    rclpy.shutdown()
    return is_answered


@pytest.mark.parametrize(
    'code',
    [with_a_node_of_its_own, with_the_node_of_the_server, by_a_call_that_blocks, and_shuts_rclpy_down],
    ids=lambda code: code.__name__,
)
def test_a_leaf_asks_a_service(monkeypatch: pytest.MonkeyPatch, code: Callable[[Any], bool]) -> None:
    def tick(leaf: Any) -> NodeStatus:
        return NodeStatus.SUCCESS if code(leaf) else NodeStatus.FAILURE

    def answer(_request: Any, response: Any) -> Any:
        response.success = True
        return response

    monkeypatch.setattr(faulty_leaves.Blocking, 'tick', tick)
    with NodeRuntime.open('robot') as robot, open_server_world() as world:
        robot.call(lambda: robot.node.create_service(Trigger, 'look', answer))
        world.client.load_tree('<Blocking/>')
        for _ in range(2):
            result = world.client.execute().result
            assert (result.code, result.message) == (BtExecute.Result.SUCCESS, '')
    assert not rclpy.ok()
