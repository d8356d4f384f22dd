# SPDX-License-Identifier: BSD-3-Clause
"""Pause, resume, step: any commands in any order, from any thread, against a model of what they mean."""

from __future__ import annotations

import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tick_control import MOST_WAITING, TickCommand, TickControl
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock, SteadyClock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_testing.waiting import DEADLINE

PAUSE, RESUME, STEP = TickCommand.PAUSE, TickCommand.RESUME, TickCommand.STEP


class Runs(StatefulAction):
    """Counts its ticks in ``services``, and ends when they say so."""

    def on_start(self) -> NodeStatus:
        return self.on_running()

    def on_running(self) -> NodeStatus:
        self.services['ticks'] += 1
        return self.services.get('gives', NodeStatus.RUNNING)

    def on_halted(self) -> None:
        pass


class Raises(SyncAction):
    def tick(self) -> NodeStatus:
        raise RuntimeError('scripted fault')


def tree(body: str, **options: Any) -> Tree:
    registry = builtin_registry()
    registry.register('Runs', Runs)
    registry.register('Raises', Raises)
    registry.register('Motor', Motor)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    return Tree(TreeLibrary([load_xml(text, 't.xml', registry)]), 'T', **options)


@given(st.lists(st.sampled_from([*TickCommand, 'tick']), max_size=30), st.booleans())
def test_every_command_has_its_effect_once_and_in_order(deeds: list[Any], close: bool) -> None:
    services = {'ticks': 0}
    running = tree('<Runs/>', services=services)
    changes: list[bool] = []
    rings: list[None] = []
    control = TickControl(lambda: rings.append(None), changes.append)
    given_answers: dict[int, list[str]] = {}
    open_commands: list[tuple[int, TickCommand]] = []
    paused, ticks, expected_changes = False, 0, []
    expected: dict[int, bool] = {}
    for number, deed in enumerate(deeds):
        if deed != 'tick':
            given_answers[number] = []
            control.command(deed, given_answers[number].append)
            open_commands.append((number, deed))
            continue
        stepped = False
        while open_commands and not stepped:
            asked, command = open_commands.pop(0)
            expected[asked] = paused or command is not STEP
            stepped = command is STEP and paused
            if command is not STEP and paused is not (command is PAUSE):
                paused = command is PAUSE
                expected_changes.append(paused)
        ticks += stepped or not paused
        assert control.tick(running) is (NodeStatus.RUNNING if stepped or not paused else None)
        assert (services['ticks'], control.paused, control.pending) == (ticks, paused, bool(open_commands))
    assert len(rings) == len(given_answers)
    if close:
        control.close('it is over')
        expected |= {asked: False for asked, _ in open_commands}
        control.close('it is over again')
        late: list[str] = []
        control.command(RESUME, late.append)
        assert late == ['it is over']
    assert changes == expected_changes
    assert {number: len(answers) for number, answers in given_answers.items() if answers} == dict.fromkeys(expected, 1)
    assert {number: answers == [''] for number, answers in given_answers.items() if answers} == expected


def test_a_step_is_one_tick_and_what_yields_goes_on_at_the_next() -> None:
    running = tree('<AsyncSequence><AlwaysSuccess/><AlwaysSuccess/><AlwaysSuccess/></AsyncSequence>')
    control = TickControl(lambda: None, lambda paused: None)
    control.command(PAUSE, lambda reason: None)
    statuses = []
    for _ in range(3):
        control.command(STEP, lambda reason: None)
        statuses.append(control.tick(running))
        assert control.tick(running) is None
    assert statuses == [NodeStatus.RUNNING, NodeStatus.RUNNING, NodeStatus.SUCCESS]


class Motor(StatefulAction):
    """Says in ``services`` what it does; it goes on in a pause when they say so."""

    def on_start(self) -> NodeStatus:
        self.services['deeds'].append('started')
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        self.services['deeds'].append('halted')

    def on_pause(self) -> str:
        self.services['deeds'].append('paused')
        if 'raises' in self.services:
            raise RuntimeError('no brake')
        return str(self.services.get('goes_on', ''))

    def on_resume(self) -> None:
        self.services['deeds'].append('resumed')
        if 'stuck' in self.services:
            raise RuntimeError('it is stuck')


def motor(**services: Any) -> tuple[Tree, TickControl, list[str]]:
    deeds: list[str] = []
    running = tree('<Motor name="motor"/>', services={'deeds': deeds, **services})
    control = TickControl(lambda: None, lambda paused: None)
    assert control.tick(running) is NodeStatus.RUNNING
    return running, control, deeds


