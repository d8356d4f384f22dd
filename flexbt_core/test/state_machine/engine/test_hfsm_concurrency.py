# SPDX-License-Identifier: BSD-3-Clause
"""Several states at a time: concurrency containers, and priority containers, during which the others stand still."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_core.state_machine.engine.events import RunEvent, RunReader, StatePaused
from flexbt_core.state_machine.engine.region import ContainerRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, StateKind
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing

EITHER_FAILS = [('failed', [('A', 'failed')]), ('failed', [('B', 'failed')])]
BOTH = [*EITHER_FAILS, ('done', [('A', 'done'), ('B', 'done')])]


def two(**options: Any) -> tuple[Scripted, Scripted, OperatableStateMachine]:
    """FlexBE's example: it fails as soon as one does, and is done when both are."""
    one, other = (Scripted('done', 'failed', **options) for _ in range(2))
    both = machine(Child('A', one), Child('B', other), outcomes=['done', 'failed'], conditions=BOTH)
    return one, other, machine(Child('Both', both, {'done': 'done', 'failed': 'failed'}), outcomes=['done', 'failed'])


def test_all_children_are_active_and_it_ends_when_the_last_one_has() -> None:
    one, other, made = two()
    bench = Bench(made)
    assert list(bench.active) == ['/Both/A', '/Both/B']
    other.end('done')
    bench.settle()
    assert list(bench.active) == ['/Both/A']
    assert bench.transitions[-1][:3] == ('/Both/B', 'done', '')
    bench.pass_time(100.0)
    assert other.calls('on_enter') == other.calls('on_exit') == 1, 'what has ended stays so'
    one.end('done')
    bench.settle()
    assert bench.outcome == 'done'
    assert [(path, outcome, target) for path, outcome, target, _ in bench.transitions[1:]] == [
        ('/Both/A', 'done', '=done'),
        ('/Both', 'done', '=done'),
    ]
    assert (one.trace, other.trace) == (
        ['on_start', 'on_enter', 'execute', 'execute', 'on_exit OUTCOME', 'on_stop'],
        ['on_start', 'on_enter', 'execute', 'execute', 'on_exit OUTCOME', 'on_stop'],
    )


def test_it_ends_as_soon_as_a_condition_holds_and_leaves_the_others_once() -> None:
    one, other, made = two()
    bench = Bench(made)
    other.end('failed')
    bench.settle()
    assert bench.outcome == 'failed'
    assert one.trace[-2:] == ['on_exit PARENT_LEFT', 'on_stop']


def test_all_children_are_entered_before_one_that_ends_at_once_ends_it() -> None:
    one, other, made = two()
    one.do['execute'] = lambda *_: 'failed'
    bench = Bench(made)
    assert bench.outcome == 'failed'
    assert other.trace == ['on_start', 'on_enter', 'on_exit PARENT_LEFT', 'on_stop']


def test_it_waits_for_the_others_to_be_at_rest_before_it_wants_its_outcome() -> None:
    one, other, made = two()
    braking = ['braking']
    one.do['halting'] = lambda *_: braking[0] if braking else None
    bench = Bench(made)
    other.end('failed')
    bench.settle()
    assert one.trace[-1] == 'on_exit PARENT_LEFT'
    assert bench.force('/Both/A', 'done') == '/Both/A is being left already'
    braking.clear()
    one.wake()
    bench.settle()
    assert (bench.outcome, bench.faults) == ('failed', [])


def test_a_child_that_has_ended_counts_when_it_is_at_rest() -> None:
    one, other, made = two()
    braking = ['braking']
    one.do['halting'] = lambda *_: next(iter(braking), None)
    bench = Bench(made)
    for state in (one, other):
        state.end('done')
        bench.settle()
    assert [taken[:3] for taken in bench.transitions] == [('/Both/B', 'done', '')]
    braking.clear()
    one.wake()
    bench.settle()
    assert bench.transitions[1][:3] == ('/Both/A', 'done', '=done')


def test_a_child_that_never_comes_to_rest_does_not_hold_it_up_for_ever() -> None:
    one, other, made = two()
    one.do['halting'] = lambda *_: 'braking'
    bench = Bench(made)
    other.end('failed')
    bench.settle()
    bench.pass_time(2.9)
    assert bench.transitions[1:] == []
    bench.pass_time(0.2)
    assert bench.outcome == 'failed'
    assert bench.faults == [('/Both', 'not everything in it had halted 3 s after it ended: braking')]


