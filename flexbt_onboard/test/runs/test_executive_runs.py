# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors as an operator sees them over the link."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from flexbt_common.values.entries import to_entry
from flexbt_common.values.limits import check_limits
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.engine.events import CommandDecided, RunEvent, RunReader
from flexbt_core.state_machine.engine.operator_commands import force, pause
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import BehaviorArgument, ExecutiveCommand, ExecutiveLog, ExecutiveStatus, StateStructure
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_onboard.behaviors.run_context import state_services
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, wait_until

START, STOP = ExecutiveCommand.START, ExecutiveCommand.STOP
IDLE, STARTING, RUNNING, STOPPING = (
    ExecutiveStatus.IDLE,
    ExecutiveStatus.STARTING,
    ExecutiveStatus.RUNNING,
    ExecutiveStatus.STOPPING,
)


class Step(EventState):
    """A state that does what it is given."""

    def __init__(
        self,
        outcomes: tuple[str, ...] = ('done',),
        execute: Callable[[Any], str | None] = lambda userdata: None,
        **keys: Any,
    ) -> None:
        super().__init__(outcomes=outcomes, desired_rate=None, **keys)
        self._execute = execute

    def execute(self, userdata: Any) -> str | None:
        return self._execute(userdata)


def single(state: Callable[[], EventState], **add: Any) -> Callable[[], OperatableStateMachine]:
    """Return a machine of one state, whose outcomes it has."""

    def make() -> OperatableStateMachine:
        one = state()
        machine = OperatableStateMachine(outcomes=one.outcomes)
        with machine:
            OperatableStateMachine.add('One', one, {name: name for name in one.outcomes}, **add)
        return machine

    return make


def two_steps() -> OperatableStateMachine:
    """Return the first is done at once, the second waits for ever; low autonomy on the way in between."""
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        OperatableStateMachine.add(
            'First', Step(execute=lambda _: 'done'), {'done': 'Second'}, autonomy={'done': Autonomy.Low}
        )
        OperatableStateMachine.add('Second', Step(('done', 'bad')), {'done': 'finished', 'bad': 'failed'})
    return machine


class Typed(Behavior):
    manifest = BehaviorManifest(
        'Typed', parameters=[BehaviorParameter('speed', 1.0), BehaviorParameter('label', 'a', choices=['a', 'b'])]
    )
    speed: float
    label: str

    def create(self) -> OperatableStateMachine:
        def finish(userdata: Any) -> str:
            seen.append((self.speed, self.label, userdata['x'], userdata['y']))
            return 'done'

        seen = TYPED_SEEN
        machine = OperatableStateMachine(outcomes=['done'], input_keys=['x'])
        machine.userdata.y = 7
        with machine:
            OperatableStateMachine.add('One', Step(execute=finish, input_keys=['x', 'y']), {'done': 'done'})
        return machine


TYPED_SEEN: list[Any] = []


@pytest.fixture
def make_bench() -> Iterator[Callable[..., ExecutiveBench]]:
    """Make benches, and closes them."""
    benches: list[ExecutiveBench] = []

    def make(*behaviors: Any, **options: Any) -> ExecutiveBench:
        made = [one if isinstance(one, type) else behavior_of(one) for one in behaviors]
        benches.append(ExecutiveBench(*made, **options))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


Make = Callable[..., ExecutiveBench]


def test_a_behavior_of_two_states_is_run_confirmed_and_forced(make_bench: Make) -> None:
    bench = make_bench(two_steps)
    assert bench.status.state == IDLE
    run_id = bench.start(autonomy=1)
    bench.wait_for(lambda status: status.decisions, 'decision')
    (structure,) = bench.structures
    assert (structure.run_id, structure.behavior) == (run_id, 'Test')
    assert [(state.path, state.kind) for state in structure.states] == [
        ('/', StateStructure.MACHINE),
        ('/First', StateStructure.STATE),
        ('/Second', StateStructure.STATE),
    ]
    assert (bench.status.state, bench.status.behavior, bench.status.autonomy) == (RUNNING, 'Test', 1)
    (decision,) = bench.status.decisions
    assert (decision.kind, decision.path, decision.outcome, decision.required_autonomy) == (1, '/First', 'done', 1)
    bench.applied(ExecutiveCommand.CONFIRM, decision_id=decision.id)
    bench.wait_active('/Second')
    assert list(bench.status.decisions) == []
    bench.applied(ExecutiveCommand.FORCE, path='/Second', outcome='bad')
    assert bench.wait_idle() == 'failed'
    assert bench.run_id == run_id
    assert list(bench.status.active_states) == []
    assert len(bench.structures) == 1


