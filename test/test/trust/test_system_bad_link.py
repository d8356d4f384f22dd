# SPDX-License-Identifier: BSD-3-Clause
"""An executive and a console with a bad link between them: messages are lost, late, doubled and out of order.

Executive and console are the real ones. What the console hears and says goes through a nemesis that decides the fate of
each single message.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.freshness import LIVE_PERIODS, LinkState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import AutonomyLevel, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, BehaviorLibrary
from flexbt_onboard.node.executive import open_executive
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_system_tests.gates import Gate, Gates
from flexbt_testing.waiting import uncontended_time, wait_until

pytestmark = pytest.mark.one_process

HEARTBEAT_S = 0.2
DEADLINE_S = 60.0
HEALING_S = 2.0


class Nemesis:
    """The fate of messages. ``cut`` lets none through."""

    def __init__(self, runtime: NodeRuntime, seed: int, loss: float, delay: float) -> None:
        self._runtime = runtime
        self._random = random.Random(seed)
        self._loss = loss
        self._delay = delay
        self.cut = False
        self.delivered = 0

    def heal(self) -> None:
        """From now on every message arrives, once and at once; those that are on the way still arrive."""
        self._loss = self._delay = 0.0
        self.cut = False

    def pass_on(self, deliver: Callable[[], None]) -> None:
        """Deliver a message on the executor's thread: late, twice, or never."""
        if self.cut or self._random.random() < self._loss:
            return
        for _ in range(2 if self._loss and self._random.random() < 0.2 else 1):
            self.delivered += 1
            late = self._runtime.steady.now() + self._random.uniform(0.0, self._delay)
            self._runtime.steady.call_at(late, lambda: self._runtime.post(deliver))


class BadLink(ExecutiveLink):
    """A console's link whose statuses and commands go through a nemesis."""

    def __init__(self, runtime: NodeRuntime, mirror: Mirror, nemesis: Nemesis) -> None:
        self._nemesis = nemesis
        super().__init__(runtime, mirror)
        publisher, self._commands, self._stops = self._commands, self, self
        self._publisher = publisher

    def _on_status(self, received: Received) -> None:
        self._nemesis.pass_on(lambda: super(BadLink, self)._on_status(received))

    def publish(self, message: Any) -> None:
        self._nemesis.pass_on(lambda: self._publisher.publish(message))