def test_each_child_has_a_decision_of_its_own_and_they_are_answered_in_any_order() -> None:
    levels = {'done': Autonomy.High, 'failed': Autonomy.High}
    one, other = Scripted('done', 'failed', outcome='done'), Scripted('done', 'failed', outcome='failed')
    both = machine(
        Child('A', one, autonomy=levels),
        Child('B', other, autonomy=levels),
        outcomes=['done', 'failed'],
        conditions=[*EITHER_FAILS, ('done', [('B', 'done'), ('A', 'done')])],
    )
    bench = Bench(both, autonomy=Autonomy.Low)
    first, second = bench.run.decisions
    assert [(one.path, one.outcome) for one in (first, second)] == [('/A', 'done'), ('/B', 'failed')]
    pending = f'{first.id}, {second.id}'
    assert bench.confirm('x') == f"decision 'x' is not pending any more (pending: {pending})"
    assert bench.force('/B', 'done', first.id) == f"decision '{first.id}' is about /A, not about /B"
    assert bench.force('/B', 'done', second.id) is None
    assert (bench.active, bench.run.decisions) == (('/A',), [first])
    assert bench.confirm(second.id) is not None
    assert bench.confirm(first.id) is None
    assert bench.outcome == 'done'


def test_forcing_the_container_leaves_each_child() -> None:
    one, other, made = two()
    bench = Bench(made, autonomy=Autonomy.Off)
    assert bench.force('/Both', 'done') is None
    assert bench.outcome == 'done'
    assert [state.trace[-2] for state in (one, other)] == ['on_exit PARENT_LEFT'] * 2


def test_a_container_that_is_entered_again_begins_anew() -> None:
    one, other = Scripted('done', outcome='done'), Scripted('done')
    both = machine(Child('A', one), Child('B', other), outcomes=['done'], conditions=[('done', [('B', 'done')])])
    bench = Bench(machine(Child('Both', both, {'done': 'Both'})))
    other.end('done')
    other.do['on_enter'] = lambda state, _: setattr(state, 'outcome', None)
    bench.settle()
    assert (one.calls('on_enter'), bench.active) == (2, ('/Both/B',))


@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit'])
def test_a_child_that_raises_fails_alone(callback: str) -> None:
    def boom(*_: Any) -> Any:
        raise ArithmeticError

    one, other, made = two()
    one.do[callback] = boom
    one.outcome = 'done'
    bench = Bench(made)
    assert bench.outcome == 'failed'
    assert one.calls('on_exit') == 1
    assert other.calls('on_enter') == other.calls('on_exit')


@pytest.mark.parametrize('number', range(2))
@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit', 'on_pause', 'on_resume'])
def test_a_stop_in_a_callback_comes_before_what_would_follow(callback: str, number: int) -> None:
    def stop(state: Scripted, _: Any) -> None:
        state.services.run.preempt('stop')

    states = [Scripted(), Scripted()]
    both = machine(
        *(Child(label, state) for label, state in zip('AB', states, strict=True)),
        conditions=[('ended', [('A', 'done'), ('B', 'done')])],
    )
    states[number].do[callback] = stop
    bench = Bench(both)
    if callback in ('on_pause', 'on_resume'):
        bench.pause()
        bench.resume()
    elif callback == 'on_exit':
        states[number].end('done')
        bench.settle()
    assert bench.outcome == 'preempted'
    for state in states:
        assert state.calls('on_enter') == state.calls('on_exit')
    if callback == 'on_pause':
        assert [state.calls('on_pause') for state in states] == [1, number]
        assert [state.calls('on_resume') for state in states] == [0, 0]
    if callback == 'on_enter':
        assert states[1].calls('on_enter') == number


def test_children_share_the_userdata_of_the_container_and_see_what_is_written_meanwhile() -> None:
    seen: list[Any] = []
    reader = Scripted(input_keys=['shared'], do={'execute': lambda _, userdata: seen.append(userdata.shared)})
    writer = Scripted(output_keys=['shared'])
    both = machine(
        Child('A', reader),
        Child('B', writer),
        defaults={'shared': [0]},
        output_keys=['shared'],
        conditions=[('ended', [('A', 'done')])],
    )
    bench = Bench(machine(Child('Both', both, {'ended': 'ended'}), output_keys=['shared']))
    writer.do['execute'] = lambda _, userdata: userdata.__setitem__('shared', [1])
    writer.wake()
    bench.settle()
    reader.outcome = 'done'
    reader.wake()
    bench.settle()
    assert (seen, bench.run.userdata()) == ([[0], [1]], {'shared': [1]})


