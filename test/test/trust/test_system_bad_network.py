# SPDX-License-Identifier: BSD-3-Clause
"""An executive and consoles in two networks; the cable between them loses, delays, doubles and reorders packets.

Everything is the real one, the middleware's discovery and acknowledgements included, with the settings for radio links.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar, cast

import pytest

from flexbt_common import discovery
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.freshness import LIVE_PERIODS, LOST_SECONDS, LinkState
from flexbt_console.mirror.records import AutonomyLevel, ExecutiveSnapshot, ExecutiveState
from flexbt_system_tests.gates import GATES, offer_gates
from flexbt_testing.system import networks
from flexbt_testing.system.networks import FAIR, LossyLink, NetworkNamespace, Weather
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.remote import RemoteConsole, RemoteObserver, remote_console, remote_observer
from flexbt_testing.waiting import contended_time, uncontended_time, wait_until

T = TypeVar('T')

BAD = Weather(loss=0.3, doubled=0.1, delay=(0.2, 0.5), rate=64_000.0)
PARTITION_S = 10.0
SHORT_PARTITION_S = 3.0
HEALING_S = 2.0
HEARTBEAT_S = 0.5
AUTHORITY_TIMEOUT_S = 4.0
DEADLINE_S = 60.0
LIVE_S = LIVE_PERIODS * HEARTBEAT_S + BAD.delay[1] + 0.25
"""How old a picture may be that claims to be live: the way is not told from a difference of the clocks."""

REASON = networks.missing()
pytestmark = pytest.mark.skipif(bool(REASON), reason=REASON)


class Scene:
    """A robot, its consoles, and what is between them."""

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        self._record = directory
        self._stack = stack
        self._began = contended_time()
        self._sent: list[tuple[RemoteConsole, str]] = []
        robot, self._station = (stack.enter_context(NetworkNamespace()) for _ in range(2))
        self.link = stack.enter_context(LossyLink(robot, self._station, seed=4))
        processes = stack.enter_context(Stack(directory, robot))
        parameters = {
            'use_sim_time': 'false',
            'peers': '[""]',
            'heartbeat_period': str(HEARTBEAT_S),
            'authority_timeout': str(AUTHORITY_TIMEOUT_S),
        }
        processes.start('onboard_executive', parameters, {**middleware('robot'), **offer_gates(directory)})
        self.observer: RemoteObserver = stack.enter_context(remote_observer(robot, {}))

    def console(self, operator: str) -> RemoteConsole:
        """Another console, in the other network."""
        console = self._stack.enter_context(remote_console(self._station, middleware('console'), operator))
        self.wait(lambda: console.view().live and console.view().behaviors, f'first picture of {operator}')
        return console

    def wait(self, condition: Callable[[], T], what: str, timeout: float = DEADLINE_S) -> T:
        """Return the first true value of the condition."""
        began = uncontended_time()

        def in_time() -> T:
            value = condition()
            assert value or uncontended_time() - began < timeout, f'{what}: not within {timeout:g} s'
            return value

        return cast(T, wait_until(in_time, what))

    def cut(self, seconds: float) -> Callable[[], bool]:
        """Cut the link; tells whether that time is over."""
        self.link.weather = None
        end = time.monotonic() + seconds
        return lambda: time.monotonic() > end

    def send(self, console: RemoteConsole, *words: str, timeout: float = DEADLINE_S) -> str:
        """Return a command from a console, see :meth:`Console.send`."""
        command_id = console.send(*words, timeout=timeout)
        self._sent.append((console, command_id))
        return command_id

    def settled(self, console: RemoteConsole, command_id: str) -> TrackedCommand:
        """Return what the operator sees of a command in the end."""

        def answer() -> TrackedCommand | None:
            tracked = console.tracked(command_id)
            assert tracked is not None
            return tracked if tracked.state is not CommandState.PENDING else None

        settled = self.wait(answer, f'answer to {command_id}')
        assert settled is not None
        return settled

    def apply(self, console: RemoteConsole, *words: str) -> None:
        """Send a command that must be applied."""
        settled = self.settled(console, self.send(console, *words))
        assert settled.state is CommandState.APPLIED, settled

    def is_right(self, console: RemoteConsole) -> bool:
        """Return whether a console says that it is live, and shows what is so."""
        view, truth = console.view(), self.observer.latest()
        return view.live and view.snapshot is not None and truth is not None and gist(view.snapshot) == gist(truth)

    def decision(self, console: RemoteConsole, other_than: str = '') -> str:
        """Return the identifier of the decision that a console shows, as soon as it is not that one."""

        def found() -> str:
            decision = console.view().decision
            return decision.id if decision is not None and decision.id != other_than else ''

        return self.wait(found, f'another decision than {other_than!r}')

    def check_commands(self) -> None:
        """Each command had one effect, or a refusal or an expiry that the operator was told, and was true."""
        events = [json.loads(line) for file in self._record.glob('*.jsonl') for line in file.read_text().splitlines()]
        told = {CommandState.APPLIED: ['applied'], CommandState.REFUSED: ['refused'], CommandState.TIMEOUT: []}
        confirmed = 0
        for console, command_id in self._sent:
            settled = self.settled(console, command_id)
            effects = [event['effect'] for event in events if event['event'] == 'command' and event['id'] == command_id]
            assert effects == told[settled.state], settled
            confirmed += settled.state is CommandState.APPLIED and settled.command.decision_id != ''
        left = [event for event in events if event['event'] == 'left' and event['path'].strip('/') in GATES]
        assert len(left) == confirmed > 0

    def check_claims(self, console: RemoteConsole) -> None:
        """Check that what a console showed as live was so not too long ago, as far as the machine had time for it."""
        late = contended_time() - self._began
        published = self.observer.published()
        shown = [(one, one.snapshot) for one in console.shown() if one.live and one.snapshot is not None]
        assert shown
        for one, snapshot in shown:
            if snapshot.sequence in published:  # the observer came a little later than the executive
                sent, truth = published[snapshot.sequence]
                assert one.last - sent < LIVE_S + late, snapshot
                assert gist(snapshot) == gist(truth)


def middleware(side: str) -> dict[str, str]:
    """Return the settings of one end of the link."""
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', discovery.PROFILE: str(discovery.profile(f'radio_{side}'))}


def gist(snapshot: ExecutiveSnapshot) -> tuple[Any, ...]:
    """Return what an operator acts on."""
    return (
        snapshot.state,
        snapshot.run_id,
        [state.path for state in snapshot.active_states],
        [decision.id for decision in snapshot.decisions],
        snapshot.autonomy,
        snapshot.authority,
    )


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Scene]:
    with ExitStack() as stack:
        yield Scene(tmp_path, stack)


def test_operators_at_a_bad_link_are_told_the_truth_and_command_once(at: Scene) -> None:
    ann = at.console('ann')
    at.apply(ann, 'start', 'Gates', '--autonomy', 'low')
    at.apply(ann, 'claim')

    at.link.weather = BAD
    bob = at.console('bob')
    at.wait(lambda: bob.view().structure, 'structure over the bad link')
    decision = ''
    for _ in range(3):
        decision = at.decision(ann, other_than=decision)
        at.send(ann, 'confirm', decision)
    at.decision(ann, other_than=decision)
    assert 'ann' in at.settled(bob, at.send(bob, 'confirm', at.decision(bob))).reason

    # Too short for the authority to be lost. One command expires meanwhile, another one does not.
    is_over = at.cut(SHORT_PARTITION_S)
    expiring, lasting = at.send(ann, 'pause', timeout=1.0), at.send(ann, 'confirm', decision := at.decision(ann))
    assert at.settled(ann, expiring).state is CommandState.TIMEOUT
    at.wait(is_over, 'end of the partition')
    at.link.weather = BAD
    assert at.settled(ann, lasting).state is CommandState.APPLIED
    assert (truth := at.observer.latest()) is not None and truth.authority == 'ann'

    decision = at.decision(ann, other_than=decision)
    at.send(ann, 'confirm', decision)  # which may arrive or not
    is_over = at.cut(PARTITION_S)
    at.wait(lambda: ann.view().link is LinkState.LOST, 'link shown as lost', LOST_SECONDS + HEARTBEAT_S)
    at.send(ann, 'autonomy', 'off')
    at.wait(is_over, 'end of the partition')
    at.wait(lambda: (now := at.observer.latest()) is not None and not now.authority, 'authority lost', 1.0)
    at.link.weather = FAIR
    for console in (ann, bob):
        at.wait(lambda console=console: at.is_right(console), 'healing', HEALING_S)  # type: ignore[misc]
    at.wait(lambda: (now := at.observer.latest()) is not None and now.autonomy == AutonomyLevel.OFF, 'kept command')

    at.apply(bob, 'stop')
    at.wait(lambda: (now := ann.view().snapshot) is not None and now.state is ExecutiveState.IDLE, 'end of the run')
    at.check_commands()
    for console in (ann, bob):
        at.check_claims(console)
