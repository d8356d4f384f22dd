# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE's own tests of its core demand (test_core.py and test_exceptions.py), through FlexBE's names.

The engine itself is tested with the engine; here a run of the executive has states that derive from FlexBE's
EventState.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from flexbt_flexbe import Autonomy, EventState, Logger, OperatableStateMachine, UserData
from flexbt_onboard.state_machine import Severity
from flexbt_states.testing import Run, StateBench, wait_until

Work = Callable[['Traced', Any], 'str | None']


class Traced(EventState):
    """A state as FlexBE's users write them, which notes its callbacks."""

    def __init__(self, trace: list[str], work: Work, **keys: Any) -> None:
        super().__init__(outcomes=['done', 'error'], **keys)
        self._trace = trace
        self._work = work

    def on_start(self) -> None:
        self._trace.append(f'{self._name}.start')

    def on_enter(self, userdata: Any) -> None:
        self._trace.append(f'{self._name}.enter')

    def execute(self, userdata: Any) -> str | None:
        self._trace.append(f'{self._name}.execute')
        return self._work(self, userdata)

    def on_exit(self, userdata: Any) -> None:
        self._trace.append(f'{self._name}.exit')

    def on_stop(self) -> None:
        self._trace.append(f'{self._name}.stop')


def done(state: Traced, userdata: Any) -> str:
    return 'done'


def stay(state: Traced, userdata: Any) -> None:
    return None


def machine_of(*places: tuple[str, Callable[[], Any], dict[str, str]], **options: Any) -> OperatableStateMachine:
    """A machine with outcomes 'finished' and 'failed'; its states, their ways and remappings."""
    machine = OperatableStateMachine(outcomes=['finished', 'failed'], **options)
    labels = [label for label, _, _ in places]
    with machine:
        for label, make, remapping in places:
            state = make()
            following = [*labels, 'finished'][labels.index(label) + 1]
            first, second = state.outcomes
            OperatableStateMachine.add(
                label,
                state,
                transitions={first: following, second: 'failed'},
                autonomy={first: Autonomy.Low, second: Autonomy.High},
                remapping=remapping,
            )
    return machine


def run(bench: StateBench, work: Work, autonomy: int = Autonomy.Full, **keys: Any) -> tuple[Run, list[str]]:
    trace: list[str] = []
    place: tuple[str, Callable[[], Any], dict[str, str]] = ('subject', lambda: Traced(trace, work, **keys), {})
    return bench.run(lambda: machine_of(place), autonomy), trace


def test_the_events_of_a_state_come_in_flexbes_order(bench: StateBench) -> None:
    trace: list[str] = []
    going = bench.run(
        lambda: machine_of(('A', lambda: Traced(trace, done), {}), ('B', lambda: Traced(trace, done), {}))
    )
    assert going.wait() == 'finished'
    events = 'A.start B.start A.enter A.execute A.exit B.enter B.execute B.exit A.stop B.stop'
    assert trace == events.split()


def test_differs_a_stop_leaves_the_active_state_by_on_exit(bench: StateBench) -> None:
    """FlexBE calls on_stop only (team-vigir #146)."""
    going, trace = run(bench, stay)
    wait_until(going.behavior_run.active_states, 'active')
    assert going.stop() == 'preempted'
    assert trace[-2:] == ['subject.exit', 'subject.stop']


@pytest.mark.parametrize(('level', 'waits'), [(0, True), (1, True), (2, False), (3, False)])
def test_an_outcome_passes_at_a_level_above_the_required_one(bench: StateBench, level: int, waits: bool) -> None:
    going, trace = run(bench, done, autonomy=level)
    if waits:
        (asked,) = wait_until(going.behavior_run.decisions, 'decision')
        assert (asked.outcome, asked.required_autonomy) == ('done', Autonomy.Low)
        going.behavior_run.set_autonomy(Autonomy.Full, '', lambda _: None)
    assert going.wait() == 'finished'
    assert trace.count('subject.execute') == 1


@pytest.mark.parametrize('rate', [40.0, 100.0])
def test_a_state_is_executed_at_its_rate(bench: StateBench, rate: float) -> None:
    times: list[float] = []

    def work(state: Traced, userdata: Any) -> str | None:
        times.append(state.clock.now())
        return 'done' if len(times) == 11 else None

    going, _ = run(bench, work, desired_rate=rate)
    assert going.wait() == 'finished'
    assert 9.9 / rate <= times[-1] - times[0] < 30 / rate


def test_the_rate_can_be_changed_and_has_to_be_positive(bench: StateBench) -> None:
    def work(state: Traced, userdata: Any) -> str | None:
        state.set_rate(200.0)
        times.append(state.clock.now())
        if len(times) < 21:
            return None
        state.set_rate(0)
        return 'done'

    times: list[float] = []
    going, _ = run(bench, work)
    assert going.wait() == 'error'
    assert 'has to be positive, not 0 Hz' in going.errors()
    assert times[-1] - times[1] < 1.0, 'at the default rate it takes 1.9 s'