def test_nested_containers_are_all_active() -> None:
    def pair(one: Scripted | OperatableStateMachine, other: Scripted | OperatableStateMachine) -> ConcurrencyContainer:
        last = 'done' if isinstance(one, Scripted) else 'ended'
        made = machine(Child('A', one), Child('B', other), conditions=[('ended', [('A', last)])])
        assert isinstance(made, ConcurrencyContainer)
        return made

    states = [Scripted() for _ in range(4)]
    bench = Bench(pair(pair(states[0], states[1]), pair(states[2], nested(states[3], 'C/D'))))
    assert bench.active == ('/A/A', '/A/B', '/B/A', '/B/B/C/D')
    states[0].end('done')
    bench.settle()
    assert bench.outcome == 'ended'
    assert [state.calls('on_exit') for state in states] == [1] * 4


def test_polling_rates_of_children_are_kept() -> None:
    """FlexBE's test: 15 and 10 Hz for one second."""
    fast, slow = Scripted(rate=15.0), Scripted(rate=10.0)
    both = machine(Child('A', fast), Child('B', slow), conditions=[('ended', [('A', 'done')])])
    bench = Bench(both)
    bench.pass_time(1.0)
    assert 14 <= fast.calls('execute') <= 16
    assert 9 <= slow.calls('execute') <= 11
    assert bench.steps <= 30


# -- conditions that cannot be right ---------------------------------------------------------------------------------


def problems(conditions: Iterable[tuple[str, Iterable[tuple[str, str]]]], **places: Any) -> list[str]:
    children = places or {'A': Scripted('done', 'failed'), 'B': Scripted('done', 'failed')}
    made = ConcurrencyContainer(['done', 'failed'], conditions=conditions)
    with made:
        for label, state in children.items():
            OperatableStateMachine.add(label, state)
    with pytest.raises(MachineError) as caught:
        define(made)
    return list(caught.value.problems)


@pytest.mark.parametrize(
    ('conditions', 'problem'),
    [
        ([], '/: the concurrency container has no conditions, so that it could never end'),
        (
            [('don', [('A', 'done')])],
            "/: condition 1, of 'don', is of no outcome of the container; did you mean 'done'?",
        ),
        ([('done', [])], "/: condition 1, of 'done', names no child"),
        ([('done', [('C', 'done')])], "/: condition 1, of 'done', names 'C', which is not a child (A, B)"),
        (
            [('done', [('A', 'dne')])],
            "/: condition 1, of 'done', names 'dne', which is not an outcome of A; did you mean 'done'?",
        ),
        (
            [('done', [('A', 'done'), ('A', 'failed')])],
            "/: condition 1, of 'done', wants two outcomes of one child, so that it never holds",
        ),
        (
            BOTH[1:],
            "/: when its children have ended A by 'failed', B by 'done', no condition holds; add one for that",
        ),
    ],
)
def test_a_problem_of_conditions_is_named(conditions: Any, problem: str) -> None:
    assert problem in problems(conditions)


def test_outcomes_by_which_a_child_never_ends_need_no_condition() -> None:
    inner = machine(Child('S', Scripted('done'), {'done': 'good'}), outcomes=['good', 'bad'])
    made = machine(Child('A', inner), outcomes=['done'], conditions=[('done', [('A', 'good')])])
    assert define(made).structure()[1].targets == ('=done', '')


def test_outcomes_that_a_nested_machine_reaches_need_one() -> None:
    def inner(way: str) -> OperatableStateMachine:
        return machine(Child('S', Scripted('a', 'b'), {'a': 'good', 'b': way}), outcomes=['good', 'bad'])

    def around(child: OperatableStateMachine) -> OperatableStateMachine:
        return machine(Child('A', child), outcomes=['done'], conditions=[('done', [('A', 'good')])])

    text = "/: when its children have ended A by 'bad', no condition holds"
    for child in (
        inner('bad'),
        machine(Child('M', inner('bad'), {'good': 'good', 'bad': 'bad'}), outcomes=['good', 'bad']),
    ):
        with pytest.raises(MachineError, match=text):
            define(around(child))
    both = machine(Child('S', Scripted()), outcomes=['good', 'bad'], conditions=[('bad', [('S', 'done')])])
    with pytest.raises(MachineError, match=text):
        define(around(both))
    define(around(inner('good')))


