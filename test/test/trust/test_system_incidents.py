# SPDX-License-Identifier: BSD-3-Clause
"""Everything that makes an incident on a real robot, while its black box and the makers of its incidents are killed:
each incident is whole, opens, and tells what happened and where.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from mcap.reader import make_reader
from nav2_msgs.action import ComputePathToPose
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.recording.black_box import SAME_SECONDS
from flexbt_console.recording.incidents import PAGE, Incident, incidents_in
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.run_file import RECORDING
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import run_console
from flexbt_testing.waiting import wait_until

DEADLINE = 600.0
PASSING = ('stop', 'battery', 'key', 'goal')
"""What leaves nothing behind: if the black box was dead then, it knows nothing of it."""

LOOK = 0.2
"""Time between two looks at all incidents, s: each is read."""

LATE_SECONDS = 5.0
"""Time before which something was told that is dated by another clock, s."""

SEED = int(os.environ.get('FLEXBT_SEED', '359047'))
"""Draws the order and the moments of the kills."""

ENTRIES = """\
[flexbt.behaviors]
grasps = faulty_mission:Grasps
claws = faulty_mission:Claws
owners = faulty_mission:Owners
[flexbt.bt_nodes]
faulty_mission = faulty_mission:register
"""
MISSION = """
from flexbt_core import EventState, NodeStatus, OperatableStateMachine
from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import BtExecuteState


class CloseClaw(SyncAction):
    def tick(self):
        raise ValueError('the claw is stuck')


def register(registry):
    registry.register('CloseClaw', CloseClaw)


class Grasp(EventState):
    def __init__(self):
        super().__init__(['done'])

    def execute(self, userdata):
        raise ValueError('no grip')


class Drives(EventState):
    skill = Skill.of(resources=['base'])

    def __init__(self):
        super().__init__(['done'], desired_rate=None)


class Grasps(Behavior):
    manifest = BehaviorManifest('Grasps')

    def create(self):
        with OperatableStateMachine(['done', 'failed']) as machine:
            machine.add('Grasp', Grasp(), {'done': 'done'})
        return machine


class Claws(Behavior):
    manifest = BehaviorManifest('Claws')

    def create(self):
        with OperatableStateMachine(['done', 'failed']) as machine:
            ends = {'done': 'done', 'canceled': 'failed', 'failed': 'failed'}
            machine.add('Close', BtExecuteState(bt_file='Claw'), ends)
        return machine


class Owners(Behavior):
    manifest = BehaviorManifest('Owners')

    def create(self):
        with OperatableStateMachine(['done']) as machine:
            both = ConcurrencyContainer(['done'], conditions=[('done', [('One', 'done'), ('Other', 'done')])])
            with both:
                for label in ('One', 'Other'):
                    OperatableStateMachine.add(label, Drives(), {'done': 'done'})
            machine.add('Both', both, {'done': 'done'})
        return machine
