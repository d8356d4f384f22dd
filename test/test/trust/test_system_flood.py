# SPDX-License-Identifier: BSD-3-Clause
"""Processes that flood the operator link: an operator still confirms, pauses and stops; the executive stays small."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.middleware.fastdds import can_ignore
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import CommandKind, ExecutiveState, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import DEADLINE, wait_until

MEMORY = 300_000_000
"""Bytes that a flood may cost at most: the large messages that wait to be taken, more of them on a busy machine. What
stays of those that were taken would be more within seconds."""

BEHAVIOR = """
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest

class Ask(EventState):
    def __init__(self):
        super().__init__(outcomes=['again'], desired_rate=None)
    def execute(self, userdata):
        return 'again'

class Asking(Behavior):
    manifest = BehaviorManifest('Asking')
    def create(self):
        machine = OperatableStateMachine(outcomes=['over'])
        with machine:
            for label, other in (('A', 'B'), ('B', 'A')):
                OperatableStateMachine.add(label, Ask(), {'again': other}, autonomy={'again': Autonomy.Full})
        return machine
"""

FLOODER = """
import os, sys, time
import rclpy
from rclpy.serialization import serialize_message
from flexbt_common import names
from flexbt_msgs.msg import ExecutiveCommand, PeerStatus

kind = sys.argv[1]
KINDS = [number for number in range(25) if number != ExecutiveCommand.STOP]  # which is never refused
rclpy.init()
node = rclpy.create_node('flooder_' + kind)
commands = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos())
presence = node.create_publisher(PeerStatus, names.EXECUTIVE_PRESENCE, 10)
large = serialize_message(ExecutiveCommand(id='x' * 10_000_000, kind=ExecutiveCommand.NOTE, text='y'))
begun = time.monotonic()
count = 0
while True:
    if kind == 'large':
        commands.publish(large)
        time.sleep(0.02)
    else:
        count += 1
        name = 'ann' if kind == 'names' else os.urandom(8).hex()
        commands.publish(ExecutiveCommand(
            id=os.urandom(8).hex(), kind=KINDS[count % len(KINDS)], operator_id=name, decision_id='1', path='/A',
            text='flood'))
        presence.publish(PeerStatus(name=name, alive=True))
    if count % 1000 == 1:
        print(count / (time.monotonic() - begun), flush=True)
"""


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    info = tmp_path / 'asking-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: asking\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text('[flexbt.behaviors]\nasking = asking:Asking\n')
    (tmp_path / 'asking.py').write_text(BEHAVIOR)
    with Stack(tmp_path) as stack:
        stack.start(
            'onboard_executive',
            {'use_sim_time': 'false', 'journal_directory': str(tmp_path)},
            {'PYTHONPATH': f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}'},
        )
        yield stack


class Console:
    """An operator's console, without its screen."""

    def __init__(self, runtime: NodeRuntime, operator: str) -> None:
        self.mirror = Mirror(runtime.steady)
        self.link = ExecutiveLink(runtime, self.mirror, operator)
        self.make = CommandBuilder(operator)

    @property
    def view(self) -> View:
        return self.mirror.view()

    @property
    def sequence(self) -> int:
        """Number of the newest status."""
        snapshot = self.view.snapshot
        return snapshot.sequence if snapshot is not None else 0

    def give(self, command: OperatorCommand) -> None:
        """Give a command, which has to be applied."""
        self.link.send(command, DEADLINE)
        settled = self.link.settled(command.id, DEADLINE)
        assert settled is not None and settled.state is CommandState.APPLIED, (command.kind, settled)

    def confirm(self, path: str) -> None:
        """Let a state be left that asks for it."""

        def find(view: View) -> str | None:
            return next((decision.id for decision in view.decisions if decision.path == path), None)

        decision = self.link.wait_for(find, DEADLINE)
        assert decision
        self.give(self.make.confirm(self.view, decision))

    def wait_state(self, state: ExecutiveState) -> None:
        """Wait until the executive shows a state."""

        def find(view: View) -> bool | None:
            return True if view.live and view.snapshot is not None and view.snapshot.state is state else None

        assert self.link.wait_for(find, DEADLINE), self.view


def memory_of(process: int) -> int:
    """Resident bytes."""
    return int(Path(f'/proc/{process}/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')


def processor_time_of(process: int) -> float:
    """Seconds."""
    fields = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.mark.skipif(not can_ignore(), reason='needs a known version of Fast DDS')
@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_flood_holds_up_no_operator_and_does_not_grow(stack: Stack, tmp_path: Path) -> None:
    executive = stack.process_id('onboard_executive')
    flooders: list[subprocess.Popen[str]] = []
    with NodeRuntime.open('console') as runtime:
        console = Console(runtime, 'ann')
        console.wait_state(ExecutiveState.IDLE)
        console.give(console.make.command(console.view, CommandKind.CLAIM_AUTHORITY))
        console.give(console.make.start(console.view, 'Asking'))
        console.confirm('/A')
        before, used = memory_of(executive), processor_time_of(executive)
        began = runtime.steady.now()
        try:
            for kind in ('random', 'names', 'large'):
                flooders.append(
                    subprocess.Popen([sys.executable, '-c', FLOODER, kind], stdout=subprocess.PIPE, text=True)
                )
            rates = [float(flooder.stdout.readline()) for flooder in flooders[:2] if flooder.stdout is not None]
            rates = [float(flooder.stdout.readline()) for flooder in flooders[:2] if flooder.stdout is not None]
            sequence = console.sequence
            for path in ('/B', '/A', '/B'):
                console.confirm(path)
            console.give(console.make.command(console.view, CommandKind.PAUSE))
            console.wait_state(ExecutiveState.PAUSED)
            console.give(console.make.command(console.view, CommandKind.RESUME))
            wait_until(lambda: console.view.live and console.sequence > sequence + 20, 'heartbeats')
            console.give(console.make.command(console.view, CommandKind.STOP))
            console.wait_state(ExecutiveState.IDLE)
        finally:
            for flooder in flooders:
                flooder.kill()
                flooder.wait()
        grown, seconds = memory_of(executive) - before, runtime.steady.now() - began
        share = (processor_time_of(executive) - used) / seconds
        print(f'{rates} commands a second for {seconds:.1f} s: {grown / 1e6:.0f} MB, {share:.0%} of a core')
        assert grown < MEMORY
        journal = sum(file.stat().st_size for file in tmp_path.iterdir() if 'journal' in file.name)
        assert journal < 10_000_000
        console.give(console.make.start(console.view, 'Asking'))
        assert any('flooder' in line.text and 'nothing more is heard' in line.text for line in console.mirror.log())
