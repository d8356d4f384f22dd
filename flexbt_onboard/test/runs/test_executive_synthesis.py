# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that operators have made while one runs; and searches that do not end as they should."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import pytest

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import MACHINE_TEXT
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_msgs.msg import ExecutiveCommand, QueueOptions
from flexbt_onboard.behaviors.machine_store import MOST_MACHINES, MachineStore
from flexbt_onboard.node import synthesizer
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.node.synthesizer import SearchProcess
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, wait_until

pytestmark = pytest.mark.dds('a search is a process')

Result = SynthesizeBehavior.Result

SEARCH_SECONDS: Final = 4.0 * DEADLINE
"""What a search is given: it gives way to all others."""
SEARCH_DEADLINE: Final = SEARCH_SECONDS + DEADLINE
"""Within which there is an answer, s."""

COFFEE = """\
state_outcome_mappings: {grind: completed, brew: completed, fail: failure}
sm_outcome_mappings: {finished: finished}
capabilities:
  grind:
    interface: OperatorDecisionState
    parameters: {outcomes: [grind, fail]}
    postconditions: [grind]
  brew:
    interface: OperatorDecisionState
    parameters: {outcomes: [brew, fail]}
    preconditions: [grind]
    postconditions: {completed: [brew], failure: ['!grind']}
"""


def installed() -> OperatableStateMachine:
    return OperatableStateMachine(outcomes=['finished'])


class SynthesisBench(ExecutiveBench):
    """An executive that keeps what is made, and a client that asks for it."""

    def __init__(self, directory: Path) -> None:
        parameters = ExecutiveParameters(
            peers=(), machine_directory=str(directory), capability_directories=(str(directory),)
        )
        super().__init__(behavior_of(installed), parameters=parameters)
        self._link = ActionLinks(self.console).link(SynthesizeBehavior, names.SYNTHESIZE_BEHAVIOR)

    @property
    def names(self) -> list[tuple[str, str]]:
        """Names and packages of the behaviors that operators see."""
        return [(one.name, one.package) for one in self.lists[-1].behaviors]

    @property
    def machines(self) -> dict[str, str]:
        """What operators see of each behavior."""
        return {one.name: one.machine for one in self.lists[-1].behaviors}

    def ask(self, **fields: Any) -> tuple[ActionCall, Future[Any]]:
        done: Future[Any] = Future()
        goal = SynthesizeBehavior.Goal(**{'time_limit': SEARCH_SECONDS, **fields})
        return ActionCall(self._link, goal, on_done=done.set_result, server_timeout=DEADLINE), done

    def cancel_all(self) -> int:
        """Return what a console asks for that asked for nothing itself; how many searches are canceled."""
        service: Any = SynthesizeBehavior.Impl.CancelGoalService
        link = ServiceLinks(self.console).link(service, f'{names.SYNTHESIZE_BEHAVIOR}/_action/cancel_goal')
        response: Any = service_outcome(link, service.Request(), DEADLINE).response
        return len(response.goals_canceling)

    def made(self, **fields: Any) -> Any:
        result = self.ask(**fields)[1].result(SEARCH_DEADLINE).result
        assert result is not None
        return result


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[SynthesisBench]:
    with closing(SynthesisBench(tmp_path)) as bench:
        yield bench


def test_a_behavior_is_made_while_another_runs_and_taken_by_switch(bench: SynthesisBench, tmp_path: Path) -> None:
    (tmp_path / 'coffee.yaml').write_text(COFFEE, encoding='utf-8')
    made = bench.made(system='coffee', goals=['brew'], operator_id='ann')
    assert (made.code, made.message, made.behavior) == (Result.SUCCESS, '', 'coffee')
    assert made.machine.startswith('# brew, from coffee\n')
    wait_until(lambda: bench.machines.get('coffee') == made.machine, 'the machine, for consoles that come later')
    bench.start('coffee')
    bench.wait_active('/grind')
    assert bench.made(capabilities=COFFEE, goals=['brew'], name='again').code == Result.SUCCESS
    assert bench.status.behavior == 'coffee'  # nothing was started or left
    wait_until(lambda: ('again', 'synthesized') in bench.names, 'the behavior in the list')
    bench.applied(ExecutiveCommand.SWITCH, behavior='again')
    bench.applied(ExecutiveCommand.FORCE, path='/grind', outcome='grind')
    bench.wait_active('/brew')

    # What runs is not replaced, nor what is installed.
    assert 'runs' in bench.made(capabilities=COFFEE, goals=['brew'], name='again').message
    assert 'an installed behavior' in bench.made(capabilities=COFFEE, goals=['brew'], name='Test').message
    refused = bench.made(capabilities=COFFEE, goals=['brew & !grind'], name='never')
    assert refused.code == Result.UNREALIZABLE
    assert "  - precondition 'grind' of brew (capabilities:11)" in refused.explanation
    assert 'never' not in dict(bench.names)