"""
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Claw"><CloseClaw name="close"/></BehaviorTree></root>'


@dataclass
class Happening:
    """Something that goes wrong: the kind of its incident, words of its text, how it is done and mended."""

    kind: str
    words: tuple[str, ...]
    do: Callable[[], object]
    mend: Callable[[], object]


class Robot:
    """A robot with a black box, and all that may happen to it."""

    def __init__(self, stack: Stack, probe: Probe, folder: Path) -> None:
        self.stack, self.probe, self.folder = stack, probe, folder
        self.incidents, self.earlier, self._starts = folder / 'incidents', folder / 'earlier', 0
        self.earlier.mkdir()
        path = os.pathsep.join([str(folder), os.environ.get('PYTHONPATH', '')])
        self._settings: dict[str, tuple[dict[str, str] | None, dict[str, str] | None]] = {
            'bt_server': (
                {'bt_search_directories': f'[{folder}]', 'allowed_directories': f'[{folder}]'},
                {'PYTHONPATH': path},
            ),
            'onboard_executive': ({'monitors': 'true'}, {'PYTHONPATH': path}),
        }
        for name in ('simulator', 'navigation', 'bt_server', 'stop_guard', 'onboard_executive'):
            self.start(name)
        probe.wait_ready(DEADLINE)
        self.start_box()

    def start(self, name: str) -> None:
        self.stack.start(name, *self._settings.get(name, (None, None)))

    def start_box(self) -> None:
        """Start the black box, and wait until it finds incidents."""
        settings = {'incidents': str(self.incidents), 'ring': str(self.folder / 'ring'), 'records': f'[{self.folder}]'}
        settings |= {'seconds': '20.0', 'after': '1.0', 'keep': '1000', 'use_sim_time': 'false'}
        self.stack.start('black_box', settings)
        self._starts += 1
        says = lambda: self.stack.output('black_box').count('begins to find incidents') == self._starts  # noqa: E731
        wait_until(says, lambda: self.stack.output('black_box')[-3000:], DEADLINE)

    def kill_box(self) -> None:
        """Kill the black box, and start it again. What makes its incidents goes on."""
        self.stack.kill('black_box')
        self.start_box()

    def begin_anew(self) -> None:
        """End the black box in order, and start one that knows of no incidents."""
        self.end_box()
        for one in self.incidents.iterdir():
            one.rename(self.earlier / one.name)
        self.start_box()

    def end_box(self) -> None:
        """End the black box in order, and wait until all its incidents are made."""
        self.stack.end('black_box', signal.SIGTERM, DEADLINE)
        ring = self.folder / 'ring'
        wait_until(lambda: not list(ring.rglob('*.request.json')), 'what waits for the disk', DEADLINE)

    def kill_maker(self) -> None:
        """Kill what makes an incident now, if there is one."""
        box = self.stack.process_id('black_box')
        for task in Path(f'/proc/{box}/task').glob('*/children'):
            with contextlib.suppress(OSError):
                for child in task.read_text().split():
                    os.kill(int(child), signal.SIGKILL)

    def run(self, behavior: str) -> None:
        self.idle()
        self.probe.applied(ExecutiveCommand.START, behavior=behavior, autonomy=2)

    def idle(self) -> None:
        """Have no run."""
        if self.probe.status.state != ExecutiveStatus.IDLE:
            self.probe.stop()
            self.probe.wait_state(ExecutiveStatus.IDLE)

    def happenings(self) -> list[Happening]:
        """Return what can happen."""
        probe, stack = self.probe, self.stack
        node = probe.console.node
        battery = probe.console.call(lambda: node.create_publisher(BatteryState, names.BATTERY_STATE, 1))

        def is_low() -> None:
            def is_told() -> bool:  # the simulator tells that it is full in between
                battery.publish(BatteryState(percentage=0.09))
                return 'the battery is at' in stack.output('black_box')

            wait_until(is_told, 'the battery', DEADLINE)

        def forces() -> None:
            self.run('Owners')
            probe.wait(lambda: probe.status.active_states, 'both states')
            probe.applied(ExecutiveCommand.FORCE, path='/Both/One', outcome='done')

        def stops() -> None:
            self.run('Owners')
            probe.stop()

        nowhere = ComputePathToPose.Goal(planner_id='', use_start=False)
        nowhere.goal.header.frame_id = 'map'
        nowhere.goal.pose.position.x, nowhere.goal.pose.orientation.w = -1000.0, 1.0
        found = [
            Happening('fault', ('Grasp', 'no grip'), lambda: self.run('Grasps'), self.idle),
            Happening('fault', ('the claw is stuck',), lambda: self.run('Claws'), self.idle),
            Happening(
                'fault', ('base has two owners', '/Both/One', '/Both/Other'), lambda: self.run('Owners'), self.idle
            ),
            Happening('forced', ('test', 'force done', '/Both/One'), forces, self.idle),
            Happening('stop', ('STOP by test',), stops, self.idle),
            Happening(
                'goal',
                ('/compute_path_to_pose has aborted',),
                lambda: probe.call(ComputePathToPose, names.COMPUTE_PATH_TO_POSE, nowhere, DEADLINE),
                self.idle,
            ),
            Happening('battery', ('the battery is at 9 %',), is_low, self.idle),
            Happening(
                'key', ('asked',), lambda: probe.ask(Trigger, names.WRITE_INCIDENT, Trigger.Request()), self.idle
            ),
        ]
        for victim in ('simulator', 'navigation', 'bt_server', 'onboard_executive'):
            is_executive = victim == 'onboard_executive'
            dead, late = (('the executive',),) * 2 if is_executive else ((f'/{victim} is gone',), (f'/{victim}',))
            kind = 'link' if is_executive else 'node'
            found += [
                Happening(kind, dead, lambda name=victim: stack.kill(name), lambda name=victim: self.revive(name)),  # type: ignore[misc]
                Happening(
                    kind,
                    late,
                    lambda name=victim: stack.send_signal(name, signal.SIGSTOP),  # type: ignore[misc]
                    lambda name=victim: self.wake(name),  # type: ignore[misc]
                ),
            ]
        return found

    def revive(self, name: str) -> None:
        """Start a process that is dead."""
        before = self.probe.status.executive_id
        self.start(name)
        if name == 'onboard_executive':
            self.probe.wait(lambda: self.probe.status.executive_id != before, 'another executive', DEADLINE)
        self.probe.wait_ready(DEADLINE)

    def wake(self, name: str) -> None:
        """Let a process go on."""
        self.stack.send_signal(name, signal.SIGCONT)
        heard = len(self.probe.statuses)
        self.probe.wait(lambda: len(self.probe.statuses) > heard, 'the executive', DEADLINE)
        self.probe.wait_ready(DEADLINE)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    about = tmp_path / 'faulty_mission-1.0.dist-info'
    about.mkdir()
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: faulty_mission\nVersion: 1.0\n')
    (about / 'entry_points.txt').write_text(ENTRIES)
    (tmp_path / 'faulty_mission.py').write_text(MISSION)
    (tmp_path / 'claw.xml').write_text(TREE)
    with Stack(tmp_path) as stack, NodeRuntime.open('probe') as runtime:
        yield Robot(stack, Probe(runtime), tmp_path)


def told(robot: Robot, happening: Happening, since: float) -> list[Incident]:
    """Return the incidents since a time that tell of something that has happened."""
    return [
        one
        for one in incidents_in(robot.incidents)
        if any(
            found.kind == happening.kind and found.time >= since and all(word in found.text for word in happening.words)
            for found in one.occurrences
        )
    ]


def forget(robot: Robot, happening: Happening) -> None:
    """Have a black box that tells this again: another one, if this one has told it lately."""
    if told(robot, happening, time.time() - SAME_SECONDS):
        robot.begin_anew()
    wait_until(lambda: not told(robot, happening, time.time() - LATE_SECONDS), 'what is told again', DEADLINE, LOOK)


def test_whatever_goes_wrong_is_told_though_the_black_box_is_killed(robot: Robot) -> None:
    print(f'FLEXBT_SEED={SEED}')
    chance = random.Random(SEED)
    happenings = robot.happenings()
    chance.shuffle(happenings)
    for happening in happenings:
        attack = chance.choice([robot.kill_box, robot.kill_maker, None])
        forget(robot, happening)
        since = time.time() - LATE_SECONDS
        while True:
            happening.do()
            if attack is not None:
                time.sleep(chance.uniform(0.0, 3.0))  # a random moment: nothing depends on it
                attack()
                if attack == robot.kill_box and happening.kind in PASSING and not told(robot, happening, since):
                    happening.mend()
                    attack = None
                    continue
            wait_until(partial(told, robot, happening, since), f'an incident of {happening}', DEADLINE, LOOK)
            happening.mend()
            break
    robot.end_box()
    folders = [*robot.incidents.iterdir(), *robot.earlier.iterdir()]
    known = [*incidents_in(robot.incidents), *incidents_in(robot.earlier)]
    assert {one.name for one in folders} == {one.folder.name for one in known}, 'none is half there'
    for one in known:
        opens(one)


def opens(one: Incident) -> None:
    """Open an incident in every way."""
    page = (one.folder / PAGE).read_text()
    for found in one.occurrences:
        assert found.text in page
    shown = run_console('incidents', one.folder.name, '--directory', str(one.folder.parent))
    assert shown.returncode == 0 and page in shown.stdout, shown
    as_json = run_console('incidents', one.folder.name, '--directory', str(one.folder.parent), '--json')
    assert json.loads(as_json.stdout) == one.facts
    with (one.folder / RECORDING).open('rb') as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count > 0
    player = RunPlayer(one.folder / RECORDING)
    assert player.go_to(player.duration) and player.mirror.view().snapshot is not None, one.folder
    assert (one.folder / 'incident.html').exists() and (one.folder / 'versions.txt').exists()
    json.loads((one.folder / 'parameters.json').read_text())