class Truth:
    """What the executive really published, and when (on a link without faults)."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.published: dict[int, float] = {}
        self.last = ExecutiveStatus()
        runtime.call(
            lambda: runtime.node.create_subscription(
                ExecutiveStatus, names.EXECUTIVE_STATUS, self._hear, names.transient_local_qos(100)
            )
        )

    def _hear(self, status: ExecutiveStatus) -> None:
        self.published[status.sequence] = uncontended_time()
        self.last = status


class Scene:
    """An executive, a console behind a nemesis, and the truth."""

    def __init__(self, executive: NodeRuntime, console: NodeRuntime, nemesis: Nemesis) -> None:
        Gate.exits = Counter()
        library = BehaviorLibrary([BehaviorEntry('Gates', 'test', Gates.manifest, (), Gates)])
        open_executive(executive, ExecutiveParameters(peers=(), heartbeat_period=HEARTBEAT_S), library)
        self.truth = Truth(executive)
        self.nemesis = nemesis
        self.mirror = Mirror(console.steady)
        self.link = BadLink(console, self.mirror, nemesis)
        self.make = CommandBuilder('ann')
        self.commands: list[OperatorCommand] = []
        self.wrong: list[str] = []
        self.mirror.add_listener(lambda _: self.check())

    def check(self) -> None:
        """Check that a picture that claims to be live is not older than that may be."""
        view, now = self.mirror.view(), uncontended_time()
        if not view.live or view.snapshot is None:
            return
        since = self.truth.published.get(view.snapshot.sequence + 1)
        if since is not None and now - since > LIVE_PERIODS * HEARTBEAT_S + 0.25:
            self.wrong.append(f'{view.snapshot.sequence} was shown as live {now - since:.2f} s after it was outdated')

    def send(self, command: OperatorCommand) -> TrackedCommand:
        self.commands.append(command)
        return self.link.send(command, DEADLINE_S)

    def settle(self) -> Counter[CommandState]:
        """Return what became of the commands, in the end."""
        states: Counter[CommandState] = Counter()
        for command in self.commands:
            settled = self.link.settled(command.id, DEADLINE_S)
            assert settled is not None, command
            assert settled.reason or settled.state is not CommandState.REFUSED
            states[settled.state] += 1
        return states

    def wait(self, condition: Callable[[View], object], timeout: float = DEADLINE_S) -> View:
        view = self.link.wait_for(lambda view: view if condition(view) else None, timeout, every=0.05)
        assert view is not None, self.mirror.view()
        return view

    def is_true(self, view: View) -> bool:
        """Return whether the console shows what is so."""
        snapshot, last = view.snapshot, self.truth.last
        return (
            view.live
            and snapshot is not None
            and snapshot.state == last.state
            and [decision.id for decision in snapshot.decisions] == [decision.id for decision in last.decisions]
            and list(view.active_paths) == [state.path for state in last.active_states]
        )


@contextmanager
def scene(seed: int, loss: float, delay: float) -> Iterator[Scene]:
    with NodeRuntime.open('onboard_executive') as executive, NodeRuntime.open('console') as console:
        yield Scene(executive, console, Nemesis(console, seed, loss, delay))


@pytest.mark.parametrize(
    ('loss', 'delay', 'count'),
    [(0.05, 0.2, 20), (0.3, 0.0, 30), (0.3, 1.0, 10)],
    ids=['a little', 'loss', 'loss and delay'],
)
def test_each_command_has_one_effect_or_is_refused(loss: float, delay: float, count: int) -> None:
    with scene(1, loss, delay) as at:
        view = at.wait(lambda view: view.live and view.behaviors)
        at.send(at.make.start(view, 'Gates', autonomy=AutonomyLevel.LOW))
        doubled = 0
        for _ in range(count):
            view = at.wait(lambda view: view.decision)
            assert view.decision is not None
            at.send(at.make.confirm(view, view.decision.id))
            if doubled < 5:  # a second operator of the same opinion: one of the two is too late
                doubled += 1
                at.send(CommandBuilder('bob').confirm(view, view.decision.id))
            at.wait(lambda view, seen=view.decision.id: view.decision is None or view.decision.id != seen)  # type: ignore[misc]
        states = at.settle()
        assert states[CommandState.TIMEOUT] == states[CommandState.PENDING] == 0
        assert states[CommandState.APPLIED] - 1 == sum(Gate.exits.values()) >= count // 2
        at.nemesis.heal()
        healed = uncontended_time()
        at.wait(at.is_true)
        assert uncontended_time() - healed < HEALING_S + 1.0
        assert not at.wrong


def test_a_partition_is_shown_and_heals() -> None:
    with scene(2, 0.3, 0.2) as at:
        view = at.wait(lambda view: view.live and view.behaviors)
        at.send(at.make.start(view, 'Gates', autonomy=AutonomyLevel.LOW))
        at.wait(lambda view: view.decision)
        at.nemesis.cut = True
        at.wait(lambda view: view.link is LinkState.LOST)
        assert not at.wrong
        at.nemesis.heal()
        healed = uncontended_time()
        view = at.wait(at.is_true)
        assert uncontended_time() - healed < HEALING_S
        at.send(at.make.confirm(view))
        assert at.settle() == {CommandState.APPLIED: 2}
        assert sum(Gate.exits.values()) == 1


def test_a_command_that_is_said_during_a_partition_arrives_once_after_it() -> None:
    with scene(3, 0.0, 0.0) as at:
        view = at.wait(lambda view: view.live and view.behaviors)
        at.send(at.make.start(view, 'Gates', autonomy=AutonomyLevel.LOW))
        view = at.wait(lambda view: view.live and view.decision)
        at.nemesis.cut = True
        command = at.make.confirm(view)
        at.send(command)

        def tracked() -> TrackedCommand:
            found = at.mirror.command(command.id)
            assert found is not None
            return found

        wait_until(lambda: tracked().sends > 3, 'the command, said again and again')
        assert tracked().state is CommandState.PENDING
        at.nemesis.heal()
        assert at.settle() == {CommandState.APPLIED: 2}
        assert sum(Gate.exits.values()) == 1