class TestUserData:
    """The cases of FlexBE's test_user_data."""

    @staticmethod
    def run(bench: StateBench, build: Callable[[], OperatableStateMachine]) -> Run:
        going = bench.run(build)
        assert going.wait() == 'finished', going.errors()
        return going

    def test_keys_are_remapped_scoped_and_handed_out_as_declared(self, bench: StateBench) -> None:
        seen: dict[str, Any] = {}

        def first(state: Traced, userdata: Any) -> str:
            seen['first'] = (userdata.data_in, 'data_in' in userdata, 'inner' in userdata)
            userdata.data_out = 'written'
            return 'done'

        def inside(state: Traced, userdata: Any) -> str:
            seen['inside'] = (userdata.own, userdata['from_outside'])
            userdata.shown, userdata.hidden = 1, 2
            userdata.both += 1
            return 'done'

        def last(state: Traced, userdata: Any) -> str:
            seen['last'] = (userdata.shown, userdata.counter, userdata.read)
            return 'done'

        def inner() -> OperatableStateMachine:
            keys = {'input_keys': ['own', 'from_outside'], 'output_keys': ['shown', 'hidden'], 'io_keys': ['both']}
            machine = machine_of(
                ('Inside', lambda: Traced([], inside, **keys), {}),
                input_keys=['from_outside', 'both'],
                output_keys=['shown', 'both'],
            )
            machine.userdata.own = 'own'
            return machine

        def outer() -> OperatableStateMachine:
            machine = machine_of(
                (
                    'First',
                    lambda: Traced([], first, input_keys=['data_in'], output_keys=['data_out']),
                    {'data_in': 'given', 'data_out': 'made'},
                ),
                ('Inner', inner, {'from_outside': 'made', 'both': 'counter'}),
                ('Last', lambda: Traced([], last, input_keys=['shown', 'counter', 'read']), {'read': 'made'}),
            )
            machine.userdata.given = 'given'
            machine.userdata['counter'] = 7
            return machine

        self.run(bench, outer)
        assert seen == {
            'first': ('given', True, False),
            'inside': ('own', 'written'),
            'last': (1, 8, 'written'),
        }


class TestExceptions:
    """The cases of FlexBE's test_exceptions; a state that raises ends the run, where FlexBE tries it again for ever."""

    @pytest.mark.parametrize(
        ('work', 'error'),
        [
            (lambda *_: 'invalid', 'StateError'),
            (lambda _, userdata: userdata.undeclared, 'UserDataError'),
            (lambda _, userdata: setattr(userdata, 'undeclared', 1), 'UserDataError'),
            (lambda _, userdata: userdata.absent, 'UserDataError'),
            (lambda _, userdata: 1 / 0, 'ZeroDivisionError'),
        ],
    )
    def test_the_operator_sees_the_error_and_the_state_is_not_repeated(
        self, bench: StateBench, work: Work, error: str
    ) -> None:
        trace: list[str] = []

        going = bench.run(
            lambda: machine_of(
                ('subject', lambda: Traced(trace, work, input_keys=['absent']), {}),
                ('Later', lambda: Traced(trace, done, output_keys=['absent']), {}),
            )
        )
        assert going.wait() == 'error'
        assert f'{error}: ' in going.errors()
        assert trace.count('subject.execute') == 1


class TestLogger:
    def test_lines_name_the_state_and_keep_percent_signs(self, bench: StateBench) -> None:
        def work(state: Traced, userdata: Any) -> str:
            Logger.loginfo('100 % of %s')
            Logger.logwarn('%d of %s', 3, 'four')
            Logger.loghint('hint')
            Logger.logerr('error')
            Logger.logdebug('debug')
            Logger.log('reported', Logger.REPORT_WARN)
            Logger.error('alias')
            for _ in range(3):
                Logger.logwarn_throttle(60.0, 'once')
            Logger.localinfo('in the log of the node only')
            return 'done'

        going, _ = run(bench, work)
        assert going.wait() == 'finished'
        assert going.lines == [
            (Severity.INFO.value, '/subject', '100 % of %s'),
            (Severity.WARN.value, '/subject', '3 of four'),
            (Severity.HINT.value, '/subject', 'hint'),
            (Severity.ERROR.value, '/subject', 'error'),
            (Severity.DEBUG.value, '/subject', 'debug'),
            (Severity.WARN.value, '/subject', 'reported'),
            (Severity.ERROR.value, '/subject', 'alias'),
            (Severity.WARN.value, '/subject', 'once'),
        ]

    def test_constructors_may_log_too(self, bench: StateBench) -> None:
        def machine() -> OperatableStateMachine:
            Logger.logwarn('building')
            return machine_of(('subject', lambda: Traced([], done), {}))

        going = bench.run(machine)
        assert going.wait() == 'finished'
        assert going.lines == [(Severity.WARN.value, '', 'building')]


def test_a_state_finds_what_flexbe_gives_to_each(bench: StateBench) -> None:
    seen: list[Any] = []

    def work(state: Traced, userdata: UserData) -> str:
        seen.append((state.name, state.path, state._outcomes, state._input_keys, state._output_keys))
        seen.append(Traced._node is state._node is bench.runtime.node)
        seen.append(state._node.get_clock().now().nanoseconds > 0)
        state._pub = 'my own'
        seen.append((state._pub, type(state._sub).__name__))
        return 'done'

    going, _ = run(bench, work, output_keys=['x'])
    assert going.wait() == 'finished'
    assert seen == [
        ('subject', '/subject', ['done', 'error'], [], ['x']),
        True,
        True,
        ('my own', 'ProxySubscriberCached'),
    ]