def test_leaves_hold_what_they_have_begun_until_the_tree_goes_on() -> None:
    running, control, deeds = motor()
    for command in (PAUSE, PAUSE, RESUME, RESUME):
        control.command(command, lambda reason: None)
        control.tick(running)
    assert deeds == ['started', 'paused', 'resumed']


def test_the_hold_of_a_host_and_the_pause_of_a_command_are_apart() -> None:
    running, control, deeds = motor()
    control.hold('its owner is late')
    assert control.pending and control.tick(running) is None and control.paused
    answers: list[str] = []
    for command in (RESUME, STEP, PAUSE):
        control.command(command, answers.append)
        control.tick(running)
    assert answers == ['', 'the tree is held: its owner is late', '']
    control.hold('')
    assert control.tick(running) is None and control.paused
    control.command(RESUME, answers.append)
    assert control.tick(running) is NodeStatus.RUNNING
    assert deeds == ['started', 'paused', 'resumed']


@pytest.mark.parametrize(
    ('services', 'why'),
    [
        ({'goes_on': 'it has no brake'}, 'it has no brake'),
        ({'raises': True}, 'on_pause raised RuntimeError: no brake'),
    ],
)
def test_what_goes_on_in_a_pause_is_told(services: dict[str, Any], why: str) -> None:
    running, control, _ = motor(**services)
    control.command(PAUSE, lambda reason: None)
    control.tick(running)
    (told,) = control.not_paused
    assert told == f'motor: {why}'
    control.command(RESUME, lambda reason: None)
    control.tick(running)
    assert not control.not_paused


def test_nothing_goes_on_after_a_step_that_completes_the_tree() -> None:
    services: dict[str, Any] = {'ticks': 0}
    running = tree('<Runs/>', services=services)
    control = TickControl(lambda: None, lambda paused: None)
    control.tick(running)
    control.command(PAUSE, lambda reason: None)
    control.tick(running)
    services['gives'] = NodeStatus.SUCCESS
    control.command(STEP, lambda reason: None)
    assert control.tick(running) is NodeStatus.SUCCESS
    assert not control.not_paused


def test_a_halt_ends_a_pause() -> None:
    running = tree('<Runs/>', services={'ticks': 0})
    running.tick_once()
    running.pause()
    assert running.context.paused
    running.halt()
    assert not running.context.paused


def test_a_leaf_that_says_nothing_of_pauses_goes_on() -> None:
    running = tree('<Runs/>', services={'ticks': 0})
    control = TickControl(lambda: None, lambda paused: None)
    control.tick(running)
    control.command(PAUSE, lambda reason: None)
    control.tick(running)
    assert control.not_paused == ('Runs::1: it does not declare how it is paused',)


def test_time_goes_on_while_a_tree_is_paused() -> None:
    clock = ManualClock()
    running = tree('<Timeout msec="1000" name="limit"><Runs/></Timeout>', services={'ticks': 0}, clock=clock)
    control = TickControl(lambda: None, lambda paused: None)
    assert control.tick(running) is NodeStatus.RUNNING
    control.command(PAUSE, lambda reason: None)
    assert control.tick(running) is None
    clock.advance(2.0)
    assert control.tick(running) is None
    control.command(RESUME, lambda reason: None)
    assert control.tick(running) is NodeStatus.FAILURE
    assert running.failure is not None
    assert running.failure.path == 'limit'


def test_a_step_whose_tick_raises_is_answered_and_the_error_goes_on() -> None:
    running = tree('<Raises/>')
    control = TickControl(lambda: None, lambda paused: None)
    answers: list[str] = []
    control.command(PAUSE, answers.append)
    control.command(STEP, answers.append)
    with pytest.raises(NodeExecutionError):
        control.tick(running)
    reason = 'the tick raised: exception in node [Raises::1] (Raises): RuntimeError: scripted fault'
    assert answers == ['', reason]