def test_the_start_is_told_before_what_the_states_say(make_bench: Make) -> None:
    class Telling(Step):
        def on_start(self) -> None:
            self.log_info('the state starts')

        def on_enter(self, userdata: Any) -> None:
            self.log_info('the state is entered')

    bench = make_bench(single(lambda: Telling(execute=lambda _: 'done')))
    bench.start()
    bench.wait_idle()
    told = [bench.logged(text).sequence for text in ("behavior 'Test' started", 'starts', 'is entered')]
    assert told == sorted(told), bench.logs


def test_every_status_is_numbered_and_names_its_run_after_the_structure(make_bench: Make) -> None:
    bench = make_bench(two_steps)
    for _ in range(3):
        bench.start(autonomy=3)
        bench.wait_active('/Second')
        bench.applied(STOP)
        assert bench.wait_idle() == 'preempted'
    numbers = [status.sequence for status in bench.statuses]
    assert numbers == sorted(set(numbers))
    assert len({status.executive_id for status in bench.statuses}) == 1
    runs = [structure.run_id for structure in bench.structures]
    assert len(set(runs)) == 3
    assert {status.run_id for status in bench.statuses if status.state == RUNNING} <= set(runs)


def test_the_level_that_is_raised_lets_a_waiting_transition_happen(make_bench: Make) -> None:
    bench = make_bench(two_steps)
    bench.start(autonomy=0)
    bench.wait_for(lambda status: status.decisions, 'decision')
    bench.applied(ExecutiveCommand.AUTONOMY, autonomy=2)
    bench.wait_active('/Second')
    assert bench.status.autonomy == 2
    assert 'no state' in bench.refused(ExecutiveCommand.AUTONOMY, autonomy=2, path='/Nowhere')
    assert '4 is none of' in bench.refused(ExecutiveCommand.AUTONOMY, autonomy=4)
    bench.applied(ExecutiveCommand.AUTONOMY, autonomy=0, path='/Second')
    assert bench.status.autonomy == 2, 'the level of a sub-tree is not that of the run'


def test_arguments_and_inputs_reach_the_behavior_with_their_types(make_bench: Make) -> None:
    TYPED_SEEN.clear()
    bench = make_bench(Typed)
    bench.start('Typed', arguments={'speed': '2', 'label': 'b'}, inputs=[to_entry('x', [1, 2])])
    assert bench.wait_idle() == 'done'
    bench.start('Typed', inputs=[to_entry('x', 's'), to_entry('y', 8)])
    assert bench.wait_idle() == 'done'
    assert TYPED_SEEN == [(2.0, 'b', [1, 2], 7), (1.0, 'a', 's', 8)]


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({'behavior': 'Typt'}, ["'Typt'", "did you mean 'Typed'"]),
        ({'arguments': [BehaviorArgument(name='speed', value='fast')]}, ['speed', 'float', "'fast'"]),
        ({'arguments': [BehaviorArgument(name='label', value='c')]}, ['label', "'c'", 'a, b']),
        ({'arguments': [BehaviorArgument(name='size', value='1')]}, ['size', 'speed, label']),
        ({'arguments': [BehaviorArgument(name='speed', value='1')] * 2}, ['speed', 'twice']),
        ({'inputs': []}, ["'x'", 'needed']),
        ({'inputs': [to_entry('x', 1), to_entry('z', 1)]}, ["'z'", 'x, y']),
        ({'inputs': [to_entry('x', 1), to_entry('x', 1)]}, ["'x'", 'twice']),
        ({'autonomy': 9}, ['autonomy 9']),
    ],
)
def test_a_start_that_cannot_be_is_refused_with_the_reason(
    make_bench: Make, fields: dict[str, Any], words: list[str]
) -> None:
    bench = make_bench(Typed)
    reason = bench.refused(START, **{'behavior': 'Typed', 'inputs': [to_entry('x', 1)], **fields})
    assert all(word in reason for word in words), reason
    assert bench.status.state == IDLE
    assert bench.structures == []
    bench.start('Typed', inputs=[to_entry('x', 1)])
    assert bench.wait_idle() == 'done'


