# SPDX-License-Identifier: BSD-3-Clause
"""The operator's screen, driven by keys over a link that only notes what is sent."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import random
import re
import signal
import unicodedata
from collections.abc import Awaitable, Callable
from enum import IntEnum
from importlib.resources import files
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.cells import set_cell_size, split_graphemes
from textual import events
from textual._compositor import Compositor
from textual._context import active_app
from textual.keys import _character_to_key
from textual.pilot import Pilot
from textual.widgets import Input, OptionList

from flexbt_common.values.queue_options import QueueOptions
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.completion import offers
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.errors import ConsoleError
from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    SYNTHESIZED,
    ActiveState,
    Behavior,
    BehaviorInput,
    BehaviorList,
    BehaviorParameter,
    BreakpointKind,
    CommandKind,
    CommandResult,
    Decision,
    DecisionKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    GridMap,
    LogLine,
    LogSeverity,
    MissionQueue,
    OperatorCommand,
    Peer,
    QueueEntry,
    ResultCode,
    StateKind,
    StateStructure,
    StopGuard,
    Structure,
    Subject,
    Subjects,
    SubjectValue,
    TreeBreakpoint,
    TreeHold,
)
from flexbt_console.mirror.trees import (
    GONE_SECONDS,
    MirroredNode,
    MirroredNodeKind,
    MirroredStatus,
    TreeNodes,
    TreeReport,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import width
from flexbt_console.present.rendering import alarm_line
from flexbt_console.present.style import ASCII, UNICODE, Tone, tone_of
from flexbt_console.present.tree_lines import acting_lines
from flexbt_console.ui.keys import KEYS
from flexbt_console.ui.screen.app import OperatorScreen, run_screen
from flexbt_console.ui.screen.decision_bar import ROWS, decision_lines
from flexbt_console.ui.screen.dialogs import ChoiceList, MapImage, Overview
from flexbt_console.ui.screen.lines import alarm_text, keys_text, status_text
from flexbt_console.ui.screen.pane import Pane
from flexbt_console.ui.screen.panes import Layout
from flexbt_console.ui.screen.robot_panes import LogPane, machine_lines
from flexbt_console.ui.screen.textual_app import TerminalDriver
from flexbt_console.ui.station import Attention, Station
from flexbt_console.ui.terminal import TerminalWatch
from flexbt_core.clock.clock import ManualClock

KEY_COUNT, KEY_SEED = (
    int(os.environ.get(name, default)) for name, default in (('FLEXBT_KEYS', '80'), ('FLEXBT_SEED', '1'))
)

PLAN = Decision('d1', DecisionKind.TRANSITION, '/Drive', 'done', ('done', 'failed'), 2, prompt='arrived')
OTHER = dataclasses.replace(PLAN, id='d2', outcome='failed')
CHOICE = Decision('d3', DecisionKind.CHOICE, '/Drive', outcomes=('left', 'right'))
WHERE = Decision('d4', DecisionKind.INPUT, '/Ask', input_type='geometry_msgs/msg/PoseStamped', prompt='Where to?')
STRUCTURE = Structure(
    'r1',
    'Patrol',
    (
        StateStructure('/', StateKind.MACHINE, 'Patrol', ('Drive', 'Ask'), ('finished',)),
        StateStructure('/Drive', StateKind.STATE, 'BtExecute', (), ('done', 'failed'), ('/Ask', '=finished'), (2, -1)),
        StateStructure('/Ask', StateKind.STATE, 'Input', (), ('received',), ('/Drive',), (0,)),
    ),
)
RUNNING = [MirroredStatus.RUNNING] * 2
ROOM = GridMap(
    80, 60, 0.05, 0.0, 0.0, bytes(100 if x in (0, 79) or y in (0, 59) else 0 for y in range(60) for x in range(80))
)
SIZES = [(120, 36), (80, 24), (40, 12), (20, 5), (200, 60)]


class NotingLink(RobotLink):
    """What was sent, in its order."""

    def __init__(self, mirror: Mirror) -> None:
        self.mirror = mirror
        self.sent: list[OperatorCommand] = []

    def send(self, command: OperatorCommand, timeout: float, label: str) -> object:
        tracked = self.mirror.give(command, timeout, label)
        self.sent += [command] * (tracked.state is CommandState.PENDING)
        return tracked

    def surroundings(self, has_arrived: Callable[[View], bool], timeout: float, scan_period: float = 0.0) -> View:
        return self.mirror.view()

    @property
    def kinds(self) -> list[CommandKind]:
        return [command.kind for command in self.sent]


class Robot:
    """An executive as the mirror sees it."""

    operator: str | None = 'ann'
    page = ''

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.mirror = Mirror(self.clock, {'kitchen': FramedPose(3.0, 1.0)})
        self.link = NotingLink(self.mirror)
        self.snapshot = ExecutiveSnapshot(
            'e',
            0,
            state=ExecutiveState.RUNNING,
            run_id='r1',
            behavior='Patrol',
            autonomy=1,
            active_states=(ActiveState('/Drive', 1.0, ('FollowPath',)),),
            peers=(Peer('bt_server', alive=True),),
            robot_pose=FramedPose(2.0, 2.0, 0.0),
            stamp=5.0,
        )
        parameters = (BehaviorParameter('speed', 'float', '0.3'), BehaviorParameter('room', choices=('a', 'b')))
        self.mirror.receive_structure(STRUCTURE)
        self.mirror.receive_behaviors(BehaviorList('e', (Behavior('Patrol', parameters=parameters),)))
        self.mirror.receive_map(ROOM)
        self.mirror.receive_plan(((2.0, 2.0), (3.0, 1.0)))
        nodes = [MirroredNode(1, 0, 'Main', 'Sequence'), MirroredNode(2, 1, 'FollowPath', 'FollowPath')]
        nodes.append(MirroredNode(3, 1, 'IsFar', 'IsFar', kind=MirroredNodeKind.CONDITION))
        self.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 1.0))
        self.mirror.receive_tree_status(TreeReport('t', 1, RUNNING, [], 5.0, finished=False, paused=False))
        self.show()
        self.show()

    def station(self) -> Station:
        """Return the robot as its operator has it."""
        make = CommandBuilder(self.operator)
        return Station(self.mirror, self.link, make, 5.0, Attention(self.clock), 'stays', self.page)

    def run_tree(self, *parents: int) -> None:
        """Another tree runs, each of whose nodes does, too; these are their parents."""
        nodes = [MirroredNode(uid, parent, f'Node{uid}', 'Wait') for uid, parent in enumerate(parents, 1)]
        self.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 5.0, 2))
        statuses = [MirroredStatus.RUNNING] * len(nodes)
        report = TreeReport('t', 2, statuses, [], 5.0, finished=False, paused=False, structure=2)
        self.mirror.receive_tree_status(report)

    def show(self, *decisions: Decision, **parts: object) -> None:
        """Publish that this decision waits, and what else is given."""
        changed = {'sequence': self.snapshot.sequence + 1, 'decisions': decisions, **parts}
        self.snapshot = dataclasses.replace(self.snapshot, **changed)  # type: ignore[arg-type]
        self.mirror.receive_snapshot(self.snapshot)


def on_screen(
    robot: Robot,
    steps: Callable[[OperatorScreen, Pilot[None]], Awaitable[None]],
    size: tuple[int, int] = (100, 30),
    robots: FakeRobots | None = None,
    layout: Layout | None = None,
    image_widget: Any = None,
    *,
    is_drawn: bool = False,
) -> None:
    """Run the screen, and what an operator does at it.

    ``is_drawn``: what has changed is drawn for the terminal, too, which nobody reads here.
    """

    async def run() -> None:
        app = OperatorScreen(robot.station(), robot.clock, robots, layout=layout, image_widget=image_widget)
        async with app.run_test(size=size) as pilot:
            app.animation_level = 'none'
            await seen(robot, pilot)
            await steps(app, pilot)

    with pytest.MonkeyPatch.context() as patch:
        for module in ('app', 'pilot'):
            patch.setattr(f'textual.{module}.wait_for_idle', all_done)
        if not is_drawn:
            patch.setattr(Compositor, 'render_update', draw_nothing)
        asyncio.run(run())


def draw_nothing(compositor: Compositor, **_: object) -> None:
    """Stand in for what draws what has changed: only lists are, which count their lines by it."""
    for widget in compositor.visible_widgets:
        if isinstance(widget, OptionList):
            widget.render_line(0)
    compositor._dirty_regions.clear()


async def all_done(*_: float) -> None:
    """Wait until what was begun is done. Textual's own waits until the process is idle, by a clock: 20 ms or more."""
    ready = asyncio.get_running_loop()._ready  # type: ignore[attr-defined]
    for _again in range(4):  # a layout may scroll, and that lead to another one
        while ready:
            await asyncio.sleep(0)
        active_app.get().screen._on_timer_update()
    while ready:
        await asyncio.sleep(0)


async def seen(robot: Robot, pilot: Pilot[None]) -> None:
    """Wait until the screen shows what the mirror has, and the operator has had the time to see it."""
    app = pilot.app
    assert isinstance(app, OperatorScreen)
    await pilot.pause()
    app.draw()
    await pilot.pause()
    robot.clock.advance(1.0)


def text_of(app: OperatorScreen) -> str:
    """Return what is on the screen, without colours."""
    return '\n'.join(''.join(segment.text for segment in line) for line in app.screen._compositor.render_strips())


@pytest.mark.parametrize('size', SIZES)
def test_everything_of_now_is_on_the_screen(size: tuple[int, int]) -> None:
    robot = Robot()
    robot.show(PLAN, peers=(Peer('navigation', alive=False),))

    async def look(app: OperatorScreen, pilot: Pilot[None]) -> None:
        shown = text_of(app)
        assert len(shown.splitlines()) == size[1]
        assert max(map(len, shown.splitlines())) <= size[0]
        if size[0] >= 80:
            for text in (
                'LIVE',
                'RUNNING',
                'Patrol',
                'navigation not found',
                'Drive',
                'FollowPath',
                'IsFar?',
                '[1 done*',
                'kitchen',
            ):
                assert text in shown, text
            assert '→ Ask' in shown  # what the answer leads to
            assert shown.count('→') > 1  # the robot, by its heading
        robot.show(PLAN, peers=(Peer('bt_server', alive=False, since=6.0),))
        await seen(robot, pilot)
        shown = text_of(app)
        if size[0] >= 80:
            assert 'tree Drive  SERVER GONE' in shown and 'FollowPath' in shown and 'running' not in shown
        robot.clock.advance(GONE_SECONDS)
        await seen(robot, pilot)
        assert 'tree Drive' not in text_of(app)

    on_screen(robot, look, size)


