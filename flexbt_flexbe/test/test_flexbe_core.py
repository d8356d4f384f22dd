# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE's own tests of its core demand (test_core.py and test_exceptions.py), through FlexBE's names.

The engine itself is tested with the engine; here a run of the executive has states that derive from FlexBE's
EventState.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.engine.operator_commands import pause, resume, set_autonomy
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_flexbe import (
    Autonomy,
    ConcurrencyContainer,
    EventState,
    Logger,
    OperatableStateMachine,
    PriorityContainer,
    UserData,
)
from flexbt_flexbe.api import logger
from flexbt_flexbe.states import WaitState
from flexbt_testing.nodes.state_bench import Run, StateBench
from flexbt_testing.waiting import wait_until

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
    """Return a machine with outcomes 'finished' and 'failed'; its states, their ways and remappings."""
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
    wait_until(going.active, 'active')
    assert going.stop() == 'preempted'
    assert trace[-2:] == ['subject.exit', 'subject.stop']


@pytest.mark.parametrize(('level', 'waits'), [(0, True), (1, True), (2, False), (3, False)])
def test_an_outcome_passes_at_a_level_above_the_required_one(bench: StateBench, level: int, waits: bool) -> None:
    going, trace = run(bench, done, autonomy=level)
    if waits:
        (asked,) = wait_until(going.decisions, 'decision')
        assert (asked.outcome, asked.required_autonomy) == ('done', Autonomy.Low)
        going.behavior_run.command(None, set_autonomy, Autonomy.Full)
    assert going.wait() == 'finished'
    assert trace.count('subject.exit') == 1


def test_a_blocked_state_is_executed_on_and_may_change_its_mind(bench: StateBench) -> None:
    wanted: list[str | None] = ['error']
    going, trace = run(bench, lambda *_: wanted[0], autonomy=Autonomy.Low, desired_rate=100.0)
    (asked,) = wait_until(going.decisions, 'decision')
    executed = trace.count('subject.execute')
    wait_until(lambda: trace.count('subject.execute') > executed + 2, 'executed while it is blocked')
    wanted[0] = None
    wait_until(lambda: not going.decisions(), 'withdrawn')
    assert going.confirm(asked.id) is not None, 'the answer to what was withdrawn has no effect'
    wanted[0] = 'done'
    (asked_again,) = wait_until(going.decisions, 'decision')
    assert (asked_again.outcome, asked_again.id != asked.id) == ('done', True)
    going.confirm(asked_again.id)
    assert going.wait() == 'finished'


class TestContainers:
    """The cases of FlexBE's test_concurrency_container."""

    @staticmethod
    def container(
        children: dict[str, Callable[[], Any]], conditions: list[tuple[str, list[tuple[str, str]]]]
    ) -> OperatableStateMachine:
        container = ConcurrencyContainer(outcomes=['done', 'error'], conditions=conditions)
        with container:
            for label, make in children.items():
                state = make()
                OperatableStateMachine.add(label, state, transitions={name: name for name in state.outcomes})
        root = OperatableStateMachine(outcomes=['finished', 'failed'])
        with root:
            OperatableStateMachine.add('Both', container, transitions={'done': 'finished', 'error': 'failed'})
        return root

    CONDITIONS = (
        ('error', [('side', 'error')]),
        ('error', [('main', 'error')]),
        ('done', [('side', 'done'), ('main', 'done')]),
    )

    @pytest.mark.parametrize(
        ('main', 'side', 'expected'),
        [
            ('done', 'done', 'finished'),
            ('error', None, 'failed'),
            (None, 'error', 'failed'),
            ('done', 'error', 'failed'),
        ],
    )
    def test_conditions_decide_and_each_child_is_left_once(
        self, bench: StateBench, main: str | None, side: str | None, expected: str
    ) -> None:
        trace: list[str] = []
        children: dict[str, Callable[[], Any]] = {
            'main': lambda: Traced(trace, lambda *_: main),
            'side': lambda: Traced(trace, lambda *_: side),
        }
        going = bench.run(lambda: self.container(children, list(self.CONDITIONS)))
        assert going.wait() == expected
        for label in children:
            assert trace.count(f'{label}.enter') == trace.count(f'{label}.exit') <= 1

    def test_each_child_runs_at_its_own_rate(self, bench: StateBench) -> None:
        times: dict[str, list[float]] = {'main': [], 'side': []}

        def counted(label: str) -> Work:
            def work(state: Traced, userdata: Any) -> str | None:
                times[label].append(state.clock.now())
                return 'done' if len(times[label]) == 11 else None

            return work

        rates = {'main': 100.0, 'side': 40.0}
        going = bench.run(
            lambda: self.container(
                {label: partial(Traced, [], counted(label), desired_rate=rate) for label, rate in rates.items()},
                list(self.CONDITIONS),
            )
        )
        assert going.wait() == 'finished'
        for label, rate in rates.items():
            assert 9.9 / rate <= times[label][-1] - times[label][0]
        assert times['main'][-1] < times['side'][-1], 'the slower one does not hold up the faster one'

    def test_every_child_waits_for_the_operator_where_its_autonomy_says_so(self, bench: StateBench) -> None:
        """In FlexBE 2.x only the first child does."""
        root = OperatableStateMachine(outcomes=['finished'])
        with root:
            container = ConcurrencyContainer(outcomes=['done'], conditions=[('done', [('A', 'done'), ('B', 'done')])])
            with container:
                for label in ('A', 'B'):
                    OperatableStateMachine.add(
                        label, WaitState(0.0), transitions={'done': 'done'}, autonomy={'done': Autonomy.High}
                    )
            OperatableStateMachine.add('Both', container, transitions={'done': 'finished'})
        going = bench.run(lambda: root, autonomy=Autonomy.Low)
        asked = wait_until(lambda: len(found := going.decisions()) == 2 and found, 'two decisions')
        assert {one.path for one in asked} == {'/Both/A', '/Both/B'}
        for one in asked:
            going.confirm(one.id)
        assert going.wait() == 'finished'

    def test_a_priority_container_pauses_its_siblings(self, bench: StateBench) -> None:
        trace: list[str] = []

        class Pausable(Traced):
            def on_pause(self) -> None:
                trace.append('pause')

            def on_resume(self, userdata: Any) -> None:
                trace.append('resume')

        def urgent() -> PriorityContainer:
            container = PriorityContainer(outcomes=['done', 'error'])
            with container:
                OperatableStateMachine.add('Now', WaitState(0.1), transitions={'done': 'done'})
            return container

        children: dict[str, Callable[[], Any]] = {
            'main': lambda: Pausable([], lambda *_: 'done' if 'resume' in trace else None),
            'side': urgent,
        }
        going = bench.run(
            lambda: self.container(
                children,
                [
                    ('done', [('main', 'done'), ('side', 'done')]),
                    ('error', [('main', 'error')]),
                    ('error', [('side', 'error')]),
                ],
            )
        )
        assert going.wait() == 'finished'
        assert trace == ['pause', 'resume']


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