def test_a_run_for_which_no_thread_is_left_is_refused_and_the_next_one_runs(
    make_bench: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, begin = make_bench(two_steps), threading.Thread.start

    def start(thread: threading.Thread) -> None:
        if thread.name.startswith('run_'):
            raise RuntimeError("can't start new thread")
        begin(thread)

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, 'start', start)
        assert "it cannot begin: can't start new thread" in bench.refused(START, behavior='Test')
    bench.wait_for(lambda status: status.state == IDLE, 'rest')
    bench.start(autonomy=3)
    bench.applied(STOP)
    bench.wait_idle()


def no_target() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('One', Step(), {'done': 'Nowhere'})
        OperatableStateMachine.add('Two', Step(input_keys=['k']), {'done': 'done'})
    return machine


def raises(error: BaseException) -> Callable[[], OperatableStateMachine]:
    def make() -> OperatableStateMachine:
        raise error

    return make


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (no_target, ["'Nowhere'", "'k'"]),
        (raises(ValueError('no such map')), ['ValueError: no such map']),
        (raises(SystemExit(3)), ['SystemExit']),
        (lambda: None, ['OperatableStateMachine']),
        (lambda: OperatableStateMachine(), ['no states']),
    ],
)
def test_a_behavior_that_cannot_be_built_is_refused_with_everything_that_is_wrong(
    make_bench: Make, make: Any, words: list[str]
) -> None:
    bench = make_bench(make, behavior_of(two_steps, 'Other'))
    reason = bench.refused(START, behavior='Test')
    assert all(word in reason for word in words), reason
    assert (bench.status.state, bench.status.outcome) == (IDLE, ''), 'it is no run that has failed'
    assert bench.status.message == reason
    bench.start('Other')


def test_a_behavior_that_is_built_slowly_blocks_nobody_and_can_be_stopped(make_bench: Make) -> None:
    go = threading.Event()

    def make() -> OperatableStateMachine:
        go.wait(DEADLINE)
        return two_steps()

    bench = make_bench(make)
    started = bench.send(START, behavior='Test')
    bench.wait_for(lambda status: status.state == STARTING, 'starting')
    assert 'starting' in bench.refused(ExecutiveCommand.FORCE, path='/First', outcome='done')
    assert 'starting' in bench.refused(START, behavior='Test')
    bench.applied(STOP)
    assert bench.status.state == STOPPING
    go.set()
    assert 'stopped before it began' in bench.result(started).reason
    bench.wait_for(lambda status: status.state == IDLE and not status.outcome, 'idle; nothing has run')


def test_one_run_at_a_time(make_bench: Make) -> None:
    bench = make_bench(two_steps)
    run_id = bench.start()
    reason = bench.refused(START, behavior='Test')
    assert 'running' in reason
    assert run_id in reason
    assert bench.status.state == RUNNING


def test_an_exception_of_a_state_reaches_the_operator_with_its_trace(make_bench: Make) -> None:
    def fail(_userdata: Any) -> str:
        raise ZeroDivisionError('wheels have no radius')

    bench = make_bench(single(lambda: Step(execute=fail)))
    run_id = bench.start()
    assert bench.wait_idle() == 'error'
    line = bench.logged('wheels have no radius')
    assert (line.severity, line.path, line.run_id) == (ExecutiveLog.ERROR, '/One', run_id)
    assert 'test_executive_runs.py' in line.text, 'where it was raised'
    assert '/One' in bench.status.message


def test_what_escapes_from_a_state_ends_the_run_in_order(make_bench: Make) -> None:
    class Exits(Step):
        def on_exit(self, userdata: Any) -> None:
            exits.append(self.exit_reason)

    def leave(_userdata: Any) -> str:
        raise SystemExit('\0\udcff')

    exits: list[Any] = []
    bench = make_bench(single(lambda: Exits(execute=leave)))
    bench.start()
    assert bench.wait_idle() == 'error'
    assert len(exits) == 1
    assert 'SystemExit' in bench.status.message
    bench.start()