def test_enter_answers_the_decision_on_the_screen_and_no_later_one() -> None:
    robot = Robot()
    robot.show(PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('2')
        robot.show(OTHER)  # it is another one now; what was picked is gone with the one before
        await seen(robot, pilot)
        assert '[1 done' not in text_of(app) and '[2 failed*' in text_of(app)
        assert f'[{OTHER.id}]' not in text_of(app)  # "status" has it
        robot.show(PLAN)
        await pilot.pause()
        app.draw()
        await pilot.press('enter')  # sooner than anybody can have read it
        assert robot.link.sent == []
        await seen(robot, pilot)
        assert 'appeared just' in text_of(app)
        await pilot.press('enter')
        (sent,) = robot.link.sent
        assert (sent.kind, sent.decision_id, sent.outcome) == (CommandKind.CONFIRM, 'd1', '')
        assert sent.wait_interaction >= 0.0 and sent.wait_queue >= 0.0

    on_screen(robot, steps)


@pytest.mark.parametrize('size', SIZES)
def test_the_queue_is_on_the_screen_and_its_key_offers_what_can_be_done(size: tuple[int, int]) -> None:
    robot = Robot()
    entries = (
        QueueEntry(4, 'Patrol', waits_for='the queue is held', operator='bob'),
        QueueEntry(7, 'In\x1b[2Jspect', QueueOptions(count=3, interval=600.0), waits_for='the queue is held'),
    )
    robot.mirror.receive_queue(MissionQueue('e', 2, 'STOP by bob', entries))
    idle = {'state': ExecutiveState.IDLE, 'active_states': (), 'queue_length': 2, 'queue_held': 'STOP by bob'}

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        if size[0] >= 80:
            assert 'queue: 2 entries, HELD' in text_of(app)
            robot.show(**idle)
            await seen(robot, pilot)
            for text in ('HELD: STOP by bob', '4  Patrol: the queue is held', 'every 10 min'):
                assert text in text_of(app), text
        await pilot.press('m', *'release', 'enter')
        robot.show()
        await seen(robot, pilot)
        for keys in (['m'], ['7'], ['enter'], [*'remove'], ['enter']):
            await pilot.press(*keys)
            await pilot.pause()
        sent = [(one.kind, one.queue_number) for one in robot.link.sent]
        assert sent == [(CommandKind.QUEUE_RELEASE, 2), (CommandKind.QUEUE_REMOVE, 7)]
        robot.show()
        await seen(robot, pilot)
        for keys in (['m'], ['4'], ['enter'], [*'edit'], ['enter']):
            await pilot.press(*keys)
            await pilot.pause()
        assert app._line.value == 'queue edit 4 '

    robot.show(queue_length=2, queue_held='STOP by bob')
    on_screen(robot, steps, size)


def test_a_decision_that_is_gone_is_not_answered() -> None:
    robot = Robot()
    robot.show(PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        robot.show(CHOICE)  # the status has come, and is not drawn yet
        await pilot.press('enter')
        assert robot.link.sent == []

    on_screen(robot, steps)


def test_a_choice_has_to_be_picked_first() -> None:
    robot = Robot()
    robot.show(CHOICE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('enter', '3')
        assert robot.link.sent == []
        robot.clock.advance(1.0)
        robot.show(CHOICE)
        await pilot.press('2', 'enter')
        assert [(one.kind, one.outcome) for one in robot.link.sent] == [(CommandKind.FORCE, 'right')]

    on_screen(robot, steps)


def test_an_answer_to_what_was_not_received_is_asked_for_once_more() -> None:
    robot = Robot()
    judged = dataclasses.replace(CHOICE, subject=('path', 'goal'), subject_number=1)
    robot.show(judged)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        rows = text_of(app).splitlines()
        assert any('path, goal NOT RECEIVED  x 2.00 y 2.00' in row for row in rows)  # in the place of the plan's length
        assert any('path, goal NOT RECEIVED: the subject of this decision is not shown' in row for row in rows)
        assert all(len(row) <= 80 for row in rows) and 'plan 1.4 m' not in text_of(app)
        await pilot.press('2', 'enter', 'enter', 'enter')  # who presses Enter again and again sends nothing
        assert robot.link.sent == [] and 'the subject was not received' in text_of(app)
        await pilot.press(*'wait', 'enter')
        assert robot.link.sent == []
        robot.clock.advance(1.0)
        robot.show(judged)
        await pilot.press('2', 'enter', *'right', 'enter')
        await pilot.pause()
        assert [(one.kind, one.outcome) for one in robot.link.sent] == [(CommandKind.FORCE, 'right')]

    on_screen(robot, steps, (80, 24))


def test_what_a_decision_is_about_is_on_the_screen() -> None:
    robot = Robot()
    robot.show(dataclasses.replace(CHOICE, subject=('path', 'goal'), subject_number=1))
    path = SubjectValue('path', 'nav_msgs/msg/Path', points=((2.0, 2.0), (2.0, 1.0), (3.0, 1.0)))
    goal = SubjectValue('goal', 'geometry_msgs/msg/PoseStamped', pose=FramedPose(3.0, 1.0))
    robot.mirror.receive_subjects(Subjects('e', (Subject(CHOICE.id, 1, (path, goal)),)))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'about path: 2.0 m to kitchen; goal: kitchen' in text_of(app)
        assert 'x 2.00 y 2.00 yaw 0.00  plan 2.0 m' in text_of(app)
        await pilot.press('2', 'enter')
        assert [one.outcome for one in robot.link.sent] == ['right']

    on_screen(robot, steps, (80, 24))


def test_a_pose_is_pointed_at_on_the_map() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('g', 'right', 'right', 'up', 'less_than_sign')
        assert 'cursor x' in text_of(app)
        await pilot.press('enter')
        (answer,) = robot.link.sent
        assert answer.kind is CommandKind.ANSWER and answer.decision_id == 'd4'
        assert '2.' in answer.inputs[0].text

    on_screen(robot, steps)


def test_a_cursor_that_was_not_moved_is_no_answer() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('g')
        await seen(robot, pilot)
        await pilot.press('enter')
        await seen(robot, pilot)
        assert robot.link.sent == [] and 'the cursor was not moved yet' in text_of(app)
        robot.show(WHERE)
        await pilot.press('greater_than_sign', 'enter')  # there, and another heading
        assert robot.link.kinds == [CommandKind.ANSWER]

    on_screen(robot, steps)


def test_an_answer_that_is_typed_on_the_screen_itself_declines_and_repeats_nothing() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for typed in ('dock', 'retry', 'recover', 'done'):
            await pilot.press(*typed, 'enter', 'escape', 'escape')
            assert robot.link.sent == [], typed
        await pilot.press('d', 'enter')
        assert robot.link.kinds == [CommandKind.DECLINE]

    on_screen(robot, steps)


def test_enter_on_an_offer_that_was_marked_shows_it_before_it_is_done() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        first, second, *_ = offers('lock', robot.mirror.view())
        assert (first.line, second.line) == ('lock', 'unlock')
        await pilot.press(*':lock', 'down', 'enter')
        assert app.query_one('#line', Input).value == 'unlock' and app._line.is_open

    on_screen(robot, steps)


def test_pointing_ends_with_the_question() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('g', 'right')
        robot.show(CHOICE)
        await seen(robot, pilot)
        await pilot.press('enter')
        assert robot.link.sent == []

    on_screen(robot, steps)


@pytest.mark.parametrize('before', [[], ['colon', 'n', 'o'], ['f'], ['question_mark'], ['z', 'z'], ['g']])
def test_the_stop_key_works_everywhere(before: list[str]) -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press(*before, 'f8')
        assert robot.link.kinds == [CommandKind.STOP]

    on_screen(robot, steps)


def test_blind_it_says_so_and_refuses_all_but_stop() -> None:
    robot = Robot()
    robot.show(PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        robot.clock.advance(60.0)
        await seen(robot, pilot)
        assert 'NO LINK' in text_of(app) and 'LOST' in text_of(app)
        await pilot.press('1', 'enter', 'p', 'enter', 'plus', 'enter')
        assert robot.link.sent == []
        await pilot.press('exclamation_mark')
        assert robot.link.kinds == [CommandKind.STOP]

    on_screen(robot, steps)


def test_keys_give_the_commands_of_the_registry() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('p')
        assert app.query_one('#line', Input).value == 'pause' and robot.link.sent == []  # it is shown first
        await pilot.press('enter', *(key for name in ('plus', 'l', 'b', 'r', 'c') for key in (name, 'enter')))
        expected = [
            CommandKind.PAUSE,
            CommandKind.AUTONOMY,
            CommandKind.LOCK,
            CommandKind.BREAKPOINT,
            CommandKind.REPEAT,
            CommandKind.CLAIM_AUTHORITY,
        ]
        assert robot.link.kinds == expected
        assert robot.link.sent[1].autonomy == 2 and robot.link.sent[2].path == '/Drive'
        robot.show(state=ExecutiveState.PAUSED, locked=('/Drive',), breakpoints=('/Drive',), authority='ann')
        await seen(robot, pilot)
        await pilot.press(*(key for name in 'plbc' for key in (name, 'enter')))
        expected = [
            CommandKind.RESUME,
            CommandKind.UNLOCK,
            CommandKind.CLEAR_BREAKPOINT,
            CommandKind.RELEASE_AUTHORITY,
        ]
        assert robot.link.kinds[6:] == expected
        for holder, asking, expected_kind in (
            ('bob', (), CommandKind.CLAIM_AUTHORITY),  # asked for
            ('bob', ('ann',), CommandKind.RELEASE_AUTHORITY),  # not any more
        ):
            robot.show(authority=holder, authority_requests=asking)
            await seen(robot, pilot)
            assert 'c authority' in text_of(app).splitlines()[-1]
            await pilot.press('c', 'enter')
            assert robot.link.kinds[-1] is expected_kind

    on_screen(robot, steps)


def test_a_node_is_selected_and_debugged_and_a_held_tree_steps_and_goes_on() -> None:
    robot = Robot()
    nodes = [MirroredNode(1, 0, 'Main', 'Sequence', 'Main'), MirroredNode(2, 1, 'Turn', 'Spin', 'Main/Turn')]
    robot.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 5.0, 2))
    report = TreeReport('t', 2, [MirroredStatus.RUNNING] * 2, [], 5.0, finished=False, paused=False, structure=2)
    robot.mirror.receive_tree_status(report)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('t', *'Turn', 'enter')  # the node
        await pilot.pause()
        await pilot.press(*'break', 'enter')  # what to do there
        await pilot.pause()
        (sent,) = robot.link.sent
        assert (sent.kind, sent.path, sent.tree_run_id) == (CommandKind.TREE_BREAK, 'Main/Turn', 't')
        robot.show()
        await seen(robot, pilot)  # a while later: letters in a row are a word
        await pilot.press('e')
        await pilot.pause()
        app.draw()
        await pilot.pause()
        assert 'no tree is held or paused' in text_of(app)
        hold = TreeHold('t', 'Drive', 'Main/Turn', 'bob', 1.0, 'breakpoint')
        point = TreeBreakpoint(BreakpointKind.BREAK, 'Drive', 'Main/Turn', operator='bob')
        robot.show(tree_holds=(hold,), tree_breakpoints=(point,))
        await seen(robot, pilot)
        shown = text_of(app)
        assert 'tree Drive HELD before Main/Turn for 4 s (breakpoint of bob)' in shown and 'HELD HERE' in shown
        assert 'e tree step' in shown.splitlines()[-1]
        await pilot.press('e')
        assert app.query_one('#line', Input).value == 'tree step --run t' and len(robot.link.sent) == 1
        await pilot.press('enter', 'v', 'enter')
        assert robot.link.kinds[1:] == [CommandKind.TREE_STEP, CommandKind.TREE_CONTINUE]

    on_screen(robot, steps)


def test_the_name_of_a_node_is_escaped_where_it_is_the_title_of_a_list() -> None:
    robot = Robot()
    nodes = [MirroredNode(1, 0, 'Turn', 'Spin', 'Turn\x1b[2J')]
    robot.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 5.0, 2))
    report = TreeReport('t', 2, [MirroredStatus.RUNNING], [], 5.0, finished=False, paused=False, structure=2)
    robot.mirror.receive_tree_status(report)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('t', *'Turn', 'enter')
        await pilot.pause()
        assert 'Turn\\e[2J' in text_of(app) and '\x1b' not in text_of(app)

    on_screen(robot, steps, (80, 24))


def test_what_a_robot_has_put_into_a_field_is_shown_harmless_and_sent_as_it_is() -> None:
    robot = Robot()
    robot.show(active_states=(ActiveState('/Turn\x1b[2J', 1.0),))
    parameter = BehaviorParameter('way', 'string', 'a\x1b[2J', ('a\x1b[2J', 'b\x07'))
    robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Patrol', parameters=(parameter,)),)))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('r')
        await pilot.pause()
        assert "repeat '/Turn [2J'" in text_of(app)
        await pilot.press('enter')
        assert robot.link.sent[0].path == '/Turn\x1b[2J'
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        await seen(robot, pilot)
        await pilot.press('s', 'down', 'enter')
        await pilot.pause()
        assert 'a [2J' in text_of(app) and '\x1b' not in text_of(app)
        await pilot.press('down', 'enter')
        assert robot.link.sent[1].arguments == (('way', 'b\x07'),)

    on_screen(robot, steps, (80, 24))