@pytest.mark.parametrize(
    'line',
    ['{"code": "perhaps"}', '5', '{"code": "made", "machine": "machine: ["}'],
    ids=['a verdict of another version', 'no object', 'a machine that is none'],
)
def test_a_search_that_answers_nonsense_ends_with_a_fault_and_another_one_may_follow(
    bench: SynthesisBench, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.setattr(synthesizer, '_installed_command', lambda: [sys.executable, '-c', f'print({line!r})'])
    for _ in range(2):
        made = bench.made(capabilities=COFFEE, goals=['brew'])
        assert made.code == Result.ERROR, made.message
        assert 'fault' in made.message


def test_what_was_made_is_there_after_a_restart(tmp_path: Path) -> None:
    directory = tmp_path / 'onboard_executive'
    directory.mkdir()
    (directory / 'coffee.yaml').write_text('# brew\nmachine: {outcomes: [finished], states: {}}\n', encoding='utf-8')
    (directory / 'Test.yaml').write_text('machine: {}  # hidden by the installed one\n', encoding='utf-8')
    (directory / '.rc.yaml').write_bytes(b'\xff')
    long = MACHINE + f'# {"x" * MACHINE_TEXT}\n'
    (directory / 'long.yaml').write_text(long, encoding='utf-8')
    with closing(SynthesisBench(tmp_path)) as bench:
        named = [('Test', 'test'), ('coffee', 'synthesized'), ('long', 'synthesized')]
        wait_until(lambda: bench.names == named, 'all of them')
        assert bench.machines['coffee'].startswith('# brew\nmachine: ') and bench.machines['long'] == ''


MACHINE = """\
machine:
  outcomes: [finished]
  states:
    wait: {state: OperatorDecisionState, parameters: {outcomes: [go]}, transitions: {go: finished}}
"""


def slow_search(monkeypatch: pytest.MonkeyPatch, until: Path) -> None:
    """Let searches find MACHINE when a file is there, and not before."""
    answer = json.dumps({'code': 'made', 'machine': '# new\n' + MACHINE})
    program = f"""
import os, time
print('{{"doing": "searching"}}', flush=True)
while not os.path.exists({str(until)!r}):
    time.sleep(0.02)
print({answer!r}, flush=True)
"""
    monkeypatch.setattr(
        'flexbt_onboard.node.synthesizer._installed_command', lambda: [sys.executable, '-S', '-c', program]
    )


@pytest.mark.parametrize('is_queued', [False, True], ids=['started', 'queued'])
def test_what_was_started_or_queued_during_a_search_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_queued: bool
) -> None:
    slow_search(monkeypatch, tmp_path / 'go')
    kept = tmp_path / 'onboard_executive' / 'old.yaml'
    kept.parent.mkdir()
    kept.write_text('# old\n' + MACHINE, encoding='utf-8')
    with closing(SynthesisBench(tmp_path)) as bench:
        _, done = bench.ask(capabilities=COFFEE, name='old')
        bench.logged("synthesis of 'old'")
        if is_queued:
            bench.applied(ExecutiveCommand.QUEUE_HOLD)
            options = QueueOptions(count=1, on_failure=QueueOptions.HOLD)
            bench.applied(ExecutiveCommand.QUEUE_ADD, behavior='old', run_id='', queue_options=[options])
        else:
            bench.start('old')
        (tmp_path / 'go').touch()
        result = done.result(SEARCH_DEADLINE).result
        assert result is not None and result.code == Result.FAILURE and 'was started meanwhile' in result.message
        assert 'give another name' in bench.made(capabilities=COFFEE, name='old').message
    assert kept.read_text(encoding='utf-8') == '# old\n' + MACHINE