def test_a_command_that_comes_when_the_run_has_ended_is_answered(make_bench: Make) -> None:
    bench = make_bench(two_steps)
    bench.start()
    bench.wait_active('/Second')
    run = bench.executive.runs.run
    assert run is not None
    bench.applied(ExecutiveCommand.FORCE, path='/Second', outcome='done')
    bench.wait_idle()
    answers: list[CommandDecided] = []

    class Answers(RunReader):
        def read(self, event: RunEvent) -> None:
            if isinstance(event, CommandDecided):
                answers.append(event)

    run.add_reader(Answers())
    run.command('force', force, '/Second', 'done')
    run.command('pause', pause)
    assert answers == [CommandDecided(name, 'the run has ended') for name in ('force', 'pause')]


def test_a_command_that_comes_as_the_run_begins_is_refused_with_the_reason(
    make_bench: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(two_steps)
    bench.start()
    bench.wait_active('/Second')
    run = bench.executive.runs.run
    assert run is not None
    answers: list[RunEvent] = []
    monkeypatch.setattr(run, '_tell', answers.append)
    read = ['', 'it is being built']  # the thread of the run changes it meanwhile
    monkeypatch.setattr(BehaviorRun, '_not_begun', property(lambda _: read.pop()), raising=False)
    run.command('pause', pause)
    assert answers == [CommandDecided('pause', 'it is being built')]


class SlowStop(EventState):
    """Has not halted before it is told."""

    def __init__(self, at_rest: threading.Event) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self.at_rest = at_rest
        self.exits: list[Any] = []

    def on_exit(self, userdata: Any) -> None:
        self.exits.append(self.exit_reason)

    def halting(self) -> str | None:
        return None if self.at_rest.is_set() else 'braking'


def test_a_stopped_run_is_stopping_until_everything_is_at_rest(make_bench: Make) -> None:
    state = SlowStop(threading.Event())
    bench = make_bench(single(lambda: state))
    bench.start()
    bench.wait_active('/One')
    bench.applied(STOP, reason='lunch')
    assert bench.status.state == STOPPING
    assert 'stopping' in bench.refused(START, behavior='Test')
    bench.applied(STOP)
    assert len(state.exits) == 1
    state.at_rest.set()
    state.wake()
    assert bench.wait_idle() == 'preempted'
    assert 'tester' in bench.status.message
    assert 'lunch' in bench.status.message


def test_a_state_that_blocks_blocks_only_its_run(make_bench: Make) -> None:
    go = threading.Event()

    def block(_userdata: Any) -> str:
        go.wait(DEADLINE)
        return 'done'

    bench = make_bench(single(lambda: Step(execute=block)))
    bench.start()
    bench.wait_active('/One')
    before = bench.status.sequence
    bench.wait_for(lambda status: status.sequence > before + 1, 'heartbeats')
    bench.applied(STOP)
    assert bench.status.state == STOPPING
    go.set()
    bench.wait_idle()


def test_closing_the_executive_stops_the_run_first_and_says_so(make_bench: Make) -> None:
    class Watched(Step):
        def on_exit(self, userdata: Any) -> None:
            exits.append(self.exit_reason)

    exits: list[Any] = []
    bench = make_bench(single(Watched))
    bench.start()
    bench.wait_active('/One')
    bench.runtime.close()
    assert len(exits) == 1
    assert bench.executive.runs.run is None
    bench.wait_for(lambda status: status.state == IDLE, 'last status')
    assert 'shutting down' in bench.status.message


def test_a_run_that_does_not_stop_does_not_hold_up_the_end(make_bench: Make) -> None:
    go = threading.Event()

    def block(_userdata: Any) -> str:
        go.wait(DEADLINE)
        return 'done'

    bench = make_bench(single(lambda: Step(execute=block)))
    bench.start()
    bench.wait_active('/One')
    closing = threading.Thread(target=bench.runtime.close)
    closing.start()
    closing.join(DEADLINE / 2.0)
    assert not closing.is_alive()
    go.set()
    wait_until(lambda: not (run := bench.executive.runs.run) or run.join(0.0), 'thread of the run')
    bench.logged('had not halted')


def test_what_a_state_says_it_does_is_short_for_the_link(make_bench: Make) -> None:
    class Chatty(Step):
        def on_enter(self, userdata: Any) -> None:
            self.ask('\udc80' + 'q' * 30_000)

        def activity(self) -> list[str]:
            return ['a' * 100_000, *(f'line {number}' for number in range(100))]

    bench = make_bench(single(Chatty))
    bench.start()
    lines = bench.wait_for(lambda status: status.active_states and status.active_states[0].activity, 'activity')
    assert len(lines) == 21 and max(map(len, lines)) < 300
    assert '99800 characters left out' in lines[0]
    assert lines[1] == 'line 0' and lines[-1] == '... 81 more'
    (decision,) = bench.status.decisions
    assert decision.prompt.startswith('\ufffdqq') and 'characters left out' in decision.prompt
    check_limits(bench.status)


@pytest.mark.parametrize('kind', [MemoryError, SystemExit])
def test_a_fault_of_ours_on_the_thread_of_a_run_ends_the_run_and_is_told(
    make_bench: Make, monkeypatch: pytest.MonkeyPatch, kind: type[BaseException]
) -> None:
    def fault(_run: BehaviorRun, _machine: Any) -> None:
        raise kind('ours')

    bench = make_bench(single(Step))
    monkeypatch.setattr(BehaviorRun, '_tell_skills', fault)
    bench.start()
    assert bench.wait_idle() == 'error'
    assert 'fault in the executive' in bench.status.message and kind.__name__ in bench.logged('ours').text


def test_a_fault_that_cannot_be_told_ends_the_run(make_bench: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    class UnshownError(Exception):
        def __repr__(self) -> str:
            raise MemoryError('told')

    def fault(_run: BehaviorRun, _machine: Any) -> None:
        raise UnshownError

    escaped: list[Any] = []
    monkeypatch.setattr(threading, 'excepthook', escaped.append)
    bench = make_bench(single(Step))
    monkeypatch.setattr(BehaviorRun, '_tell_skills', fault)
    bench.start()
    assert bench.wait_idle() == 'error'
    assert bench.status.message == 'fault in the executive'
    wait_until(lambda: escaped, 'the end of the thread')
    assert escaped[0].exc_type is MemoryError


def test_a_fault_of_ours_at_the_end_of_a_run_ends_it_and_is_told(
    make_bench: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fault(_machine: MachineRun) -> Any:
        raise MemoryError('ours')

    bench = make_bench(single(partial(Step, execute=lambda _: 'done')))
    monkeypatch.setattr(MachineRun, 'userdata', fault)
    bench.start()
    assert bench.wait_idle() == 'error'
    assert 'fault in the executive' in bench.status.message and 'MemoryError' in bench.logged('ours').text


def test_an_activity_that_raises_hides_nothing_else(make_bench: Make) -> None:
    class Bad(Step):
        def activity(self) -> list[str]:
            raise KeyError('node')

    bench = make_bench(single(Bad))
    bench.start()
    lines = bench.wait_for(lambda status: status.active_states and status.active_states[0].activity, 'activity')
    assert 'activity() raised' in lines[0]
    fault = bench.logged('KeyError')
    assert fault.path == '/One'
    bench.wait_for_next_status()
    bench.wait_for_next_status()
    assert len([line for line in bench.logs if 'KeyError' in line.text]) == 1


def test_an_activity_that_blocks_holds_up_its_run_only(make_bench: Make) -> None:
    """The link goes on and a stop is taken while ``activity`` does not return; no other thread calls it."""
    go, asked = threading.Event(), set[str]()

    class Slow(Step):
        def activity(self) -> list[str]:
            asked.add(threading.current_thread().name)
            go.wait(DEADLINE)
            return ['late']

    bench = make_bench(single(Slow))
    bench.start()
    wait_until(lambda: asked, 'asked')
    for _ in range(3):
        bench.wait_for_next_status()
    assert bench.status.state == ExecutiveStatus.RUNNING and not bench.status.active_states[0].activity
    stop = bench.send(STOP)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.STOPPING, 'stopping')
    go.set()
    bench.result(stop)
    assert bench.wait_idle() == 'preempted'
    assert asked == {'run_Test'}


def test_what_a_state_does_is_shown_when_it_tells_and_with_each_heartbeat(make_bench: Make) -> None:
    """A state that says something else each time it is asked does not make more statuses than the heartbeat."""

    class Counting(Step):
        count = 0
        news = ''

        def activity(self) -> list[str]:
            self.count += 1
            return [f'asked {self.count} times', self.news]

    made: list[Counting] = []

    def make() -> EventState:
        made.append(Counting())
        return made[-1]

    bench = make_bench(single(make))
    bench.start()
    bench.wait_for(lambda status: status.active_states and status.active_states[0].activity, 'activity')
    for _ in range(3):
        bench.wait_for_next_status()
    begin = len(bench.statuses)
    for _ in range(3):
        bench.wait_for_next_status()
    *_, before, last = bench.arrivals[: begin + 3]
    assert last - before > 0.2  # of a heartbeat of 0.5 s
    assert bench.statuses[begin].active_states[0].activity != bench.statuses[begin + 2].active_states[0].activity
    made[0].news = 'news'
    state_services(made[0]).changed()
    bench.wait_for(lambda status: 'news' in status.active_states[0].activity, 'news')


def test_a_behavior_may_be_a_machine_in_yaml(make_bench: Make) -> None:
    """What ``read_machine`` gives is run as it is, again and again; what is no machine is refused."""
    text = 'machine: {outcomes: [out], states: {One: {state: Step, transitions: {done: out}}}}'
    states = {'Step': partial(Step, execute=lambda _: 'done')}

    class Yaml(Behavior):
        manifest = BehaviorManifest('Yaml')

        def create(self) -> MachineDefinition:
            return read_machine(text, states)

    class Text(Behavior):
        manifest = BehaviorManifest('Text')

        def create(self) -> Any:
            return text

    bench = make_bench(Yaml, Text)
    for _ in range(2):
        bench.start('Yaml')
        assert bench.wait_idle() == 'out'
    assert 'create() has to return' in bench.refused(START, behavior='Text')


class Failing(EventState):
    """Says why, and fails."""

    def __init__(self, why: str = 'action server /bt_executor is gone') -> None:
        super().__init__(outcomes=['failed'], desired_rate=None)
        self._why = why

    def execute(self, userdata: Any) -> str:
        if self._why:
            self.log_error(self._why)
        return 'failed'


def failing() -> OperatableStateMachine:
    """Fails two machines deep, and beside one that is stopped for it."""
    inner = OperatableStateMachine(outcomes=['failed'])
    with inner:
        OperatableStateMachine.add('Drive', Failing(), {'failed': 'failed'})
    machine = OperatableStateMachine(outcomes=['failed'])
    with machine:
        OperatableStateMachine.add('Inner', inner, {'failed': 'failed'})
    return machine


def recovering() -> OperatableStateMachine:
    """End by a state that has nothing to say, after one that has."""
    machine = OperatableStateMachine(outcomes=['failed'])
    with machine:
        OperatableStateMachine.add('Drive', Failing(), {'failed': 'Give up'})
        OperatableStateMachine.add('Give up', Failing(''), {'failed': 'failed'})
    return machine


def test_a_run_that_a_failing_state_ends_says_why(make_bench: Callable[..., ExecutiveBench]) -> None:
    bench = make_bench(behavior_of(failing, 'Failing'), behavior_of(recovering, 'Recovering'))
    bench.start('Failing', autonomy=3)
    assert bench.wait_idle() == 'failed'
    assert bench.status.message == '/Inner/Drive: action server /bt_executor is gone'
    run_id = bench.start('Recovering', autonomy=3)
    assert bench.wait_idle() == 'failed'
    assert (bench.run_id, bench.status.message) == (run_id, '')


class FailingOnce(EventState):
    """Says why it fails when it is entered first, and waits for the operator."""

    visits = 0

    def __init__(self) -> None:
        super().__init__(outcomes=['again', 'done'], desired_rate=None)

    def on_enter(self, userdata: Any) -> None:
        self.visits += 1
        if self.visits == 1:
            self.log_error('action server /bt_executor is gone')

    def execute(self, userdata: Any) -> str | None:
        return 'done' if self.visits > 1 else None


def test_an_error_of_an_earlier_visit_is_not_the_reason_of_the_end(make_bench: Make) -> None:
    def make() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('Drive', FailingOnce(), {'again': 'Drive', 'done': 'finished'})
        return machine

    bench = make_bench(make)
    bench.start(autonomy=3)
    bench.wait_active('/Drive')
    bench.applied(ExecutiveCommand.FORCE, path='/Drive', outcome='again')
    assert bench.wait_idle() == 'finished'
    assert bench.status.message == ''
