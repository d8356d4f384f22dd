# SPDX-License-Identifier: BSD-3-Clause
"""Would it decide otherwise now? Missions are recorded in a world here; on real processes, see the system tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flexbt_common import names
from flexbt_common.values.limits import deserialize
from flexbt_console.errors import UsageError
from flexbt_console.recording.run_file import read_run, write_recording
from flexbt_console.recording.topics import type_of
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.one_process.programs import Program, named_programs
from flexbt_testing.one_process.recorded import _once, decide_again, main
from flexbt_testing.one_process.what_if import Event
from flexbt_testing.one_process.world import World

TREES = 'flexbt_demo_behaviors/navigate'


def recorded(folder: Path, mission: Callable[[World], object], motion: str = 'abstract') -> Path:
    """Record a mission from before its start on."""
    file = folder / 'run.mcap'
    recorder = Program('flexbt_console', 'recorder', {'file': str(file)})
    with World(0, [*named_programs('', folder, folder, motion), recorder], writable=[folder]) as world:
        world.run_until(lambda _view: file.exists())
        world.run(3.0)
        mission(world)
        world.run(1.0)
        world.terminate('recorder')
        world.run_while(lambda: world.processes['recorder'].is_alive, 'the recorder')
    return file


def judge_a_path_and_refuse_the_next(world: World) -> None:
    world.start('Navigate Split')
    world.answer('/AskGoal', 'corridor')
    world.choose('/JudgePath', 'done')
    world.run_until(world.asks('/AskGoal'), within=90)
    world.answer('/AskGoal', 'dock')
    world.choose('/JudgePath', 'canceled')
    world.decline('/AskGoal')
    world.run_until(world.ended('finished'))


def test_the_answers_to_decisions_are_those_of_the_recording(tmp_path: Path) -> None:
    file = recorded(tmp_path, judge_a_path_and_refuse_the_next)
    found = decide_again(file)
    assert found.difference is None, str(found)
    assert [one.what for one in found.after.events if one.what.startswith('leaves /JudgePath')] == [
        'leaves /JudgePath by done (outcome)',
        'leaves /JudgePath by canceled (forced)',
    ]
    assert found.before.ends == found.after.ends == ['finished']
    tree = tmp_path / 'global_planner.xml'
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="GlobalPlanner"><BehaviorTree ID="GlobalPlanner">'
        '<AlwaysFailure/></BehaviorTree></root>'
    )
    found = decide_again(file, [(f'{TREES}/global_planner.xml', tree)])
    assert found.difference is not None and found.difference.after is not None
    assert found.difference.after.what == 'AlwaysFailure FAILURE'
    assert str(found).startswith(f'first difference at {found.difference.time:.2f} s, tree GlobalPlanner\n  recorded: ')


def test_an_answer_to_a_decision_that_no_status_shows_waits_for_it(tmp_path: Path) -> None:
    """The status is not sent for each change, and the drives of the recording may have been a little shorter."""
    short, messages = tmp_path / 'short.mcap', []
    for one in read_run(recorded(tmp_path, judge_a_path_and_refuse_the_next)):
        message = deserialize(one.data, type_of(one.topic))
        if one.topic == names.EXECUTIVE_STATUS:
            message.decisions = []
        is_answer = one.topic == names.EXECUTIVE_COMMAND and message.decision_id
        messages.append((one.time - (300_000_000 if is_answer else 0), one.topic, message))
    write_recording(short, sorted(messages, key=lambda one: one[0]))
    found = decide_again(short)
    assert found.after.ends == ['finished'], str(found)


def test_a_start_right_after_the_end_of_a_run_waits_for_that(tmp_path: Path) -> None:
    def start_twice(world: World) -> None:
        world.start('Navigate')
        world.force('/AskGoal', 'failed')
        world.start('Navigate')
        world.decline('/AskGoal')

    quick, messages, forced_at = tmp_path / 'quick.mcap', [], 0
    for one in read_run(recorded(tmp_path, start_twice)):
        message, time = deserialize(one.data, type_of(one.topic)), one.time
        if one.topic == names.EXECUTIVE_COMMAND and message.kind == ExecutiveCommand.FORCE:
            forced_at = time
        if one.topic == names.EXECUTIVE_COMMAND and message.kind == ExecutiveCommand.START and forced_at:
            time = forced_at + 1
        messages.append((time, one.topic, message))
    write_recording(quick, sorted(messages, key=lambda one: one[0]))
    found = decide_again(quick)
    assert found.difference is None, str(found)


def test_a_drive_that_was_paused_ends_when_it_did(tmp_path: Path) -> None:
    def pause_a_drive(world: World) -> None:
        world.start('Navigate')
        world.answer('/AskGoal', 'corridor')
        world.run(3.0)
        world.pause()
        world.run(4.0)
        world.resume()
        world.run_until(world.asks('/AskGoal'), within=90)
        world.decline('/AskGoal')

    found = decide_again(recorded(tmp_path, pause_a_drive))
    assert found.difference is None, str(found)
    assert found.after.ends == ['finished']


def test_a_recovery_that_was_stopped_as_it_waited_is_so_again(tmp_path: Path) -> None:
    """The action Wait of Nav2 has no codes of errors."""

    def stop_a_wait(world: World) -> None:
        world.start('Navigate Split')
        world.answer('/AskGoal', 'corridor')
        world.choose('/JudgePath', 'failed')
        world.run(2.0)
        world.stop()

    found = decide_again(recorded(tmp_path, stop_a_wait))
    assert found.after.events[-2].what == 'Wait RUNNING'
    assert found.difference is None, str(found)


def test_a_recording_of_no_use_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / 'missing.mcap')]) == 2
    assert 'missing.mcap: cannot be read' in capsys.readouterr().err
    for tolerance in ('nan', 'inf', '-1', 'no'):
        with pytest.raises(SystemExit):
            main([str(tmp_path / 'missing.mcap'), f'--tolerance={tolerance}'])
        assert f"'{tolerance}' is not a number from 0 on" in capsys.readouterr().err
    write_recording(tmp_path / 'idle.mcap', [(1, 'executive/status', ExecutiveStatus())])
    with pytest.raises(UsageError, match='has no start of a behavior; begin to record before it'):
        decide_again(tmp_path / 'idle.mcap')


def test_repetitions_are_told_once_until_an_action_fails() -> None:
    told = [
        'Root RUNNING',
        'Plan RUNNING',
        'Plan SUCCESS',
        'IsFree FAILURE',
        'Plan RUNNING',
        'IsFree FAILURE',
        'Plan FAILURE',
        'IsFree FAILURE',
        'Plan RUNNING',
        'Root RUNNING',
        'Plan RUNNING',
    ]
    nodes = 'Root', 'Plan', 'IsFree'
    events = [Event(0.0, 'tree T', what, nodes.index(what.partition(' ')[0])) for what in told]
    once = [event.what for event in _once(events)]
    assert once == [*told[:4], 'Plan FAILURE', 'IsFree FAILURE', 'Plan RUNNING', 'Root RUNNING', 'Plan RUNNING']
    waits = [Event(0.0, 'tree T', what, node) for node, what in enumerate(['Root RUNNING', *['Wait SUCCESS'] * 2])]
    assert list(_once([*waits, waits[1]])) == waits, 'two nodes of one kind'
    twice = [Event(1.0, 'executive', 'PAUSE applied')] * 2
    assert list(_once(twice)) == twice