def test_a_search_that_nobody_wants_any_more_makes_room(
    bench: SynthesisBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow_search(monkeypatch, tmp_path / 'go')
    monkeypatch.setattr('flexbt_onboard.node.synthesis_server.GONE_SECONDS', 0.1)
    with NodeRuntime.open('other') as other:
        PresenceToken(other, 'bob')
        bench.wait_for(lambda _status: 'bob' in bench.executive.presence.present, 'there')
        _, done = bench.ask(capabilities=COFFEE, name='never', operator_id='bob', time_limit=3600.0)
        bench.logged("synthesis of 'never'")
        assert 'another synthesis' in bench.made(capabilities=COFFEE, operator_id='ann').message
    result = done.result(SEARCH_DEADLINE).result
    assert result is not None and result.code == Result.CANCELED and "'bob'" in result.message

    # Anybody may end what another one has asked for.
    assert bench.cancel_all() == 0
    _, done = bench.ask(capabilities=COFFEE, name='other', operator_id='bob')
    bench.logged("synthesis of 'other'")
    assert bench.cancel_all() == 1
    result = done.result(SEARCH_DEADLINE).result
    assert result is not None and result.code == Result.CANCELED
    (tmp_path / 'go').touch()
    # Who was never there is a program.
    assert bench.made(capabilities=COFFEE, name='next', operator_id='ann').code == Result.SUCCESS


def test_the_oldest_machines_give_way_and_no_other_files(tmp_path: Path) -> None:
    store = MachineStore(tmp_path)
    others = [tmp_path / 'capabilities.yaml', tmp_path / '.hidden.yaml', tmp_path / 'folder.yaml']
    others[0].write_text(COFFEE, encoding='utf-8')
    others[1].write_text(MACHINE, encoding='utf-8')
    others[2].mkdir()
    for number in range(MOST_MACHINES):
        assert store.keep(f'm{number}', MACHINE, ()) == []
        os.utime(tmp_path / f'm{number}.yaml', (1e9 + number, 1e9 + number))
    for other in others:
        os.utime(other, (1e8, 1e8))
    assert store.keep('last', MACHINE, {'m0'}) == []  # the oldest is in use
    assert 'm0' in [entry.name for entry in store.entries()[0]]  # and still known after a restart
    assert store.keep('more', MACHINE, ()) == ['m1', 'm0']
    assert all(other.exists() for other in others)
    with pytest.raises(UnicodeEncodeError):
        store.keep('more', MACHINE + '\ud800', ())
    assert not list(tmp_path.glob('*.tmp'))
    entries, problems = store.entries()
    assert len(entries) == MOST_MACHINES and len(problems) == len(others)


def test_the_editor_of_flexbe_gets_states_and_the_executive_keeps_nothing(
    bench: SynthesisBench, tmp_path: Path
) -> None:
    action = pytest.importorskip('flexbe_msgs.action').BehaviorSynthesis
    (tmp_path / 'coffee.yaml').write_text(COFFEE, encoding='utf-8')
    link = ActionLinks(bench.console).link(action, names.FLEXBE_SYNTHESIS)

    def asked(wanted: str) -> tuple[Any, list[Any]]:
        goal, done, told = action.Goal(), Future[Any](), list[Any]()
        goal.request.system, goal.request.name, goal.request.goal = 'coffee', 'Coffee', wanted
        ActionCall(link, goal, on_done=done.set_result, on_feedback=told.append, server_timeout=DEADLINE)
        return done.result(SEARCH_DEADLINE).result, told

    made, _ = asked('brew')
    assert (made.error_code.value, [state.state_path for state in made.states]) == (
        made.error_code.SUCCESS,
        ['/', '/grind', '/brew', 'finished'],
    )
    refused, told = asked('brew & !grind')
    assert refused.error_code.value < 0 and 'no machine can do that' in told[-1].status
    assert bench.names == [('Test', 'test')]


CASES = {
    'it crashes': ('import os; os.abort()', 'SIGABRT'),
    'it ends without an answer': ('', 'exit code 0'),
    'it writes what is not JSON': ('print("hello", flush=True); input()', 'cannot be run'),
    'it hangs': ('import time; time.sleep(1000)', 'no answer within'),
}


@pytest.mark.parametrize('case', CASES)
def test_a_search_that_fails_ends_with_a_reason(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program, reason = CASES[case]
    monkeypatch.setattr('flexbt_onboard.node.synthesizer._GRACE', 0.1)
    done: Future[tuple[Any, str]] = Future()
    command = [sys.executable, '-S', '-c', program]
    seconds = 0.1 if case == 'it hangs' else DEADLINE
    SearchProcess(command, {}, seconds, lambda _message: None, lambda *end: done.set_result(end))
    answer, why = done.result(SEARCH_DEADLINE)
    assert answer is None and reason in why, why


def test_a_search_is_ended_at_once_when_it_is_canceled() -> None:
    began = threading.Event()
    done: Future[tuple[Any, str]] = Future()
    program = 'import time; print("{}", flush=True); time.sleep(1000)'
    command = [sys.executable, '-S', '-c', program]
    search = SearchProcess(command, {}, 1000.0, lambda _message: began.set(), lambda *end: done.set_result(end))
    assert began.wait(DEADLINE)
    search.cancel()
    assert done.result(SEARCH_DEADLINE) == (None, '')