def test_who_is_asked_for_the_authority_gives_it_to_one_and_refuses_another() -> None:
    robot = Robot()
    assert 'authority' not in keys_text(robot.mirror.view(), 200, 'ann').plain
    robot.show(authority='ann', authority_requests=('bob', 'eve on her way'))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        shown = text_of(app)
        assert (
            'bob and 1 more request control: press "c" to answer' in shown and 'c authority' in shown.splitlines()[-1]
        )
        await pilot.press('c', 'escape')
        assert robot.link.sent == []
        for downs, kind, grantee in (
            (1, CommandKind.HAND_OVER_AUTHORITY, 'bob'),
            (4, CommandKind.REFUSE_AUTHORITY, 'eve on her way'),
            (5, CommandKind.RELEASE_AUTHORITY, ''),
        ):
            await pilot.press('c', *['down'] * downs, 'enter')
            assert (robot.link.sent[-1].kind, robot.link.sent[-1].grantee) == (kind, grantee)

    on_screen(robot, steps, (80, 24))


def test_of_several_active_states_the_one_that_a_key_is_for_is_chosen() -> None:
    robot = Robot()
    both = StateStructure('/Both', StateKind.CONCURRENCY, 'Concurrency', ('Drive', 'Look'), ('done',))
    inner = [StateStructure(f'/Both/{name}', StateKind.STATE, 'Wait', (), ('done',)) for name in both.children]
    robot.mirror.receive_structure(Structure('r1', 'Patrol', (*STRUCTURE.states, both, *inner)))
    robot.show(active_states=tuple(ActiveState(one.path, 1.0) for one in inner), locked=('/Both',))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('b')
        assert robot.link.sent == []
        await pilot.pause()
        assert 'breakpoint /Both/Drive' in text_of(app) and '>' not in text_of(app)  # nothing is marked
        await pilot.press('enter', 'down', 'down', 'enter')
        await pilot.press('r', *'/Both/Drive', 'enter', *('l', 'end', 'enter'), *('l', 'escape'))
        await pilot.pause()
        assert [(one.kind, one.path) for one in robot.link.sent] == [
            (CommandKind.BREAKPOINT, '/Both/Look'),
            (CommandKind.REPEAT, '/Both/Drive'),
            (CommandKind.UNLOCK, '/Both'),
        ]
        robot.show(dataclasses.replace(PLAN, path='/Both'), active_states=(), locked=())  # all inside it has ended
        await seen(robot, pilot)
        await pilot.press('l', 'enter')
        assert (robot.link.kinds[-1], robot.link.sent[-1].path) == (CommandKind.LOCK, '/Both')

    on_screen(robot, steps)