def test_children_lead_to_outcomes_of_the_container_only() -> None:
    made = machine(
        Child('A', Scripted(), {'done': 'B'}), Child('B', Scripted()), conditions=[('ended', [('A', 'done')])]
    )
    with pytest.raises(
        MachineError, match=r"/A: the outcome 'done' leads to 'B', which is not an outcome of the container"
    ):
        define(made)


def test_what_the_check_cannot_exclude_is_a_fault_when_it_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here the search is cut off; as is that through some ten thousand combinations."""
    monkeypatch.setattr('flexbt_core.state_machine.authoring.checked_definition._SEARCHED', 1)
    for outcomes, outcome in ((['ended', 'failed'], 'failed'), (['ended'], 'error')):
        one, other = Scripted('done', 'lost', outcome='lost'), Scripted(outcome='done')
        both = machine(Child('A', one), Child('B', other), outcomes=outcomes, conditions=[('ended', [('A', 'done')])])
        bench = Bench(both)
        text = "all of its children have ended (A by 'lost', B by 'done'), and no condition holds; add one for that"
        assert (bench.outcome, bench.faults) == (outcome, [('/', text)])


def test_the_structure_tells_the_kinds() -> None:
    both = machine(Child('A', passing()), conditions=[('ended', [('A', 'done')])])
    first = machine(Child('P', passing(), {'done': 'ended'}), priority=True)
    made = machine(Child('Both', both, {'ended': 'First'}), Child('First', first, {'ended': 'ended'}))
    shown = {one.path: (one.kind, one.type_name, one.targets) for one in define(made).structure()}
    assert shown['/Both'] == (StateKind.CONCURRENCY, 'ConcurrencyContainer', ('/First',))
    assert shown['/Both/A'] == (StateKind.STATE, 'Scripted', ('=ended',))
    assert shown['/First'] == (StateKind.PRIORITY, 'PriorityContainer', ('=ended',))


# -- priority --------------------------------------------------------------------------------------------------------


class Priority:
    """A state beside another one that is followed by a priority container."""

    def __init__(self) -> None:
        self.beside, self.urgent = Scripted(rate=1.0), Scripted('done', 'failed')
        self.before = Scripted(do={'on_enter': lambda state, _: setattr(state, 'outcome', None)})
        urgent = machine(
            Child('U', self.urgent, {'done': 'done', 'failed': 'failed'}), outcomes=['done', 'failed'], priority=True
        )
        line = machine(
            Child('Before', self.before, {'done': 'Urgent'}),
            Child('Urgent', urgent, {'done': 'ended', 'failed': 'Before'}),
        )
        conditions = [('ended', [('Beside', 'done')]), ('ended', [('Line', 'ended'), ('Beside', 'done')])]
        self.bench = Bench(machine(Child('Line', line), Child('Beside', self.beside), conditions=conditions))

    def begin(self) -> None:
        self.before.end('done')
        self.bench.settle()


def test_everything_else_stands_still_while_a_priority_container_is_active() -> None:
    case = Priority()
    bench = case.bench
    bench.pass_time(0.5)
    case.begin()
    assert bench.active == ('/Line/Urgent/U', '/Beside')
    assert [leaf.path for leaf in bench.run.active_states() if leaf.is_paused] == ['/Beside']
    order = [event for event in bench.trace if event.startswith(('on_pause', 'on_enter /Line/Urgent'))]
    assert order == ['on_pause /Beside', 'on_enter /Line/Urgent/U'], 'first the others stand still'
    executed = case.beside.calls('execute')
    case.beside.end('done')
    bench.pass_time(10.0)
    assert case.beside.calls('execute') == executed
    assert bench.force('/Beside', 'done') == '/Beside is paused while /Line/Urgent has priority'
    assert bench.repeat('/Beside') == '/Beside is paused while /Line/Urgent has priority'
    case.urgent.end('failed')
    bench.settle()
    assert (bench.outcome, case.beside.trace[-4:]) == (
        'ended',
        ['on_resume', 'execute', 'on_exit OUTCOME', 'on_stop'],
    )
    assert case.before.trace[-2:] == ['on_exit PARENT_LEFT', 'on_stop']


def test_the_others_go_on_when_the_priority_container_is_at_rest() -> None:
    case = Priority()
    busy = ['braking']
    case.urgent.do['halting'] = lambda *_: busy[0] if busy else None
    case.begin()
    assert case.bench.force('/Line/Urgent', 'failed') is None
    assert 'on_resume' not in case.beside.trace
    busy.clear()
    case.urgent.wake()
    case.bench.settle()
    assert case.beside.trace[-2:] == ['on_resume', 'execute']
    assert case.bench.active == ('/Line/Before', '/Beside')


def test_a_priority_container_that_fails_to_begin_lets_go() -> None:
    def boom(*_: Any) -> Any:
        raise ArithmeticError

    case = Priority()
    case.urgent.do['on_enter'] = boom
    case.begin()
    assert case.bench.run.pausing.priority is None
    assert case.beside.trace[-2:] == ['on_resume', 'execute']


def test_a_paused_state_that_is_stopped_is_not_resumed() -> None:
    case = Priority()
    case.begin()
    case.bench.stop()
    assert case.beside.trace[-3:] == ['on_pause', 'on_exit PREEMPTED', 'on_stop']


def test_a_state_that_is_left_while_it_is_paused_is_paused_no_longer_and_begins_its_next_visit_as_any() -> None:
    class Pauses(RunReader):
        reads = (StatePaused,)

        def read(self, event: RunEvent) -> None:
            told.append(event)

    told: list[RunEvent] = []
    busy = ['braking']
    beside, urgent = Scripted(do={'halting': lambda *_: busy[0] if busy else None}), Scripted()
    first = machine(Child('U', urgent, {'done': 'ended'}), priority=True)
    both = machine(Child('B', beside), Child('P', first), conditions=[('ended', [('P', 'ended')])])
    bench = Bench(machine(Child('Both', both, {'ended': 'Both'})), start=False)
    bench.run.add_reader(Pauses())
    bench.run.start()
    bench.settle()
    assert bench.force('/Both/P/U', 'done') is None
    leaf = bench.run.active_states()[0]
    assert (leaf.path, leaf.is_paused, beside.trace[-2:]) == ('/Both/B', False, ['on_pause', 'on_exit PARENT_LEFT'])
    before = leaf.clock.now()
    bench.pass_time(1.0)
    assert leaf.clock.now() - before == 1.0, 'its last work may need time'
    busy.clear()
    beside.wake()
    bench.settle()
    assert (beside.trace[-2:], urgent.trace[-2:]) == (['on_enter', 'on_pause'], ['on_enter', 'execute'])
    assert told == [StatePaused('/Both/B', is_paused) for is_paused in (True, False, True)]
    bench.stop()


def test_a_state_that_raises_in_on_pause_or_on_resume_fails() -> None:
    def boom(*_: Any) -> Any:
        raise ArithmeticError

    for callback in ('on_pause', 'on_resume'):
        state = Scripted('done', 'failed', do={callback: boom})
        bench = Bench(nested(state, 'A'))
        bench.pause()
        assert state.trace[-1] == 'on_pause'
        bench.resume()
        assert (bench.outcome, state.trace[-2]) == ('failed', 'on_exit FAULT')
        assert bench.faults[0][1].startswith(f'{callback} raised:')


def test_priority_within_priority() -> None:
    inner_state, inner_beside, outer_beside = Scripted(), Scripted(), Scripted()
    inner = machine(Child('I', inner_state, {'done': 'ended'}), priority=True)
    pair = machine(Child('X', inner_beside), Child('Inner', inner), conditions=[('ended', [('Inner', 'ended')])])
    outer = machine(Child('Pair', pair, {'ended': 'Rest'}), Child('Rest', Scripted(), {'done': 'ended'}), priority=True)
    made = machine(Child('Y', outer_beside), Child('Outer', outer), conditions=[('ended', [('Outer', 'ended')])])
    bench = Bench(made)
    paused = [leaf.path for leaf in bench.run.active_states() if leaf.is_paused]
    assert (bench.run.pausing.priority, paused) == ('/Outer/Pair/Inner', ['/Y', '/Outer/Pair/X'])
    inner_state.end('done')
    bench.settle()
    assert (bench.run.pausing.priority, bench.active) == ('/Outer', ('/Y', '/Outer/Rest'))
    assert [leaf.is_paused for leaf in bench.run.active_states()] == [True, False]
    assert inner_beside.trace[-1] == 'on_exit PARENT_LEFT'


def test_the_engine_has_one_region_for_a_machine_and_one_for_each_child_of_a_concurrency_container() -> None:
    _, _, both = two()
    made = machine(
        Child('Both', both, {'done': 'Then', 'failed': 'Then'}), Child('Then', Scripted(), {'done': 'ended'})
    )
    root = Bench(made).run.root
    around = root.children['Both']
    assert isinstance(around, ContainerRun)
    inner = around.children['Both']
    assert isinstance(inner, ContainerRun)
    assert [len(one.regions) for one in (root, around, inner)] == [1, 1, 2]
