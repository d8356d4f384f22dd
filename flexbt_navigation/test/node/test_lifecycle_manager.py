# SPDX-License-Identifier: BSD-3-Clause
"""The lifecycle manager, asked as BasicNavigator and Nav2's panel in RViz do, over managed nodes of another process."""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

import pytest
from nav2_msgs.srv import ManageLifecycleNodes
from std_srvs.srv import Trigger

from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.lifecycle_manager import LifecycleManager
from flexbt_testing.nodes.clients import LifecycleClient
from flexbt_testing.waiting import DEADLINE, wait_until

Command = ManageLifecycleNodes.Request
MANAGER = 'lifecycle_manager_navigation'
NODES = ('planner_server', 'controller_server', 'bt_navigator')


class Bench:
    """A manager of three nodes, and who asks it."""

    def __init__(self, host: NodeRuntime, manager: NodeRuntime, person: NodeRuntime) -> None:
        self.told: list[tuple[str, bool]] = []
        self.is_ready = True
        self.parts = {name: host.call(partial(self._part, host, name)) for name in NODES}
        LifecycleManager(manager)
        self._links = ServiceLinks(person)
        self._clients = [LifecycleClient(person, name) for name in NODES]

    def _part(self, host: NodeRuntime, name: str) -> LifecycleSubnode:
        return LifecycleSubnode(
            host, name, lambda is_active: self.told.append((name, is_active)), lambda: self.is_ready
        )

    def ask(self, service_type: Any, service: str, request: Any) -> Any:
        outcome = service_outcome(self._links.link(service_type, f'{MANAGER}/{service}'), request, DEADLINE)
        assert outcome.ok, outcome.reason
        return outcome.response

    def manage(self, command: int) -> bool:
        return bool(self.ask(ManageLifecycleNodes, 'manage_nodes', Command(command=command)).success)

    def is_active(self) -> tuple[bool, str]:
        answer = self.ask(Trigger, 'is_active', Trigger.Request())
        return answer.success, answer.message

    def states(self) -> set[str]:
        return {client.state() for client in self._clients}


def test_nodes_are_brought_down_and_up_in_their_order() -> None:
    names = {'node_names': list(NODES)}
    with (
        NodeRuntime.open('host') as host,
        NodeRuntime.open(MANAGER, parameters=names) as manager,
        NodeRuntime.open('person') as person,
    ):
        bench = Bench(host, manager, person)
        up, down = [(name, True) for name in NODES], [(name, False) for name in reversed(NODES)]
        for command, is_done, told, state, active in (
            (Command.STARTUP, True, [], 'active', (True, '')),
            (Command.PAUSE, True, down, 'inactive', (False, 'planner_server is inactive')),
            (Command.PAUSE, True, [], 'inactive', (False, 'planner_server is inactive')),
            (Command.RESUME, True, up, 'active', (True, '')),
            (Command.RESET, True, down, 'unconfigured', (False, 'planner_server is unconfigured')),
            (Command.RESUME, False, [], 'unconfigured', (False, 'planner_server is unconfigured')),
            (Command.CONFIGURE, True, [], 'inactive', (False, 'planner_server is inactive')),
            (Command.CLEANUP, True, [], 'unconfigured', (False, 'planner_server is unconfigured')),
            (Command.STARTUP, True, up, 'active', (True, '')),
            (99, False, [], 'active', (True, '')),
            (Command.SHUTDOWN, True, down, 'finalized', (False, 'planner_server is finalized')),
            (Command.STARTUP, False, [], 'finalized', (False, 'planner_server is finalized')),
        ):
            bench.told.clear()
            assert manage_and_see(bench, command) == (is_done, told, {state}, active), command


def test_a_command_for_which_no_thread_is_left_fails_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = threading.Thread.start

    def start(thread: threading.Thread) -> None:
        if thread.name == 'manage_nodes':
            raise RuntimeError("can't start new thread")
        begin(thread)

    with (
        NodeRuntime.open('host') as host,
        NodeRuntime.open(MANAGER, parameters={'node_names': list(NODES)}) as manager,
        NodeRuntime.open('person') as person,
    ):
        bench = Bench(host, manager, person)
        with monkeypatch.context() as patch:
            patch.setattr(threading.Thread, 'start', start)
            assert not bench.manage(Command.PAUSE)
            assert bench.is_active() == (False, "it cannot be found out: can't start new thread")
        assert bench.is_active() == (True, '')


def manage_and_see(bench: Bench, command: int) -> tuple[bool, list[tuple[str, bool]], set[str], tuple[bool, str]]:
    is_done = bench.manage(command)
    return is_done, bench.told, bench.states(), bench.is_active()


def test_a_node_that_comes_up_slowly_is_waited_for_and_one_that_is_gone_is_named(
    capfd: pytest.CaptureFixture[str],
) -> None:
    parameters = {'node_names': list(NODES), 'service_timeout': 1.0, 'autostart': True}
    with (
        NodeRuntime.open('host') as host,
        NodeRuntime.open(MANAGER, parameters=parameters) as manager,
        NodeRuntime.open('person') as person,
    ):
        bench = Bench(host, manager, person)
        wait_until(lambda: 'the managed nodes are active' in capfd.readouterr().err, 'the start-up')
        bench.is_ready = False
        assert bench.is_active() == (False, 'planner_server is activating')
        assert not bench.manage(Command.STARTUP)
        assert 'planner_server is activating' in capfd.readouterr().err
        asked = person.steady
        asked.call_at(asked.now() + 0.3, lambda: setattr(bench, 'is_ready', True))
        assert bench.manage(Command.STARTUP)
        host.call(bench.parts['bt_navigator'].close)
        assert not bench.manage(Command.PAUSE)
        assert "no service 'bt_navigator/get_state'" in capfd.readouterr().err
        success, message = bench.is_active()
        assert not success and 'bt_navigator/get_state' in message