def test_of_many_answers_each_can_be_picked_and_what_enter_sends_is_seen() -> None:
    robot = Robot()
    many = tuple(f'{"部屋" * 20} {number}' for number in range(1, 61))
    robot.show(dataclasses.replace(PLAN, outcome=many[49], outcomes=many, prompt='x' * 900), PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        shown = text_of(app)
        assert '[50 部屋' in shown and re.search(r'\+\d+ more: 0', shown) and '(+1 more)' in shown
        await pilot.press('0', *('down',) * 40, 'enter')
        await pilot.pause()
        app.draw()
        await pilot.pause()
        assert '[40 部屋' in text_of(app) and '[50' not in text_of(app) and robot.link.sent == []
        await pilot.press('0', 'down')
        robot.show(OTHER)  # while the list of the one before is open
        await seen(robot, pilot)
        await pilot.press('enter')
        await seen(robot, pilot)
        assert 'the decision changed' in text_of(app) and '[2 failed*' in text_of(app) and robot.link.sent == []

    on_screen(robot, steps, (80, 24))


def test_a_state_is_forced_in_two_steps() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('f')
        await pilot.pause()
        assert 'failed' in text_of(app)
        await pilot.press('escape')
        assert robot.link.sent == []
        await pilot.press('f', 'down', 'down')
        await pilot.pause()
        assert '> /Drive: failed' in text_of(app)  # not by colour alone
        await pilot.press('enter')
        await pilot.pause()
        (sent,) = robot.link.sent
        assert (sent.kind, sent.path, sent.outcome) == (CommandKind.FORCE, '/Drive', 'failed')

    on_screen(robot, steps)


BOTH = StateStructure('/Both', StateKind.CONCURRENCY, 'Concurrency', ('Drive', 'Look'), ('done',))
INNER = tuple(
    StateStructure(f'/Both/{name}', StateKind.STATE, 'Wait', (), outcomes, targets)
    for name, outcomes, targets in (
        ('Drive', ('done', 'failed', 'canceled'), ('/Both/Look', '/canceled', '=done')),
        ('Look', ('done', 'Done', 'seen it'), ('=failed', '=done', '=seen')),
    )
)
NAMES = (
    'yes',
    'pause',
    'claim',
    'up',
    'job 12',
    'done',
    'failed',
    'canceled',
    'seen it',
    'look done',
    '/Both/Look',
    'Patrol',
    'Errand',
    'handover bob',
    'release',
)


@example([('', word) for word in ('canceled', 'yes', 'jump', 'magic', '12', 'timeout', 'x p', '4')])
@given(
    st.lists(
        st.tuples(
            st.sampled_from(('', '', '', 'f', 'l', 'b', 'c', 'p', 'r', '0', 'w', 'a', ':')),
            st.one_of(st.sampled_from(NAMES), st.sampled_from(NAMES).map(lambda name: name[:3]), st.text(max_size=8)),
        ),
        min_size=8,
        max_size=8,
    )
)
@settings(max_examples=12, deadline=None)
def test_what_is_typed_into_a_list_is_what_is_sent_or_nothing(tries: list[tuple[str, str]]) -> None:
    """So it is with what is typed where no list is open: its first letter is a key, and no other one is."""
    robot = Robot()
    robot.mirror.receive_structure(Structure('r1', 'Patrol', (*STRUCTURE.states, BOTH, *INNER)))
    robot.mirror.receive_behaviors(
        BehaviorList('e', (Behavior('Patrol'), Behavior('Errand'), Behavior('Bad', error='x')))
    )
    asked = [Decision(f'd{state.path}', DecisionKind.CHOICE, state.path, outcomes=state.outcomes) for state in INNER]
    asked[0] = dataclasses.replace(asked[0], kind=DecisionKind.TRANSITION, outcome='done', required_autonomy=3)
    active = tuple(ActiveState(one.path, 1.0) for one in INNER)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for key, word in tries:
            robot.show(*asked, active_states=active, authority='ann', authority_requests=('bob', 'eve'))  # it is live
            await pilot.pause()
            app.draw()
            robot.link.sent.clear()
            word = ''.join(sign for sign in word if sign.isprintable() and sign not in 'q!')  # which leave, and stop
            if not key and not (word := ''.join(sign for sign in word if sign.isalnum() or sign in ' /').strip()):
                continue  # Enter alone confirms
            type_at_once(app, key, *word, 'enter', 'enter', 'enter', 'escape', 'escape', 'escape')
            await seen(robot, pilot)
            if not key:
                key, word = word[:1], word[1:]
            for sent in robot.link.sent:
                texts = {
                    CommandKind.FORCE: [sent.outcome, f'{sent.path} {sent.outcome}', f'{_last(sent)} {sent.outcome}'],
                    CommandKind.CONFIRM: ['confirm', 'done'],
                    CommandKind.SWITCH: [sent.behavior],
                    CommandKind.LOCK: [sent.path, f'lock {sent.path}'],
                    CommandKind.BREAKPOINT: [sent.path, f'breakpoint {sent.path}'],
                    CommandKind.REPEAT: [sent.path, f'repeat {sent.path}'],
                    CommandKind.HAND_OVER_AUTHORITY: [f'handover {sent.grantee}'],
                    CommandKind.REFUSE_AUTHORITY: [f'refuse {sent.grantee}'],
                    CommandKind.RELEASE_AUTHORITY: ['release'],
                    CommandKind.CLAIM_AUTHORITY: ['claim'],
                    CommandKind.PAUSE: ['pause'] if key == ':' else [''],
                    CommandKind.NOTE: [sent.text],  # it changes nothing
                }.get(sent.kind, [])
                outcome = sent.outcome or 'done'
                numbers = [str(number) for number, one in enumerate(asked[0].outcomes, 1) if one == outcome]
                is_answer = sent.kind in (CommandKind.FORCE, CommandKind.CONFIRM)
                typed = ' '.join(word.split()).replace(': ', ' ').casefold()
                allowed = [text.casefold() for text in (*texts, *(numbers if is_answer and key in ':f' else ()))]
                is_picked = is_answer and not word and [key] == numbers
                assert typed in allowed or is_picked, (key, word, sent)

    on_screen(robot, steps)


def _last(command: OperatorCommand) -> str:
    return command.path.rpartition('/')[2]


def test_what_is_typed_in_full_is_sent_and_what_is_no_name_asks() -> None:
    robot = Robot()
    robot.mirror.receive_structure(Structure('r1', 'Patrol', (*STRUCTURE.states, BOTH, *INNER)))
    robot.show(active_states=tuple(ActiveState(one.path, 1.0) for one in INNER))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for typed, told in (
            ('', 'nothing is marked yet'),
            ('cancel', 'no line has this name'),
            ('nonsense', 'no line has this name'),
            ('done', '2 lines have this name'),  # of either state
        ):
            await pilot.press('f', *typed, 'enter', 'enter')
            await pilot.pause()
            assert told in text_of(app) and robot.link.sent == []
            await pilot.press('escape')
        for typed, path, outcome in (
            ('canceled', '/Both/Drive', 'canceled'),
            ('Done', '/Both/Look', 'Done'),
            ('FAILED', '/Both/Drive', 'failed'),
            ('drive done', '/Both/Drive', 'done'),
        ):
            await pilot.press('f', *typed, 'enter')
            assert (robot.link.sent[-1].path, robot.link.sent[-1].outcome) == (path, outcome)
        await pilot.press('f', 'down', *'canceled', 'enter')  # what was marked before is not any more
        assert robot.link.sent[-1].outcome == 'canceled'

    on_screen(robot, steps)


def test_a_behavior_that_cannot_be_loaded_is_listed_with_the_reason_and_cannot_be_started() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    broken = Behavior('Broken', error='ImportError: no module named [moveit]')
    robot.mirror.receive_behaviors(BehaviorList('e', (broken, Behavior('Patrol'))))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('s')
        await pilot.pause()
        assert 'Broken' in text_of(app) and 'not possible: ImportError: no module named [moveit]' in text_of(app)
        await pilot.press(*'broken', 'enter')
        assert isinstance(app.screen, ChoiceList)
        await pilot.press(*('backspace',) * 6, 'down', 'enter')
        await pilot.pause()
        assert 'start Patrol' in text_of(app)  # the arrows pass over it
        robot.clock.advance(0.75)  # an Enter that follows at once starts nothing
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        await pilot.press('enter')
        assert [one.behavior for one in robot.link.sent] == ['Patrol']
        await pilot.press(*':start ')
        await seen(robot, pilot)
        assert re.search(r'start Broken +not possible: ImportError: no module named \[moveit\]', text_of(app))
        robot.show()
        await pilot.press(*'Broken', 'enter')
        await seen(robot, pilot)
        assert len(robot.link.sent) == 1 and "'Broken' cannot be used: ImportError" in text_of(app)

    on_screen(robot, steps)


def test_a_form_names_each_parameter_by_its_label_with_unit_and_limits() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    speed = BehaviorParameter('speed', 'float', '0.3', (), 'while it carries', 'Top speed', 'm/s', '0', '1.5')
    robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Patrol', parameters=(speed,)),)))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('s', 'down', 'enter')
        await pilot.pause()
        assert 'Top speed [speed] (float, from 0 to 1.5 m/s)  while it carries' in text_of(app)
        await pilot.press(*'3', 'enter')
        assert "'3' is beyond its limits (from 0 to 1.5 m/s)" in text_of(app) and robot.link.sent == []
        await pilot.press('backspace', *'1.5', 'enter')
        assert robot.link.sent[0].arguments == (('speed', '1.5'),)

    on_screen(robot, steps)


def test_a_behavior_is_started_by_its_form() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('s', *'patrol', 'enter')
        await pilot.pause()
        assert 'speed (float)' in text_of(app)
        await pilot.press(*'0.5', 'ctrl+s')
        await pilot.pause()
        (start,) = robot.link.sent
        assert start.kind is CommandKind.START and start.behavior == 'Patrol'
        assert start.arguments == (('speed', '0.5'), ('room', 'a'))

    on_screen(robot, steps)


def test_a_form_takes_only_what_its_types_can_be() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    types = {'count': ('int', '3'), 'speed': ('float', ''), 'careful': ('bool', 'false'), 'name': ('string', '')}
    parameters = tuple(BehaviorParameter(name, *given) for name, given in types.items())
    robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Errand', parameters=parameters),)))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('s', 'down', 'enter', *'1.5', 'enter')
        assert robot.link.sent == [] and 'not a valid int' in text_of(app)  # what was typed is not rounded
        await pilot.press('backspace', 'backspace', 'tab', *'fast', 'enter')
        assert robot.link.sent == [] and 'not a valid float' in text_of(app)
        await pilot.press(*('backspace',) * 4, *'-1.5e-3', 'tab', 'up', 'tab', *'a 1', 'ctrl+s')
        (start,) = robot.link.sent
        assert dict(start.arguments) == {'count': '1', 'speed': '-1.5e-3', 'careful': 'true', 'name': 'a 1'}

    on_screen(robot, steps)


def test_the_map_is_an_image_where_the_terminal_has_images() -> None:
    images = pytest.importorskip('textual_image.widget', reason='pip install textual-image')
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('colon', *'map', 'enter')
        while not isinstance(app.screen, MapImage):
            await pilot.pause()
        await pilot.pause()
        image = app.screen.query_one(images.HalfcellImage)
        colours = {tuple(colour) for _, colour in image.image.getcolors(1 << 20)}
        assert {(40, 40, 40), (255, 255, 255), (0, 138, 94)} <= colours, 'walls, free, robot'
        width, height = image.size
        assert 10 < width <= 80 and 10 < height <= 30 and image.region.bottom <= 29
        first = image.image
        app.screen.draw()
        assert image.image is first, 'nothing has changed'
        robot.show(robot_pose=FramedPose(1.0, 1.0, 0.0))
        app.screen.draw()
        assert image.image is not first
        await pilot.press('escape')
        assert len(app.screen_stack) == 1 and robot.link.sent == []

    on_screen(robot, steps, size=(80, 30), image_widget=images.HalfcellImage)


def test_a_form_gives_input_userdata_to_a_behavior() -> None:
    robot = Robot()
    (patrol,) = robot.mirror.view().behaviors or ()
    goal = BehaviorInput('goal', 'geometry_msgs/PoseStamped', 'where to drive', needed=True)
    robot.mirror.receive_behaviors(BehaviorList('e', (dataclasses.replace(patrol, inputs=(goal,)),)))
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('s', 'down', 'enter')
        shown = text_of(app)
        assert 'goal (geometry_msgs/PoseStamped)  where to drive' in shown and 'autonomy  off, low' in shown
        await pilot.press('tab', 'tab', 'enter')
        assert robot.link.sent == [] and "input 'goal' is needed" in text_of(app)
        await pilot.press(*'kitchn', 'enter')
        assert robot.link.sent == [] and "did you mean 'kitchen'" in text_of(app)
        await pilot.press(*('backspace',) * 6, *'1 2 0', 'tab', *'high', 'up', 'tab', *'n=int:7', 'enter')
        (start,) = robot.link.sent
        assert [(one.key, one.type) for one in start.inputs] == [('goal', 'geometry_msgs/PoseStamped'), ('n', 'int')]
        assert start.autonomy == 1 and start.arguments == (('room', 'a'),)

    on_screen(robot, steps, (100, 40))


def test_a_form_shows_the_machine_that_was_synthesized_and_asks_where_it_has_not_arrived() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    made = Behavior('Look there', SYNTHESIZED, machine='# look\n' + ''.join(f'line{n}: x\n' for n in range(50)))
    robot.mirror.receive_behaviors(BehaviorList('e', (made,)))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        async def open_form() -> None:
            await pilot.press('s', *'look there', 'enter')
            await seen(robot, pilot)
            robot.show(state=ExecutiveState.IDLE)

        await open_form()
        assert 'machine, as it was synthesized' in text_of(app) and '# look' in text_of(app)
        await pilot.press('pagedown', 'pagedown', 'pagedown')
        await pilot.pause()
        assert 'line49: x' in text_of(app)
        robot.mirror.receive_behaviors(BehaviorList('e', (dataclasses.replace(made, machine='# other'),)))
        await pilot.press('enter')
        await seen(robot, pilot)
        assert 'has changed since the form was opened; nothing was sent' in text_of(app) and robot.link.sent == []
        await open_form()
        await pilot.press('enter')
        assert [one.behavior for one in robot.link.sent] == ['Look there']
        robot.mirror.receive_behaviors(BehaviorList('e', (dataclasses.replace(made, machine=''),)))
        for keys, count in ((('enter',), 1), (('down', 'enter'), 1), (('down', 'down', 'enter'), 2)):
            robot.clock.advance(1.0)
            await open_form()
            assert 'machine NOT RECEIVED' in text_of(app)
            await pilot.press('enter')
            await seen(robot, pilot)
            await pilot.press(*keys)
            assert len(robot.link.sent) == count
            await pilot.press('escape')

    on_screen(robot, steps, (80, 24))


def test_any_command_can_be_typed_and_its_fate_is_told() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('colon', *'autonomy f', 'tab', 'enter')
        (sent,) = robot.link.sent
        assert (sent.kind, sent.autonomy) == (CommandKind.AUTONOMY, 3)
        robot.show(results=(CommandResult(sent.id, ResultCode.REFUSED, 'bob has the authority'),))
        await seen(robot, pilot)
        assert 'refused: bob has the authority' in text_of(app)
        await pilot.press('colon', *'fly', 'enter')
        await seen(robot, pilot)
        assert len(robot.link.sent) == 1 and "no command 'fly'" in text_of(app)

    on_screen(robot, steps)


def type_at_once(app: OperatorScreen, *keys: str) -> None:
    """Keys that have all been typed before the screen deals with the first."""
    for key in keys:
        app.post_message(events.Key(_character_to_key(key), key) if len(key) == 1 else events.Key(key, None))


def test_keys_typed_at_once_behind_the_colon_are_for_the_line() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def type_quickly(app: OperatorScreen, pilot: Pilot[None]) -> None:
        type_at_once(app, *':claix', 'backspace', 'tab', '!')
        await pilot.pause()
        assert app.query_one('#line', Input).value == 'claim!' and robot.link.sent == []
        await pilot.press('escape', *':cl', 'home', 'tab')
        assert app.query_one('#line', Input).value == 'cl'  # a completion is not seen there
        await pilot.press('escape', *'n', 'x', 'f8')
        assert app.query_one('#line', Input).value == 'note x' and robot.link.kinds == [CommandKind.STOP]

    on_screen(robot, type_quickly)


def test_ctrl_c_gives_up_what_was_typed_and_ctrl_q_leaves_as_q_does() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def press(app: OperatorScreen, pilot: Pilot[None]) -> None:
        def told(text: str) -> int:
            return sum(text in line for line in app._panes.log.told)

        line = app.query_one('#line', Input)
        for count, begun in enumerate(((), (*':stop',), ('g',), ('q',)), 1):
            await pilot.press(*begun, 'ctrl+c')
            await seen(robot, pilot)
            assert not line.has_class('typing') and told('Ctrl-C') == count
            assert 'Press q to quit: stays. Press ! or F8 to stop the robot.' in text_of(app)
        for begun, count in ((), 2), ((*':x',), 2), (('escape', 'w'), 2), (('escape',), 3):
            await pilot.press(*begun, 'ctrl+q', 'ctrl+c')  # what runs is not left by one key, nor out of what is open
            assert app._exit is False and told('Press q again to quit: stays. Esc to stay') == count
        await pilot.press('ctrl+q', 'ctrl+q')
        assert app._exit is True and robot.link.sent == []

    on_screen(robot, press)


def test_keys_typed_at_once_are_for_the_form_that_they_open() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    parameters = (BehaviorParameter('speed', 'float', '0.3'), BehaviorParameter('name', 'str', 'x'))
    behaviors = (Behavior('Patrol'), Behavior('Errand', parameters=parameters))
    robot.mirror.receive_behaviors(BehaviorList('e', behaviors))

    async def type_quickly(app: OperatorScreen, pilot: Pilot[None]) -> None:
        type_at_once(app, 's', *'errand', 'enter', 'right', '9', 'backspace', '7', 'tab', *'bp+', 'enter')
        await pilot.pause()
        (start,) = robot.link.sent
        assert start.behavior == 'Errand'
        assert start.arguments == (('speed', '0.37'), ('name', 'bp+'))

    on_screen(robot, type_quickly)


def test_enter_twice_at_once_starts_once() -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')

    async def type_quickly(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for count, parameters in enumerate(((), (BehaviorParameter('speed', 'float', '0.3'),)), 1):
            robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Errand', parameters=parameters),)))
            await pilot.press('s', 'down', 'enter', 'enter', 'enter')
            assert len(robot.link.kinds) == count - 1 and 'just opened' in text_of(app)  # nobody has read it yet
            for seconds in (0.66, 0.04, 0.04):  # a key that is held down
                robot.clock.advance(seconds)
                await pilot.press('enter')
            assert len(robot.link.kinds) == count - 1
            robot.clock.advance(0.75)
            robot.show()
            type_at_once(app, 'enter', 'enter')
            await pilot.pause()
            assert robot.link.kinds == [CommandKind.START] * count and len(app.screen_stack) == 1

    on_screen(robot, type_quickly)


def test_keys_typed_at_once_behind_a_line_or_a_dialog_are_for_the_screen() -> None:
    robot = Robot()

    async def type_quickly(app: OperatorScreen, pilot: Pilot[None]) -> None:
        type_at_once(app, *':force /Drive done', 'enter', 'enter')
        type_at_once(app, *':note x', 'enter', '!')
        type_at_once(app, '?', 'escape', '!')
        await pilot.pause()
        kinds = [CommandKind.FORCE, CommandKind.NOTE, CommandKind.STOP, CommandKind.STOP]
        assert robot.link.kinds == kinds
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        parameters = (BehaviorParameter('room', choices=('a', 'b')),)
        robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Errand', parameters=parameters),)))
        type_at_once(app, 's', 'down', 'enter', 'down', 'enter', '!')
        await pilot.pause()
        assert robot.link.kinds == [*kinds, CommandKind.START, CommandKind.STOP]
        assert robot.link.sent[-2].arguments == (('room', 'b'),)

    on_screen(robot, type_quickly)


def test_keys_typed_at_once_behind_the_choice_of_a_robot_are_for_that_robot() -> None:
    robots = FakeRobots(3)

    async def type_quickly(app: OperatorScreen, pilot: Pilot[None]) -> None:
        type_at_once(app, 'o', 'down', 'enter', 'p', 'enter')
        await pilot.pause()
        sent = {name: robot.link.kinds for name, robot in robots.robots.items() if robot.link.sent}
        assert sent == {'/robot01': [CommandKind.PAUSE]}

    on_screen(robots.robots['/robot00'], type_quickly, robots=robots)


def test_a_stop_is_sent_when_its_key_is_read_and_not_when_the_screen_gets_to_it() -> None:
    robots = FakeRobots(2)
    here, there = (robots.robots[name].link for name in ('/robot00', '/robot01'))

    async def busy(app: OperatorScreen, pilot: Pilot[None]) -> None:
        async def handled(*keys: str) -> None:
            for key in keys:
                app.post_message(events.Key(key, '!' if key == 'exclamation_mark' else None))
            await pilot.pause()

        for key in ('f8', 'exclamation_mark'):
            app.key_read(key)  # on the thread of the terminal, while this one does something else
            assert here.kinds == [CommandKind.STOP]
            await handled(key)
            assert here.kinds == [CommandKind.STOP]  # and not once more
            here.sent.clear()
        app.key_read('colon')
        app.key_read('exclamation_mark')  # may be for the line that the key before opens
        assert not here.sent
        await handled('colon', 'exclamation_mark')
        assert not here.sent
        await pilot.press('escape')
        for key in ('o', 'down', 'enter', 'f8'):
            app.key_read(key)
        assert (here.kinds, there.kinds) == ([CommandKind.STOP], [])
        await handled('o', 'down', 'enter', 'f8')
        assert (here.kinds, there.kinds) == ([CommandKind.STOP], [CommandKind.STOP])  # who was gone to is stopped, too

    on_screen(robots.robots['/robot00'], busy, robots=robots)


def test_what_was_typed_before_a_stop_is_not_sent_after_it() -> None:
    robot = Robot()

    async def busy(app: OperatorScreen, pilot: Pilot[None]) -> None:
        typed = [
            *(8 * [('x', 'x')]),
            ('colon', ':'),
            *((sign, sign) for sign in 'pause'),
            ('enter', None),
            ('f8', None),
        ]
        keys = [events.Key(name, sign) for name, sign in typed]
        for key in keys:
            app.key_read(key.key)  # on the thread of the terminal, while this one does something else
        for key in keys[:8]:
            app.post_message(key)
        await pilot.pause()
        app.key_read('x')  # the others wait still
        for key in (*keys[8:], events.Key('x', 'x')):
            app.post_message(key)
        await seen(robot, pilot)
        assert robot.link.kinds == [CommandKind.STOP]
        assert 'a STOP was given while this waited; nothing was sent' in text_of(app)
        robot.show()
        await pilot.press('colon', *'pause', 'enter')
        assert robot.link.kinds == [CommandKind.STOP, CommandKind.PAUSE]

    on_screen(robot, busy)


def test_what_comes_from_the_network_is_escaped() -> None:
    robot = Robot()
    hostile = '\x1b[2Jhidden\r\n[red]loud[/red]\u202e'
    asked = dataclasses.replace(PLAN, path=f'/{hostile}', prompt=hostile, outcome=hostile, outcomes=(hostile,))
    active = (ActiveState(f'/{hostile}', 1.0, (hostile,)),)
    robot.show(asked, behavior=hostile, message=hostile, authority=hostile, active_states=active)
    robot.mirror.receive_places({hostile: FramedPose(1.0, 1.0)})

    async def look(app: OperatorScreen, pilot: Pilot[None]) -> None:
        shown = text_of(app)
        assert not {'\x1b', '\r', '\u202e'} & set(shown)
        assert '[red]loud' in shown  # no markup of the toolkit either
        await pilot.press('f', 'question_mark', 'escape', 's')

    on_screen(robot, look, is_drawn=True)


def test_a_fault_of_the_screen_is_told_and_it_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot()

    def fail(*_: object) -> str:
        raise ConsoleError.__base__('a fault on purpose')  # type: ignore[misc]

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        with monkeypatch.context() as patch:
            patch.setattr('flexbt_console.ui.station.interpret', fail)
            await pilot.press('p')
        await seen(robot, pilot)
        assert 'a fault on purpose' in text_of(app)
        with monkeypatch.context() as patch:
            patch.setattr('flexbt_console.ui.screen.lines.offers', fail)
            await pilot.press('colon', 'c', 'tab', 'escape')
        await seen(robot, pilot)
        await pilot.press('exclamation_mark')
        assert robot.link.kinds == [CommandKind.STOP]

    on_screen(robot, steps)


def test_where_there_is_little_room_what_is_active_is_shown_and_what_waits_above_all() -> None:
    robot = Robot()
    regions = [StateStructure(f'/{name}', StateKind.MACHINE, 'Machine', ('Now', *'abcdefgh')) for name in 'PQR']
    states = [STRUCTURE.states[0]]
    for region in regions:
        states.append(region)
        for name in region.children:
            states.append(
                StateStructure(f'{region.path}/{name}', StateKind.STATE, 'S', (), ('left', 'right'), ('/P/a',))
            )
    robot.mirror.receive_structure(Structure('r1', 'Patrol', tuple(states)))
    active = tuple(ActiveState(f'{region.path}/Now', 1.0) for region in regions)
    robot.show(Decision('d', DecisionKind.CHOICE, '/R/Now', outcomes=('left', 'right')), active_states=active)
    for rows, hidden in ((99, ()), (13, ('  a',)), (9, ('  a', 'below'))):
        lines = machine_lines(robot.mirror.view(), 80, rows, ASCII)
        shown = '\n'.join(lines)
        assert len(lines) <= rows and shown.count('> Now') == 2 and '? Now' in shown and '  > P' in shown, shown
        assert lines[-2:] == ['      left -> a', '      right'] or rows == 99, shown  # of the one that waits
        assert not any(text in shown for text in hidden), shown
    assert any('? Now' in line for line in machine_lines(robot.mirror.view(), 80, 4, ASCII))


def test_where_there_is_room_the_bar_says_how_the_others_that_wait_are_listed() -> None:
    robot = Robot()
    robot.show(PLAN, *(dataclasses.replace(WHERE, id=f'd{number}') for number in range(39)))
    for columns, tail in ((78, '(+39 more: "a" lists them)'), (63, '(+39 more: a)'), (56, '(+39 more)')):
        assert decision_lines(robot.mirror.view(), '', columns, ASCII)[0].endswith(tail)


def test_after_the_screen_signals_do_what_they_did_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def run_async(screen: OperatorScreen) -> None:
        TerminalDriver(screen)

    monkeypatch.setattr(OperatorScreen, 'run_async', run_async)
    monkeypatch.setattr(TerminalWatch, '_watch', lambda watch: None)  # the terminal of the tests
    robot, numbers = Robot(), (signal.SIGTSTP, signal.SIGCONT, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    watch = TerminalWatch(lambda: None)
    run_screen(robot.station(), robot.clock, watch.on_signal)
    after = [signal.signal(number, handler) for number, handler in zip(numbers, before, strict=True)]
    assert after == before


def test_leaves_that_the_bar_has_no_room_for_are_counted() -> None:
    for parents, last in (((0, 1, 1, 1), '  > Node4  0 s  in Node1'), ((0, 1, 1, 1, 1, 1), '  +3 more')):
        robot = Robot()
        robot.run_tree(*parents)
        bar = decision_lines(robot.mirror.view(), '', 80, ASCII)
        assert len(bar) == ROWS and 'Node3' in bar[2] and bar[3] == last


def test_at_every_width_the_bar_has_the_choice_that_is_picked_and_no_row_is_too_long() -> None:
    robot = Robot()
    for count, text in ((3, 'x' * 30), (12, '部屋')):
        choices = tuple(f'{text} {number}' for number in range(1, count + 1))
        robot.show(dataclasses.replace(PLAN, outcome='', outcomes=choices))
        for columns in range(1, 81):
            bar = decision_lines(robot.mirror.view(), choices[-1], columns, ASCII)
            assert len(bar) <= ROWS and all(width(row) <= columns for row in bar), (columns, bar)
            assert columns < 4 or any('[' in row and ']' in row for row in bar), (columns, bar)


def test_long_names_push_nothing_out_that_has_to_be_seen() -> None:
    robot, name = Robot(), '巡回 patrol ' * 20
    path = f'/{name.strip()}'
    state = StateStructure(path, StateKind.STATE, 'Drive', (), ('done', f'failed {name}'), (path, path))
    robot.mirror.receive_structure(Structure('r1', name, (dataclasses.replace(STRUCTURE.states[0]), state)))
    robot.mirror.receive_log(LogLine('e', 1, LogSeverity.WARN, 'a crate is in the way', path, 'r1', 4.0))
    asked = dataclasses.replace(PLAN, path=path, outcomes=state.outcomes, since=1.0)
    missing = tuple(Peer(f'{name}{number}', alive=False) for number in range(5))
    robot.show(
        asked,
        behavior=name,
        active_states=(ActiveState(path, 1.0),),
        peers=missing,
        authority='ann',
        authority_requests=('bob', name),
    )
    view = robot.mirror.view()
    asked_rows = '\n'.join(decision_lines(view, 'done', 80, UNICODE))
    for text in (' wants done ', '4.0 s', 'because WARN: a crate is in the way', '[1 done*', ' 2 failed'):
        assert text in asked_rows, text
    assert any(line.endswith(' patrol  4 s') for line in machine_lines(view, 40, 12, UNICODE))
    first = status_text(view, 80, '', '1 other needs you: o', 'ann').plain
    assert first.rstrip().endswith('  autonomy 1 Low  authority ann  1 other needs you: o'), first
    assert '  authority ann  (requested' in status_text(view, 160, '', '', 'bob').plain
    *wrong, asks = alarm_text(view, 80, 'ann').plain.splitlines()
    assert (len(wrong), asks) == (2, ' bob and 1 more request control: press "c" to answer')
    assert 'authority' not in alarm_text(view, 80, 'bob').plain


def test_parents_in_a_ring_do_not_hang_the_screen() -> None:
    robot = Robot()
    robot.run_tree(2, 1, 1)
    (run,) = robot.mirror.view().running_trees
    assert acting_lines(run) == ['Node3  0 s  in Node1']


class FakeRobots(FleetLink):
    """Robots that are only mirrors."""

    def __init__(self, count: int) -> None:
        self.robots = {f'/robot{number:02}': Robot() for number in range(count)}
        self.fleet = Fleet()
        self.own = '/robot00'
        for name, robot in self.robots.items():
            self.fleet.add(name, robot.mirror)

    def robot(self, name: str) -> tuple[Mirror, Any]:
        return self.robots[name].mirror, self.robots[name].link

    select = robot


def test_of_several_robots_the_one_that_waits_is_found_gone_to_and_answered_alone() -> None:
    robots = FakeRobots(50)
    asks, own = robots.robots['/robot37'], robots.robots['/robot00']
    asks.show(dataclasses.replace(PLAN, since=1.0))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert '1 other needs you: o' in text_of(app)
        app.action_press('robots')
        app.draw()  # something comes while the list opens
        await seen(own, pilot)
        first = text_of(app).splitlines()[1]
        assert '/robot37' in first and 'waits' in first and '4.0 s' in first and '/Drive wants done' in first
        assert not [line for line in app._panes.log.told if 'fault' in line]
        await pilot.press('enter', 'enter')  # the cursor is at our own robot
        assert own.link.sent == [] and asks.link.sent == []
        await pilot.press('o', *['up'] * 50, 'enter')
        await pilot.press('enter')  # sooner than anybody can have read what waits there
        assert asks.link.sent == []
        asks.clock.advance(1.0)
        own.clock.advance(1.0)
        await seen(own, pilot)
        assert '/robot37' in text_of(app).splitlines()[0]
        await pilot.press('enter')
        assert [(one.kind, one.decision_id) for one in asks.link.sent] == [(CommandKind.CONFIRM, 'd1')]
        await pilot.press('o', 'down', 'f8')  # the robot under the cursor is stopped, and shown
        await seen(own, pilot)
        assert asks.link.kinds == [CommandKind.CONFIRM] and own.link.kinds == [CommandKind.STOP]
        assert '/robot00' in text_of(app).splitlines()[0]

    on_screen(own, steps, robots=robots)


def test_a_robot_of_the_list_is_stopped_though_the_node_is_too_busy_to_go_to_it() -> None:
    robots = FakeRobots(2)
    own, other = robots.robots.values()

    def select(name: str) -> Any:
        raise TimeoutError('the executor of node console did not get to it')

    robots.select = select  # type: ignore[method-assign]

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('o', 'down', 'f8')
        await seen(own, pilot)
        assert (own.link.kinds, other.link.kinds) == ([], [CommandKind.STOP])
        assert 'did not get to it' in text_of(app)

    on_screen(own, steps, robots=robots)
    other.show()  # nobody listens any more, and nothing is wrong with that


def test_a_command_without_an_answer_is_seen_and_so_is_an_answer_that_is_late() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('p', 'enter', 'l', 'enter')
        pause, lock = robot.link.sent
        robot.show(results=(CommandResult(lock.id, ResultCode.APPLIED),))
        await seen(robot, pilot)
        assert 'lock /Drive: applied' in text_of(app) and 'pause: ' not in text_of(app)
        for _ in range(3):
            await seen(robot, pilot)
        assert text_of(app).count('pause: sent, no answer yet') == 1
        robot.clock.advance(5.0)
        robot.mirror.due_commands(reachable=True)
        robot.show()
        await seen(robot, pilot)
        assert 'pause: NO ANSWER' in text_of(app)
        robot.show(results=(CommandResult(pause.id, ResultCode.APPLIED),))
        await seen(robot, pilot)
        assert 'pause: applied (' in text_of(app)

    on_screen(robot, steps)


def test_a_pose_that_is_typed_while_one_is_pointed_at_is_the_answer() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('g', 'right', ':', *'kitchen', 'enter')
        assert robot.link.kinds == [CommandKind.ANSWER]
        robot.show(results=(CommandResult(robot.link.sent[0].id, ResultCode.APPLIED),))
        await seen(robot, pilot)
        assert 'input kitchen: applied' in text_of(app) and 'nothing was sent' not in text_of(app)

    on_screen(robot, steps)


def test_what_a_state_does_is_beside_it_but_not_the_nodes_of_the_tree_that_is_drawn() -> None:
    robot = Robot()
    nodes = [MirroredNode(1, 0, 'Main', 'Sequence', '/Main'), MirroredNode(2, 1, 'Wait', 'Wait', '/Main/Wait')]
    held = "'done' waits for the unlock of /Drive"
    drive = ActiveState('/Drive', 1.0, (held, '/Main', '/Main/Wait'), tree_run_id='t')
    robot.show(active_states=(drive, ActiveState('/Ask', 1.0, ('waits for /arm',))))
    assert '/Main/Wait' in '\n'.join(machine_lines(robot.mirror.view(), 60, 20, ASCII))  # nothing else tells it
    robot.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 5.0, 2))
    robot.mirror.receive_tree_status(TreeReport('t', 2, RUNNING, [], 5.0, finished=False, paused=False, structure=2))
    for rows in (20, 7):
        shown = '\n'.join(machine_lines(robot.mirror.view(), 60, rows, ASCII))
        assert held in shown and 'waits for /arm' in shown and '/Main' not in shown, shown


def test_what_is_wrong_is_told_to_its_end_where_there_is_room() -> None:
    problem = 'its process ended, or is out of reach, since 1 s; restart it, or look at its computer'
    view = Robot().mirror.view()
    assert view.snapshot is not None
    for count, rows in ((1, 2), (2, 2), (5, 3)):
        peers = tuple(Peer(f'node{number}', alive=False, problem=problem) for number in range(count))
        snapshot = dataclasses.replace(view.snapshot, peers=peers)
        shown = alarm_text(dataclasses.replace(view, snapshot=snapshot), 80, 'ann').plain.splitlines()
        assert len(shown) == rows and all(width(row) <= 80 for row in shown)
        assert ''.join(shown).endswith('computer') == (count == 1)


def test_a_robot_that_moves_though_it_should_stand_is_an_alarm() -> None:
    robot = Robot()
    for second in range(8):
        robot.show(
            state=ExecutiveState.IDLE, outcome='preempted', robot_pose=FramedPose(0.1 * second, 0.0), stamp=9.0 + second
        )

    async def look(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'ALARM: THE ROBOT MOVES, 0.50 m so far, though the run was stopped' in text_of(app)

    on_screen(robot, look)
    lost = dataclasses.replace(robot.mirror.view(), link=LinkState.LOST)
    assert alarm_line(lost).startswith('ALARM: THE ROBOT MOVED, 0.50 m when it was last heard of')
    held = dataclasses.replace(lost, guard=StopGuard(holding=True, operator='ann'))
    assert alarm_line(held).startswith('HELD BY THE STOP GUARD')  # which is newer


def test_what_has_another_size_is_drawn_for_it_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_console.ui.screen.app.AGE_SECONDS', 1e6)
    robot = Robot()
    robot.show(PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        def misfits() -> list[str | None]:
            return [
                pane.id
                for pane in app.screen.query(Pane)
                if pane.size.width * pane.size.height > 0
                if any(width(row) > pane.content_size.width for row in pane._text.plain.split('\n'))
                or len(pane._text.plain.split('\n')) > max(1, pane.content_size.height)
            ]

        async with asyncio.timeout(30.0):
            for columns, rows in ((80, 24), (30, 8), (120, 12), (40, 11), (100, 30)):
                await pilot.resize_terminal(columns, rows)
                while misfits():
                    await pilot.pause(0.01)
            robot.show(PLAN, peers=tuple(Peer(f'node {number}', alive=False) for number in range(3)))  # takes 3 rows
            while misfits() or 'node 2' not in text_of(app):
                await pilot.pause(0.01)

    on_screen(robot, steps, (160, 30))


def test_an_idle_screen_draws_nothing() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        updates: list[object] = []
        for pane in app.query(Pane):
            pane.refresh = lambda *regions, **how: updates.append(regions)  # type: ignore[method-assign, assignment]
        for _ in range(20):
            robot.show()  # heartbeats
            await seen(robot, pilot)
            assert not app._is_planned  # a drawing has no other one follow it
        assert updates == []

    on_screen(robot, steps, is_drawn=True)


def test_a_heartbeat_that_tells_nothing_new_wakes_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot()
    robot.show(state=ExecutiveState.IDLE, active_states=())

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        woken: list[None] = []
        monkeypatch.setattr(app, '_wake', lambda: woken.append(None))
        for second in range(20):
            robot.show(stamp=10.0 + second)
            robot.mirror.receive_plan(((2.0, 2.0), (3.0, 1.0)))
            robot.clock.advance(0.5)
            app._age()
        assert woken == []
        robot.show(message='something else')
        robot.show(state=ExecutiveState.RUNNING)
        robot.show(stamp=40.0)  # time goes on in its states
        assert len(woken) == 3
        robot.show(state=ExecutiveState.IDLE)
        await seen(robot, pilot)
        woken.clear()
        robot.mirror.receive_log(LogLine('e', 1, LogSeverity.INFO, 'a line', '', '', 41.0))
        assert len(woken) == 1
        robot.clock.advance(2.0)  # by time alone, the link is late
        app._age()
        assert len(woken) == 2

    on_screen(robot, steps)


def test_without_colours_what_is_wrong_is_as_bright_as_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('NO_COLOR', '1')
    robot = Robot()
    robot.show(peers=(Peer('navigation', alive=False),))

    async def look(app: OperatorScreen, pilot: Pilot[None]) -> None:
        strips = app.screen._compositor.render_strips()
        styles = [one.style for strip in strips for one in strip if 'not found' in one.text]
        colours = [style.color.get_truecolor() for style in styles if style and style.color]
        assert colours and all(min(colour) > 200 for colour in colours)

    on_screen(robot, look)


def test_an_ascii_screen_has_ascii_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('FLEXBT_ASCII', '1')

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert '>' in text_of(app) and text_of(app).isascii()
        for keys in ('f', 'n', '?', 's', ['s', 'down', 'enter', 'tab', 'tab'], ['s', 'down', 'enter', 'x', 'enter']):
            await pilot.press(*keys)
            await seen(robot, pilot)
            shown = text_of(app)
            assert shown.isascii(), (keys, [sign for sign in shown if not sign.isascii()])
            await pilot.press('escape', 'escape', 'escape')
            robot.show(state=ExecutiveState.IDLE if keys == '?' else robot.snapshot.state)  # then one can be started

    robot = Robot()
    on_screen(robot, steps, (100, 24))


class Terminal:
    """What a terminal shows of what is written to it: moves, newlines, and characters of one or two cells."""

    def __init__(self, text: str) -> None:
        self.rows: dict[int, dict[int, str]] = {}
        self.written = 0
        self.write(f'\x1b[1;1H{text}')

    def write(self, text: str) -> None:
        self.written += len(text.encode())
        row = column = 0
        for move, newline, signs in re.findall(r'\x1b\[(\d+;\d+)H|\x1b\[[\d;]*m|(\n)|([^\x1b\n\r]+)', text):
            if move:
                row, column = map(int, move.split(';'))
            elif newline:
                row, column = row + 1, 1
            for begin, end, taken in split_graphemes(signs)[0]:
                for place, part in enumerate((signs[begin:end], '')[:taken]):
                    self.rows.setdefault(row, {})[column + place] = part
                column += taken

    @property
    def text(self) -> str:
        return '\n'.join(''.join(self.rows[row][column] for column in sorted(self.rows[row])) for row in self.rows)

    def shows(self, pane: Pane) -> bool:
        """Return whether it has the text that was given to a pane, at its place."""
        left, top, width, height = pane.content_region
        given = [*pane._text.plain.split('\n'), *[''] * height][:height]
        columns = range(left + 1, left + 1 + width)
        rows = [''.join(self.rows[row][column] for column in columns) for row in range(top + 1, top + 1 + height)]
        return rows == [set_cell_size(line, width) for line in given]


@pytest.mark.parametrize('size', [(80, 24), (200, 60)])
def test_only_what_has_changed_goes_to_the_terminal(size: tuple[int, int]) -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        terminal = Terminal(text_of(app))
        app._display = lambda screen, update: terminal.write(update.render_segments(app.console))  # type: ignore
        terminal.written = 0
        for number in range(10):  # it drives
            stamp = 6.0 + number
            robot.show(robot_pose=FramedPose(2.0 + 0.1 * number, 2.0), stamp=stamp)
            report = TreeReport('t', 2 + number, RUNNING, [], stamp, finished=False, paused=False)
            robot.mirror.receive_tree_status(report)
            await seen(robot, pilot)
            assert terminal.text == text_of(app)
        assert 'x 2.90' in terminal.text and 100 < terminal.written / 10 < 1000
        # And now characters of two cells, also some that only a variation selector makes so.
        names = ['厨房', '房厨', 'a厨', 'ab房b', '', '厨房房房', ' 7厨房', ' 8厨房']
        for name in (*names, '7❤\ufe0f厨', '8❤\ufe0f厨', '8❤\ufe0f房'):
            robot.show(behavior=name, active_states=(ActiveState(f'/{name}', 1.0),))
            await seen(robot, pilot)
            assert terminal.text == text_of(app)
            assert all(terminal.shows(pane) for pane in app.query(Pane) if pane.display), name
        kept = {pane.id: len(pane._dirty_regions) for pane in app.query(Pane)}
        assert set(kept.values()) <= {0, 1}, kept  # the memory of a screen stays as it is

    on_screen(robot, steps, size, is_drawn=True)


def test_a_key_of_the_page_in_the_browser_means_the_same_on_the_screen() -> None:
    page = (files('flexbt_console') / 'ui' / 'web' / 'page' / 'commands.js').read_text(encoding='utf-8')
    body = page.partition('const actions = {')[2].partition('\n    };')[0]
    found = re.findall(r"(?:'(\S)'|(\w+)): (?:\w+ \? null : )?\(\) => (.+?\)),", body)
    actions = {sign or name: re.findall(r'\w+', call)[-1] for sign, name, call in found}
    named = {'type': 'command_line', 'focus': 'point', 'choose': 'waiting'}
    of_screen = {shown: key.action for key in KEYS for shown in key.shown.split()} | {'/': 'command_line'}
    assert len(actions) >= 13
    assert actions['j'] == 'timeline' and 'j' not in of_screen, 'the screen has one of recordings only'
    for key, action in actions.items():
        assert action == 'timeline' or named.get(action, action) == of_screen[key], key
    told = re.sub(r"' \+\s+'", '', page).partition("'Keys: ! or F8 stop, ")[2].partition(' this help.')[0]
    assert {text.split()[0] for text in told.split(', ')} == actions.keys() - {'!', '/'} | {'1-9'}


def test_lock_and_start_have_refusals_of_their_own() -> None:
    robot = Robot()
    lock, start = (next(key for key in KEYS if key.action == action) for action in ('lock', 'start'))
    robot.show(active_states=(ActiveState('/'),))
    assert lock.blocked(robot.mirror.view()) == 'no active state can be locked'
    robot.mirror.receive_snapshot(ExecutiveSnapshot('new', 1))
    assert start.blocked(robot.mirror.view()) == 'the robot has not sent its list of behaviors'
    robot.mirror.receive_behaviors(BehaviorList('new'))
    assert start.blocked(robot.mirror.view()) == 'no behaviors are installed on the robot'


def test_of_many_that_wait_any_can_be_answered_and_then_the_oldest_is_in_the_bar_again() -> None:
    robot = Robot()
    waiting = [dataclasses.replace(PLAN, id=f'w{number}', prompt=f'number {number}', since=1.0) for number in range(40)]
    robot.show(*waiting)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert '(+39 more: a)' in text_of(app) and 'a all' in text_of(app).splitlines()[-1]
        await pilot.press('a', 'end')
        await pilot.pause()
        assert re.search(r'> .*\n.*39 ', text_of(app))  # the last line has room, too
        await pilot.press('enter', '2', 'enter')  # at once: it is known from the list
        assert [(one.decision_id, one.outcome) for one in robot.link.sent] == [('w39', 'failed')]
        robot.show(*waiting[:-1])
        await seen(robot, pilot)
        assert 'number 0' in text_of(app)
        await pilot.press('a', 'down', 'down')
        robot.show(*waiting[2:-1])  # the one that is marked is gone meanwhile
        await pilot.press('enter', 'enter')
        assert len(robot.link.sent) == 1

    on_screen(robot, steps, (66, 24))


def test_a_key_that_is_held_down_answers_once() -> None:
    """The repetitions of a key come after 0.25 to 0.66 s, and then each 33 ms."""
    robot = Robot()
    waiting = [dataclasses.replace(PLAN, id=f'w{number}') for number in range(9)]
    robot.show(*waiting)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('enter')
        for number in range(90):
            answered = {one.decision_id for one in robot.link.sent}
            robot.show(*(one for one in waiting if one.id not in answered))
            app.draw()
            robot.clock.advance(0.6 if number == 0 else 0.033)
            await pilot.press('enter')
        assert [one.decision_id for one in robot.link.sent] == ['w0']
        robot.clock.advance(1.0)
        await pilot.press('enter')
        assert [one.decision_id for one in robot.link.sent] == ['w0', 'w1']
        robot.show()
        await seen(robot, pilot)
        await pilot.press('enter')  # and while it is held, something comes up
        robot.clock.advance(0.6)
        robot.show(OTHER)
        app.draw()
        await pilot.press('enter')
        assert len(robot.link.sent) == 2

    on_screen(robot, steps)


def test_enter_alone_answers_no_question_for_a_pose() -> None:
    robot = Robot()
    robot.show(WHERE)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('enter')
        robot.clock.advance(1.0)
        await pilot.press('enter')
        await seen(robot, pilot)
        assert robot.link.sent == [] and '"g" points at it on the map' in text_of(app)

    on_screen(robot, steps)


def test_panes_are_enlarged_and_hidden_and_so_they_are_the_next_time(tmp_path: Path) -> None:
    robot, file = Robot(), tmp_path / 'flexbt' / 'layout'

    async def lay_out(app: OperatorScreen, pilot: Pilot[None]) -> None:
        async def shown(*keys: str) -> str:
            await pilot.press(*keys)
            await seen(robot, pilot)
            assert not [line for line in app._panes.log.told if 'fault' in line]
            return text_of(app)

        assert 'x 2.00' in await shown()
        assert 'map: z h' in await shown('tab', 'tab')
        assert 'x 2.00' not in (hidden := await shown('h')) and 'FollowPath' in hidden and 'map:' not in hidden
        assert 'log: PgUp PgDn z h' in await shown('tab', 'tab')
        assert 'FollowPath  4 s' not in (alone := await shown('z')).partition('no pending decision')[0], alone
        robot.show(WHERE)
        assert 'cursor x 2.00' in await shown('g') and 'FollowPath' in await shown('escape', 'z')
        assert 'x 2.00' not in await shown() and 'claim' in await shown(
            'tab', 'tab', 'h', *':cla'
        )  # which needs the log

    async def find_it(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'x 2.00' not in text_of(app) and 'Press ? for the keys' not in text_of(app)
        await pilot.press('h')
        await seen(robot, pilot)
        assert 'x 2.00' in text_of(app) and 'Press ? for the keys' in text_of(app)

    async def hides_nothing(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'x 2.00' in text_of(app) and 'Press ? for the keys' in text_of(app)

    async def is_told(app: OperatorScreen, pilot: Pilot[None]) -> None:
        await pilot.press('tab')
        await seen(robot, pilot)
        assert 'this layout is not there the next time' in text_of(app) and 'machine: PgUp' in text_of(app)

    on_screen(robot, lay_out, layout=Layout(file))
    assert file.read_text() == 'hidden=log hidden=map\n'
    on_screen(robot, find_it, layout=Layout(file))
    for text in (b'', b'\xff\x00', b'focused=door enlarged hidden=window', b'enlarged'):
        file.write_bytes(text)
        on_screen(robot, hides_nothing, layout=Layout(file))
    on_screen(robot, is_told, layout=Layout(Path('/dev/null/layout')))


def test_log_and_machine_are_scrolled_and_stand_still_then() -> None:
    robot = Robot()
    for number in range(1, 60):
        robot.mirror.receive_log(LogLine('e', number, LogSeverity.INFO, f'said {number:02}', '/Drive', 'r1', 4.0))
    robot.run_tree(0, *[1] * 40)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        async def shown(*keys: str) -> str:
            await pilot.press(*keys)
            robot.show()
            await seen(robot, pilot)
            return text_of(app)

        assert 'said 59' in await shown()
        back = await shown('pageup', 'pageup')
        assert 'said 59' not in back and 'below; Esc: the latest)' in back
        robot.mirror.receive_log(LogLine('e', 60, LogSeverity.INFO, 'said 60', '/Drive', 'r1', 9.0))
        again = await shown()
        assert 'there is something new' in again and re.findall('said ..', again) == re.findall('said ..', back)
        assert 'said 60' in await shown(*['pagedown'] * 5) and 'said 01' in await shown(*['pageup'] * 40)
        assert 'said 60' in await shown('escape')
        assert 'Node20' not in await shown('tab')
        pages = [await shown('pagedown') for _ in range(9)]
        assert all(f'Node{number} ' in ''.join(pages) for number in range(12, 42))
        assert 'Patrol' in (await shown(*['pageup'] * 9)).splitlines()[1]

    on_screen(robot, steps, (80, 24))


@pytest.mark.parametrize('executive', ['e', 'f'])
def test_what_is_told_after_the_clock_was_set_back_is_the_latest(executive: str) -> None:
    mirror, pane = Mirror(ManualClock()), LogPane('ann')

    def say(executive: str, number: int, stamp: float) -> None:
        mirror.receive_snapshot(ExecutiveSnapshot(executive, number, stamp=stamp))
        mirror.receive_log(LogLine(executive, number, text=f'said {number}', stamp=stamp))
        pane.tell(stamp, [f'told {number}'])

    for number in range(1, 20):
        say('e', number, 1000.0 + number)
    mirror.receive_snapshot(ExecutiveSnapshot(executive, 20, stamp=3.0))
    assert re.findall('told ..', pane.draw(mirror, 80, 4).plain) == ['told 18', 'told 19']
    mirror.receive_log(LogLine(executive, 20, text='said 20', stamp=3.0))  # by a simulation that began anew
    assert re.findall('[st][ao].. ..', pane.draw(mirror, 80, 3).plain) == ['said 19', 'told 19', 'said 20']
    say(executive, 21, 4.0)
    assert re.findall('[st][ao].. ..', pane.draw(mirror, 80, 4).plain) == ['told 19', 'said 20', 'said 21', 'told 21']


def test_a_line_may_become_any_command_by_its_name_or_by_what_it_does() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        line = app.query_one('#line', Input)
        for spec in (spec for spec in COMMANDS if spec.in_prompt):
            for typed in (spec.name[:3], spec.name, spec.summary.split()[-1]):
                assert spec.name in [offer.line for offer in offers(typed, robot.mirror.view())], (typed, spec.name)
        await pilot.press(*':remark')
        await seen(robot, pilot)
        assert '> note' in text_of(app) and 'Tab completes' in text_of(app).splitlines()[-1]
        await pilot.press('tab')
        assert line.value == 'note'
        robot.show()
        await pilot.press('escape', *':autho', 'down', 'up', 'up', 'down', 'tab', 'enter')
        assert robot.link.kinds == [CommandKind.RELEASE_AUTHORITY]
        await pilot.press(*':lock ', 'down', 'tab')
        await seen(robot, pilot)
        assert line.value == 'lock /Drive' and 'lock PATH' in text_of(app)

    on_screen(robot, steps)


def test_where_nothing_is_known_of_a_map_the_machine_has_its_room() -> None:
    robot = Robot()
    robot.mirror = Mirror(robot.clock)
    robot.show(robot_pose=None)

    async def look(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'pose unknown' not in text_of(app) and app.query_one('#machine').size.width == 80
        robot.show(robot_pose=FramedPose(1.0, 2.0))
        await seen(robot, pilot)
        assert 'x 1.00 y 2.00' in text_of(app)

    on_screen(robot, look, (80, 24))


def test_a_robot_is_found_by_its_name_and_the_most_urgent_by_one_key() -> None:
    robots = FakeRobots(50)
    robots.robots['/robot37'].show(dataclasses.replace(PLAN, since=1.0))

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for keys, found in (
            (('o', '/', *'T4o', 'backspace', '2', 'enter'), '/robot42'),
            (('o', 'tab'), '/robot37'),
            (('o', 'tab'), '/robot37'),  # nobody else needs anything
            (('o', 'end', 'pageup', 'enter'), '/robot39'),
            (('o', *'robot', 'enter', 'escape', 'escape'), '/robot39'),  # many have such a name
            (('o', *'robot1', 'enter', 'backspace', *'77', 'enter', 'escape', 'escape'), '/robot39'),  # none has it
            (('o', *'robot4', 'down', 'down', 'enter'), '/robot41'),
        ):
            await pilot.press(*keys)
            await seen(robots.robots['/robot00'], pilot)
            assert found in text_of(app).splitlines()[0] and len(app.screen_stack) == 1
        assert not any(robot.link.sent for robot in robots.robots.values())

    on_screen(robots.robots['/robot00'], steps, robots=robots)


def test_that_the_executive_was_restarted_is_told_once_and_of_the_robot_that_is_shown() -> None:
    robots = FakeRobots(2)
    own = robots.robots['/robot00']

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        def told() -> int:
            return sum('the executive was restarted' in line for line in app._panes.log.told)

        await seen(own, pilot)
        assert told() == 0
        own.show(executive_id='another', state=ExecutiveState.IDLE, active_states=(), run_id='')
        for _ in range(3):
            own.show()
            await seen(own, pilot)
            assert told() == 1 and 'the executive was restarted' in text_of(app)
        app.switch('/robot01')  # whose executive has another identifier
        await seen(own, pilot)
        assert told() == 0

    on_screen(own, steps, robots=robots)


def test_the_footer_has_in_bold_what_can_be_done_now() -> None:
    robot = Robot()
    mirror = robot.mirror

    def bold(operator: str) -> set[str]:
        text = keys_text(mirror.view(), 300, operator)
        return {text.plain[span.start : span.end].strip() for span in text.spans if span.style == 'bold'}

    assert {'p', 'f', '! F8', ':'} <= bold('ann')
    robot.show(authority='bob')
    assert {'p', 'f', '! F8', ':'} <= bold('bob') and not {'p', 'f', '+ -'} & bold('ann')
    assert {'! F8', 'c', ':'} <= bold('ann')
    robot.clock.advance(60.0)
    assert not {'p', 'f', '+ -'} & bold('bob') and '! F8' in bold('bob')


FOOTERS: list[tuple[tuple[Decision, ...], dict[str, Any], tuple[str, ...], str | None]] = [
    ((), {}, (), 'ann'),
    ((PLAN,), {}, (), 'ann'),
    ((CHOICE,), {}, (), 'ann'),
    ((CHOICE,), {}, ('2',), 'ann'),
    ((WHERE,), {}, (), 'ann'),
    ((WHERE,), {}, ('g',), 'ann'),
    ((dataclasses.replace(WHERE, input_type='string'),), {}, (), 'ann'),
    ((PLAN,), {}, (), None),
    ((), {'state': ExecutiveState.IDLE, 'active_states': (), 'run_id': ''}, (), 'ann'),
]


@pytest.mark.parametrize(('decisions', 'parts', 'before', 'operator'), FOOTERS)
def test_each_key_of_the_footer_does_something_when_it_is_bold_and_says_why_not_otherwise(
    decisions: tuple[Decision, ...], parts: dict[str, Any], before: tuple[str, ...], operator: str | None
) -> None:
    robots, layout = FakeRobots(len(KEYS) + 1), Layout()
    own, *others = robots.robots
    robots.robots[own].operator = operator
    for robot in robots.robots.values():
        robot.show(*decisions, **parts)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        async def begin() -> dict[str, bool]:
            """Return what is bold in the footer, and what is not."""
            await pilot.press(*before)
            await seen(robots.robots[own], pilot)
            text = app.query_one('#keys', Pane)._text
            spans = {text.plain[span.start : span.end].strip(): span.style == 'bold' for span in text.spans}
            return {key.shown: spans[key.shown] for key in KEYS if key.shown in spans}

        footer = await begin()
        bar = app.query_one('#decision', Pane)._text.plain
        assert not footer.get('Enter') or 'Enter' in bar or '":" types' in bar  # the bar says what Enter does
        assert {'! F8', ':', '?', 'q'} <= footer.keys()
        refused: dict[str, bool] = {}
        pressed = sorted((key for key in KEYS if key.shown in footer), key=lambda key: key.action == 'leave')
        for key, other in zip(pressed, others, strict=False):
            app.switch(other)  # at which nothing was done yet
            layout.focused, layout.is_enlarged, layout.hidden = '', False, set()
            await seen(robots.robots[own], pilot)
            assert await begin() == footer
            app.draw()  # what is to be told of the robot before
            told = len(app._panes.log.told)
            await pilot.press('1' if key.action == 'pick' else key.keys[0])
            await pilot.pause()
            warned = [line for line in app._panes.log.told[told:] if tone_of(line) is Tone.WARNING]
            refused[key.shown] = bool(warned) and 'q again' not in warned[0]
            if app.is_running:
                await pilot.press('escape')
                assert len(app.screen_stack) == 1
        assert footer == {shown: not is_refused for shown, is_refused in refused.items()}

    on_screen(robots.robots[own], steps, (200, 30), robots, layout)


@pytest.mark.parametrize('size', [(80, 24), (120, 36)])
def test_the_address_of_the_page_stays_on_the_screen(size: tuple[int, int]) -> None:
    robot = Robot()
    robot.page = 'http://127.0.0.1:8465/'

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for _ in range(40):
            app.tell(['something happens'])
        await seen(robot, pilot)
        assert text_of(app).splitlines()[0].rstrip().endswith(robot.page)
        await pilot.press('?')
        await pilot.pause()
        assert f'In a browser: {robot.page}' in text_of(app)

    on_screen(robot, steps, size)


def test_the_help_of_the_keys_tells_the_signs_of_the_decision() -> None:
    robot = Robot()
    robot.show(PLAN)

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        assert 'Enter sends what is in brackets; a number picks another answer; * is what the state wants' in text_of(
            app
        )
        await pilot.press('?')
        await pilot.pause()
        assert '*                 the outcome that the state wants' in text_of(app)

    on_screen(robot, steps, (100, 60))


HOSTILE = (
    *('\x1b[2Jx', '\x9b31m', 'a\r\nb', '[red]loud[/red]', '[/]', '[@click=app.quit]x[/]', '\u202eabc', '\u200b'),
    *('\u0300' * 9, '厨房', '👩\u200d👩\u200d👧', '❤\ufe0f', 'שלום', 'ﷺ', 'x' * 10_000, '厨' * 500, '', ' ', '/', '//'),
    *("it's", '"', '-x', '\\', '\x00', '\ud800', '\t', '\u2028', '{0}', '1', 'stop', 'quit', '=finished'),
    *('\x1b]52;c;AAAA\x07', 'ann', 'done'),
)
NUMBERS = (0, 1, 2, 3, -1, 255, 2**31 - 1)


def wild(chance: random.Random, kind: Any) -> Any:
    """Any value of a type that a record of the mirror may have."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is tuple and inner[-1] is Ellipsis:
        return tuple(wild(chance, inner[0]) for _ in range(chance.choice((0, 1, 1, 2, 40))))
    if origin is tuple:
        return tuple(wild(chance, one) for one in inner)
    if inner:  # or None
        return wild(chance, chance.choice(inner))
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return kind(**{name: wild(chance, one) for name, one in get_type_hints(kind).items()})
    if issubclass(kind, IntEnum):
        return chance.choice(list(kind))
    values = {str: HOSTILE, int: NUMBERS, float: (0.5, 1.7e9, *NUMBERS), bool: (False, True), NoneType: (None,)}
    return chance.choice(values[kind])


def say_anything(chance: random.Random, robot: Robot, number: int) -> None:
    """Return the next message of a robot of which one can rely on nothing."""
    mirror = robot.mirror
    said = chance.randrange(8)
    if said == 0:
        mirror.receive_structure(dataclasses.replace(wild(chance, Structure), run_id='r1'))
    elif said == 1:
        mirror.receive_behaviors(dataclasses.replace(wild(chance, BehaviorList), executive_id='e'))
    elif said == 2:
        mirror.receive_log(dataclasses.replace(wild(chance, LogLine), sequence=number))
    elif said == 3:
        mirror.receive_events([dataclasses.replace(wild(chance, ExecutiveEvent), sequence=number)])
    elif said == 4:
        robot.run_tree(*(chance.randrange(uid) for uid in range(1, chance.choice((2, 40)))))
    elif said == 5:
        mirror.receive_places(dict(wild(chance, tuple[tuple[str, FramedPose], ...])))
        mirror.receive_plan(wild(chance, tuple[tuple[float, float], ...]))
    elif said == 6:
        mirror.set_problem(wild(chance, str))
    parts = {
        one.name: getattr(wild(chance, ExecutiveSnapshot), one.name) for one in dataclasses.fields(ExecutiveSnapshot)
    }
    kept = ('executive_id', 'sequence', 'results', 'decisions')
    decisions = [dataclasses.replace(one, id=f'{one.id}{number}') for one in parts['decisions']]
    robot.show(*decisions, **{name: value for name, value in parts.items() if name not in kept})


def test_random_keys_send_nothing_whatever_a_robot_says_and_however_large_the_terminal_is() -> None:
    """Without Enter, and without the keys that send at once, nothing is sent; and nothing makes it end."""
    chance = random.Random(KEY_SEED)
    at_once = {
        'stop',
        'pause',
        'lock',
        'breakpoint',
        'repeat',
        'authority',
        'decline',
        'more_autonomy',
        'less_autonomy',
    }
    keys = [name for key in KEYS if key.action not in at_once | {'confirm', 'leave'} for name in key.keys]
    keys += ['tab', 'shift+tab', 'left', 'right', 'up', 'down', 'escape', 'less_than_sign', 'x', 'k', 'backspace', 'f2']
    keys += ['pageup', 'pagedown', 'home', 'end', 'ctrl+c', 'ctrl+p', 'ctrl+z', 'delete', '厨']
    robots = FakeRobots(3)
    own = robots.robots['/robot00']

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for number in range(KEY_COUNT):
            if number % 5 == 0:
                say_anything(chance, chance.choice(list(robots.robots.values())), number + 10)
                own.clock.advance(chance.choice((0.1, 1.0, 9.0)))
            if number % 20 == 0:
                await pilot.resize_terminal(chance.choice((20, 40, 80, 300)), chance.choice((5, 8, 24, 100)))
            is_listed = isinstance(app.screen, Overview)
            await pilot.press('enter' if is_listed and chance.random() < 0.3 else chance.choice(keys))
            assert app.is_running
            assert not [line for line in app._panes.log.told if 'fault' in line], app._panes.log.told
            assert not [one for one in text_of(app) if unicodedata.category(one) in ('Cc', 'Cs', 'Zl') and one != '\n']
        assert all(robot.link.sent == [] for robot in robots.robots.values())
        await pilot.press('f8')
        assert [robot.link.kinds for robot in robots.robots.values() if robot.link.sent] == [[CommandKind.STOP]]

    on_screen(own, steps, (80, 24), robots, is_drawn=True)


def test_in_a_terminal_that_has_no_room_for_it_a_dialog_is_cut() -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        for size in ((4, 10), (9, 9), (20, 4)):
            await pilot.resize_terminal(*size)
            robot.show(state=ExecutiveState.RUNNING)
            await pilot.press('f', 'pagedown', 'pageup', 'escape', '?', 'escape')
            robot.show(state=ExecutiveState.IDLE)
            await pilot.press('s', 'pagedown', *'patrol', 'enter', 'tab', 'escape')
        assert app.is_running and not [line for line in app._panes.log.told if 'fault' in line]

    on_screen(robot, steps, is_drawn=True)


def test_a_fault_in_a_dialog_is_told_and_it_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot()

    async def steps(app: OperatorScreen, pilot: Pilot[None]) -> None:
        with monkeypatch.context() as patch:
            patch.setattr('flexbt_console.ui.screen.dialogs.ChoiceList.action_move', lambda _list, _move: 1 / 0)
            await pilot.press('f', 'down')
        await pilot.press('escape', 'z', 'z', 'z', 'f8')
        await seen(robot, pilot)
        assert 'ZeroDivisionError' in text_of(app) and robot.link.kinds == [CommandKind.STOP]

    on_screen(robot, steps)