def test_a_run_may_have_another_default_rate(bench: StateBench) -> None:
    rates: list[float | None] = []

    def work(state: Traced, userdata: Any) -> str:
        rates.append(state.desired_rate)
        return 'done'

    def build() -> OperatableStateMachine:
        if not rates:
            EventState.set_default_rate(40.0)
        return machine_of(
            ('A', lambda: Traced([], work), {}),
            ('B', lambda: Traced([], work, desired_rate=5.0), {}),
        )

    for _ in range(2):
        assert bench.run(build).wait() == 'finished'
    assert rates == [40.0, 5.0, 10.0, 5.0]


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
                ('Writes', lambda: Traced(trace, done, output_keys=['absent']), {}),  # or so it says
                ('subject', lambda: Traced(trace, work, input_keys=['absent']), {}),
            )
        )
        assert going.wait() == 'error'
        assert f'{error}: ' in going.errors()
        assert trace.count('subject.execute') == 1


class TestLogger:
    def test_lines_that_are_never_the_same_do_not_fill_the_memory(self) -> None:
        clock = ManualClock()
        run: Any = SimpleNamespace(services=SimpleNamespace(runtime=SimpleNamespace(steady=clock)))
        throttle = logger._Throttle(run)
        for number in range(3 * logger.MOST_THROTTLED):
            assert throttle.is_due(number, 60.0)
        assert not throttle.is_due(3 * logger.MOST_THROTTLED - 1, 60.0)
        assert len(throttle._said) == logger.MOST_THROTTLED

    def test_lines_name_the_state_and_keep_percent_signs(self, bench: StateBench) -> None:
        def work(state: Traced, userdata: Any) -> str:
            Logger.loginfo('100 % of %s')
            Logger.loginfo('100 %% of it')
            Logger.logwarn('%d of %s', 3, 'four')
            Logger.loghint('hint')
            Logger.logerr('error')
            Logger.logdebug('debug')
            Logger.log('reported', Logger.REPORT_WARN)
            Logger.error('alias')
            for _ in range(3):
                Logger.logwarn_throttle(60.0, 'once')
            Logger.localinfo('in the log of the node only')
            Logger.localwarn_throttle(60.0, 'as %s', 'this')
            return 'done'

        going, _ = run(bench, work)
        assert going.wait() == 'finished'
        assert going.lines == [
            (Severity.INFO.value, '/subject', '100 % of %s'),
            (Severity.INFO.value, '/subject', '100 % of it'),
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
        seen.append((state._pub, type(state._sub).__name__, state.clock.now() > 0))
        state.clock = state.services = None
        return 'done'

    going, _ = run(bench, work, output_keys=['x'])
    assert going.wait() == 'finished'
    assert seen == [
        ('subject', '/subject', ['done', 'error'], [], ['x']),
        True,
        True,
        ('my own', 'ProxySubscriberCached', True),
    ]


@pytest.mark.parametrize(
    'name', ['_host', 'activity', 'progress', 'halting', 'not_paused', 'clock', 'services', 'skill']
)
def test_a_state_may_have_attributes_of_names_that_flexbe_does_not_use(bench: StateBench, name: str) -> None:
    class Own(EventState):
        def __init__(self) -> None:
            super().__init__(outcomes=['done'])
            setattr(self, name, 0.5)

        def execute(self, userdata: Any) -> str | None:
            return 'done' if resumed else None

    resumed: list[None] = []
    going = bench.run_state(Own)
    wait_until(going.active, 'active')
    assert going.answer_to(pause) is None
    wait_until(lambda: [one.is_paused for one in going.active()] == [True], 'paused')
    resumed.append(None)
    assert going.answer_to(resume) is None
    assert (going.wait(), going.errors()) == ('done', '')


def test_a_state_finds_the_outcome_that_the_operator_forced(bench: StateBench) -> None:
    seen: list[str | None] = []

    class Leaving(Traced):
        def on_exit(self, userdata: Any) -> None:
            seen.append(self._manual_transition_requested)

    going = bench.run(lambda: machine_of(('subject', lambda: Leaving([], stay), {})))
    wait_until(going.active, 'active')
    going.force('/subject', 'error', '')
    assert going.wait() == 'failed'
    assert bench.run(lambda: machine_of(('subject', lambda: Leaving([], done), {}))).wait() == 'finished'
    assert seen == ['error', None]
