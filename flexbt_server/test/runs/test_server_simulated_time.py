# SPDX-License-Identifier: BSD-3-Clause
"""Trees of a server under simulated time: every node that has to do with time stands still, goes on and is reset with
/clock."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from rosgraph_msgs.msg import Clock

from flexbt_common import names
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import BtExecute, BtSetData
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, install_nodes, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result
FOREVER = '<Sleep msec="1000000000"/>'


def counting(decorator: str) -> str:
    """Run for ever; each run of the decorator's child adds one to the entry [n]."""
    node = decorator.split()[0]
    return f'<PipelineSequence><{decorator}><Counts key="n"/></{node}>{FOREVER}</PipelineSequence>'


ENDING = {
    'BySleep': '<Sleep msec="2000"/>',
    'ByDelay': '<Delay delay_msec="2000"><AlwaysSuccess/></Delay>',
    'ByTimeout': f'<Inverter><Timeout msec="2000">{FOREVER}</Timeout></Inverter>',
    'ByCoroutine': '<InCoroutine ms="2000"/>',
    'ByThread': '<InThread ms="2000"/>',
}
COUNTING = {
    'ByRate': counting('RateController hz="0.5"'),
    'BySpeed': counting('SpeedController min_rate="0.5" max_rate="0.5"'),
}
"""All of them have something to do two seconds after their start."""


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


class Simulation:
    """A hand on /clock, and one goal for each tree."""

    def __init__(self, world: ServerWorld) -> None:
        self.world = world
        runtime = world.client.runtime
        self._publisher: Any = runtime.call(lambda: runtime.node.create_publisher(Clock, names.CLOCK, 10))
        self._goals: dict[str, SentGoal] = {}

    def set(self, seconds: float) -> None:
        """Set simulated time, wait until the server knows, and until it has done a round of everything."""
        message = Clock()
        message.clock.sec, message.clock.nanosec = int(seconds), round(seconds % 1 * 1e9)
        server = self.world.server_runtime

        def arrived() -> bool:
            self._publisher.publish(message)
            return bool(server.call(server.clock.stamp) == message.clock)

        wait_until(arrived, 'the time at the server')
        self.everybody_is_ticked()

    def everybody_is_ticked(self) -> None:
        """Wake the trees of a blackboard by data from outside."""
        for name in self._goals:
            assert self.world.client.set(to_entry('woken', True), blackboard=name).code == BtSetData.Result.SUCCESS
        assert self.world.client.execute('Quick', blackboard='quick').result.code == Result.SUCCESS

    def start(self) -> None:
        for name, body in {**ENDING, **COUNTING}.items():
            self.world.client.load_tree(body, name)
            self._goals[name] = self.world.client.execute(name, blackboard=name)
        wait_until(
            lambda: all(goal.feedback and goal.feedback[-1].active_nodes for goal in self._goals.values()), 'the trees'
        )
        wait_until(lambda: all(self.count(name) == 1 for name in COUNTING), 'the first counts')

    def count(self, name: str) -> int:
        entries = self.world.client.get(blackboard=name).entries
        return next((int(from_entry(entry)) for entry in entries if entry.key == 'n'), 0)

    def assert_nothing_has_happened(self) -> None:
        self.everybody_is_ticked()
        assert [name for name in ENDING if self._goals[name].ended] == []
        assert {name: self.count(name) for name in COUNTING} == dict.fromkeys(COUNTING, 1)

    def assert_everything_happens(self) -> None:
        for name in ENDING:
            assert self._goals[name].result.code == Result.SUCCESS, name
        for name in COUNTING:
            wait_until(lambda name=name: self.count(name) == 2, f'the second count of {name}')  # type: ignore[misc]

    def cancel(self) -> None:
        for name in COUNTING:
            self._goals[name].call.cancel(DEADLINE)
            assert self._goals[name].result.code == Result.CANCELED


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with open_server_world(use_sim_time=True, feedback_rate=50.0) as world:
        simulation = Simulation(world)
        world.client.load_tree('<AlwaysSuccess/>', 'Quick')
        yield simulation


def test_time_stands_still_with_the_clock_and_goes_on_with_it(simulation: Simulation) -> None:
    simulation.set(100.0)
    simulation.start()
    # Nobody moves the clock: whatever happens in the meantime, no time passes.
    for _ in range(10):
        simulation.assert_nothing_has_happened()
    simulation.set(101.9)
    simulation.assert_nothing_has_happened()
    simulation.set(102.0)
    simulation.assert_everything_happens()
    simulation.cancel()


def test_a_reset_of_the_simulation_takes_no_time_away_and_adds_none(simulation: Simulation) -> None:
    simulation.set(100.0)
    simulation.start()
    simulation.set(101.0)
    simulation.set(0.5)  # the simulation begins anew: what has passed has passed
    simulation.assert_nothing_has_happened()
    simulation.set(1.4)
    simulation.assert_nothing_has_happened()
    simulation.set(0.1)
    simulation.set(0.2)
    simulation.assert_everything_happens()
    simulation.cancel()


def test_a_jump_ahead_is_time_that_has_passed(simulation: Simulation) -> None:
    simulation.set(100.0)
    simulation.start()
    simulation.set(5000.0)
    simulation.assert_everything_happens()
    simulation.cancel()


def test_trees_that_begin_before_the_clock_does_run_when_it_comes(simulation: Simulation) -> None:
    simulation.start()
    simulation.assert_nothing_has_happened()
    simulation.set(7000.0)  # the first message: a beginning, not seven thousand seconds
    simulation.assert_nothing_has_happened()
    simulation.set(7002.0)
    simulation.assert_everything_happens()
    simulation.cancel()


def test_a_cancel_needs_no_time(simulation: Simulation) -> None:
    simulation.set(100.0)
    simulation.start()
    for goal in simulation._goals.values():
        goal.call.cancel(DEADLINE)
    for name, goal in simulation._goals.items():
        assert goal.result.code == Result.CANCELED, name


def test_a_run_without_a_time_says_so_in_feedback_and_result() -> None:
    with open_server_world(use_sim_time=True, feedback_rate=50.0) as world:
        world.client.load_tree(FOREVER, 'Waits')
        goal = world.client.execute('Waits')
        wait_until(lambda: 'nobody publishes /clock' in goal.feedback[-1].clock_problem, 'what is wrong')
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.CANCELED
        assert 'nobody publishes /clock' in goal.result.message