def test_commands_that_flood_a_tree_that_blocks_are_refused_and_those_before_have_their_effect() -> None:
    control = TickControl(on_command=lambda: None, on_change=lambda _paused: None)
    answers: list[str] = []
    for _ in range(MOST_WAITING + 5):
        control.command(PAUSE, answers.append)
    assert len(answers) == 5
    assert answers[0] == f'{MOST_WAITING} commands wait for the end of the tick that is under way'
    control.tick(tree('<Runs/>', services={'ticks': 0}))
    assert answers[5:] == [''] * MOST_WAITING
    assert control.paused
    control.command(RESUME, answers.append)
    control.tick(tree('<Runs/>', services={'ticks': 0}))
    assert answers[-1] == '' and not control.paused


def test_many_threads_step_a_tree_and_each_step_is_one_tick() -> None:
    services: dict[str, Any] = {'ticks': 0}
    running = tree('<Runs/>', services=services)
    wake_event = WakeEvent()
    control = TickControl(wake_event.set, lambda paused: None)
    clock = SteadyClock()

    def host() -> None:
        while control.tick(running) in (None, NodeStatus.RUNNING):
            if not control.pending:
                wake_event.wait(clock, None if control.paused else clock.now())
        control.close('the tree has ended')

    def ask(command: TickCommand) -> str:
        answered = threading.Event()
        answers: list[str] = []

        def answer(reason: str) -> None:
            answers.append(reason)
            answered.set()

        control.command(command, answer)
        assert answered.wait(60.0)
        assert len(answers) == 1
        return answers[0]

    def step() -> None:
        refusals.extend(ask(STEP) for _ in range(50))

    thread = threading.Thread(target=host)
    thread.start()
    assert ask(PAUSE) == ''
    before = services['ticks']
    refusals: list[str] = []
    steppers = [threading.Thread(target=step) for _ in range(4)]
    for stepper in steppers:
        stepper.start()
    for stepper in steppers:
        stepper.join(DEADLINE)
    assert refusals == [''] * 200
    assert services['ticks'] == before + 200
    services['gives'] = NodeStatus.SUCCESS
    assert ask(STEP) == ''
    thread.join(DEADLINE)
    assert not thread.is_alive()
    assert ask(RESUME) == 'the tree has ended'
    clock.close()


def test_while_a_tree_is_held_within_a_tick_leaves_hold_and_only_a_step_waits_for_its_end() -> None:
    deeds: list[str] = []
    running = tree(
        '<Parallel><Motor name="motor"/><Runs name="runs"/></Parallel>', services={'deeds': deeds, 'ticks': 0}
    )
    control = TickControl(lambda: None, lambda paused: deeds.append(f'change {paused}'))

    def command(command: TickCommand, name: str) -> None:
        control.command(command, lambda refusal: deeds.append(f'{name} {refusal or "done"}'))

    def hold(node: TreeNode) -> NodeStatus:
        command(RESUME, 'before')
        command(STEP, 'too early')
        with control.held_in_tick(running):
            deeds.append('held')
            assert control.not_paused
            command(PAUSE, 'within')
            command(STEP, 'after')
        deeds.append('released')
        assert bool(control.not_paused) is control.paused
        return NodeStatus.IDLE

    control.tick(running)
    running.callbacks.set_pre_tick(running.nodes[2], hold)
    deeds.clear()
    assert control.tick(running) is NodeStatus.RUNNING
    assert deeds == [
        'paused',
        'change True',
        'before done',
        'held',
        'within done',
        'change False',
        'resumed',
        'released',
    ]
    running.callbacks.clear()
    deeds.clear()
    assert control.tick(running) is NodeStatus.RUNNING
    assert deeds == [
        'too early the tree is not paused; pause it before you step it',
        'paused',
        'change True',
        'paused',
        'after done',
    ]
    assert control.not_paused == ('runs: it does not declare how it is paused',)
    # A step that is held is answered, and the pause before it stays.
    running.callbacks.set_pre_tick(running.nodes[2], hold)
    deeds.clear()
    command(STEP, 'held step')
    assert control.tick(running) is NodeStatus.RUNNING
    assert deeds == ['paused', 'before done', 'held step done', 'held', 'within done', 'released', 'paused']


def test_a_command_at_which_a_leaf_raises_is_answered_with_it() -> None:
    running, control, _ = motor(stuck=True)
    answers: list[str] = []
    control.command(PAUSE, answers.append)
    control.tick(running)
    control.command(RESUME, answers.append)
    with pytest.raises(NodeExecutionError, match='it is stuck'):
        control.tick(running)
    reason = 'exception in node [motor] (Motor): RuntimeError: it is stuck'
    assert answers == ['', f'a leaf raised: {reason}']
    assert (control.reason, control.paused) == ('', False)
