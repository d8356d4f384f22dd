# SPDX-License-Identifier: BSD-3-Clause
"""Machines with seeded defects: each is found, by a way that replays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from flexbt_core.monitors.properties import Property
from flexbt_core.monitors.requirement_text import parse_requirement
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_retry, with_timeout
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import StateDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_formal.exploration.explorer import ExplorationLimits, explore, replay
from flexbt_formal.exploration.machine_system import MachineBounds, MachineSystem, Operator
from flexbt_formal.exploration.model import EnvironmentChoices, Label, Report
from flexbt_formal.exploration.state_models import StateModel, StateModelKind, state_model

add = OperatableStateMachine.add


class Work(EventState):
    """What it does is up to the environment; what it has begun has to be canceled."""

    def __init__(self, reads: str = '', writes: str = '') -> None:
        super().__init__(['done', 'failed'], reads.split(), writes.split(), desired_rate=None)

    def halting(self) -> str | None:
        return None


class Decide(EventState):
    def __init__(self) -> None:
        super().__init__(['again', 'enough'], desired_rate=None)


class Think(EventState):
    is_instant = True

    def __init__(self) -> None:
        super().__init__(['done'], desired_rate=None)


class Count(EventState):
    is_instant = True

    def __init__(self) -> None:
        super().__init__(['more', 'none'], desired_rate=None)


def models(definition: StateDefinition) -> StateModel:
    state = definition.state.unwrapped
    if isinstance(state, Decide):
        return StateModel(StateModelKind.DECISION)
    drives = frozenset(('cmd_vel',)) if 'Drive' in definition.label else frozenset[str]()
    found = state_model(definition)
    return StateModel(found.kind, None, drives, found.ends_later, found.not_written)


def mission(
    *, goes_on: str = 'Drive', after_failure: str = 'Recover', loops: bool = False, keep_planning: bool = True
) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        add('Plan', Work(writes='path'), {'done': goes_on, 'failed': after_failure}, {'failed': Autonomy.Full})
        drive = with_retry(with_timeout(Work(reads='path'), 5.0), 2)
        add('Drive', drive, {'done': 'Ask', 'failed': 'Recover', 'timeout': 'Recover'})
        add('Recover', Work(), {'done': 'Think', 'failed': 'failed'})
        add('Ask', Decide(), {'again': 'Plan' if keep_planning else 'Drive', 'enough': 'finished'})
        add('Think', Think(), {'done': 'Think' if loops else 'Plan'})
    return machine


def both_drive() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        both = ConcurrencyContainer(
            outcomes=['done', 'failed'],
            conditions=[
                ('done', [('Drive', 'done'), ('DriveToo', 'done')]),
                ('failed', [('Drive', 'failed')]),
                ('failed', [('DriveToo', 'failed')]),
            ],
        )
        with both:
            add('Drive', Work(), {'done': 'done', 'failed': 'failed'})
            add('DriveToo', Work(), {'done': 'done', 'failed': 'failed'})
        add('Both', both, {'done': 'finished', 'failed': 'failed'})
    return machine


def proved(
    make: Callable[[], OperatableStateMachine], bounds: MachineBounds | None = None
) -> tuple[Report, Callable[[], MachineSystem]]:
    definition = define(make())

    def system() -> MachineSystem:
        return MachineSystem(definition, models, bounds)

    return explore(system, 'mission', limits=ExplorationLimits(seconds=600)), system


@pytest.mark.parametrize(
    'bounds',
    [
        MachineBounds(),
        MachineBounds(Operator.ALL, forces=1, faults=0, autonomy=Autonomy.Full),
    ],
    ids=['answers', 'forces'],
)
def test_a_sound_mission_is_followed_to_its_end(bounds: MachineBounds) -> None:
    machine = mission()
    machine.userdata.path = 'given'  # so that forcing an outcome leaves nothing unwritten
    report, _ = proved(lambda: machine, bounds)
    assert report.is_complete and report.holds, report.counterexamples
    assert {'finished', 'failed', 'preempted'} <= set(report.ends)
    assert report.uncovered == ()


def both_write() -> OperatableStateMachine:
    """Two plans for one path, side by side."""
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        both = ConcurrencyContainer(
            outcomes=['done', 'failed'],
            output_keys=['path'],
            conditions=[
                ('done', [('One', 'done'), ('Other', 'done')]),
                ('failed', [('One', 'failed')]),
                ('failed', [('Other', 'failed')]),
            ],
        )
        with both:
            add('One', Work(writes='path'))
            other = OperatableStateMachine(outcomes=['done', 'failed'], output_keys=['way'])
            with other:
                add('Look', Work(), {'done': 'Plan', 'failed': 'failed'})
                add('Plan', Work(writes='way'), {'done': 'done', 'failed': 'failed'})
            add('Other', other, remapping={'way': 'path'})
        add('Both', both, {'done': 'Drive', 'failed': 'failed'})
        add('Drive', Work(reads='path'), {'done': 'finished', 'failed': 'failed'})
    return machine


DEFECTS: dict[str, tuple[Callable[[], OperatableStateMachine], Property]] = {
    'wrong target': (lambda: mission(after_failure='Drive'), Property.DATA),
    'instant loop': (lambda: mission(loops=True), Property.NO_LIVELOCK),
    'two owners': (both_drive, Property.ONE_OWNER),
    'two writers': (both_write, Property.ONE_WRITER),
}


@pytest.mark.parametrize(('make', 'kind'), DEFECTS.values(), ids=DEFECTS.keys())
def test_a_defect_is_found_and_replays(make: Callable[[], OperatableStateMachine], kind: Property) -> None:
    report, system = proved(make)
    assert kind in {found.violation.property for found in report.counterexamples}
    found = next(found for found in report.counterexamples if found.violation.property is kind)
    assert found.violation in replay(system, found.moves)
    assert not replay(system, found.moves[:-1])


def test_a_trap_is_found() -> None:
    def trap() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            add('Choose', Work(), {'done': 'finished', 'failed': 'One'})
            add('One', Work(), {'done': 'Other', 'failed': 'Other'})
            add('Other', Work(), {'done': 'One', 'failed': 'One'})
        return machine

    report, _ = proved(trap)
    (found,) = report.counterexamples
    assert found.violation.property is Property.CAN_END and '/One' in found.violation.where


def test_a_command_that_is_ignored_does_not_keep_a_stop_from_its_end() -> None:
    report, _ = proved(mission, MachineBounds(faults=2))
    assert 'error' in report.ends  # the run says that it could not stop everything
    assert Property.STOP_STOPS not in {found.violation.property for found in report.counterexamples}


REQUIRED: list[tuple[str, str]] = [
    ('never /Recover > failed', 'REQUIREMENT'),
    ('/Drive only after /Plan > done', ''),
    ('/Drive only after /Plan > done, each time anew', ''),
    ('after /Plan > failed comes /Drive', 'REQUIREMENT'),
    ('after /Plan > done, /Ask > enough before the end', 'REQUIREMENT'),
    ('after /Plan > done, /Drive within 1 s', ''),
    # The drive has 5 s, and two more attempts.
    ('after /Drive, /Drive > timeout within 16 s', 'REQUIREMENT'),
    ('/Recover at most 1 time', 'REQUIREMENT'),
    ('=finished is always still possible', ''),
    ('/Recover > done is always still possible', ''),
    ('=finished only with path written', ''),
    ('=finished only with report written', 'REQUIREMENT'),
]


@pytest.mark.parametrize(('text', 'kind'), REQUIRED)
def test_what_the_mission_requires_is_proved_or_shown_not_to_hold(text: str, kind: str) -> None:
    machine = mission()
    machine.userdata.report = ''
    definition = define(machine)
    required = parse_requirement(text, 'test').requirement

    def system() -> MachineSystem:
        return MachineSystem(definition, models, requirements=[required])

    report = explore(system, 'mission', limits=ExplorationLimits(seconds=600))
    assert [found.violation.property.name for found in report.counterexamples] == ([kind] if kind else [])
    for found in report.counterexamples:
        assert text in found.violation.text
        if found.violation.property.is_shown_by_a_way:
            assert found.violation in replay(system, found.moves)


def test_what_a_mission_is_made_of_is_looked_at_as_it_begins() -> None:
    right = ['/Plan is a Work', '/Plan has path={path}', '/Plan > failed has autonomy=Full']
    wrong = ['/Plan is a Decide', '/Plan has path={plan}', '/Plan > done has autonomy=Full']
    required = [parse_requirement(text, 'test').requirement for text in [*right, *wrong]]
    system = MachineSystem(define(mission()), models, requirements=required)
    found = [one.text.partition('; required is: ') for one in system.step(Label('start'), EnvironmentChoices(()))]
    assert [is_required for _, _, is_required in found] == wrong
    assert [text for text, _, _ in found] == [
        '/Plan is a Work',
        "/Plan has path='{path}'",
        '/Plan > done is given no autonomy',
    ]


def test_what_is_lost_on_the_way_is_shown_where_it_is() -> None:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        add('Fetch', Work(), {'done': 'Bring', 'failed': 'failed'})
        add('Bring', Work(), {'done': 'finished', 'failed': 'failed'})
    definition, required = define(machine), parse_requirement('/Fetch > done is always still possible', 'test')
    report = explore(lambda: MachineSystem(definition, models, requirements=[required.requirement]), 'mission')
    (found,) = report.counterexamples
    assert found.violation.property is Property.POSSIBLE and found.violation.where == 'active: /Bring'
    assert [move.label.value for move in found.moves] == ['', 'done']


def test_a_stop_that_ends_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MachineRun, '_finish', lambda self, outcome, message: None)
    properties = {found.violation.property for found in proved(mission)[0].counterexamples}
    assert Property.RECOVERY in properties


class Hold(Work):
    """What it has begun can be canceled at once, and is."""

    halting = EventState.halting


def side_by_side(left: EventState, right: EventState, after: EventState | None = None) -> OperatableStateMachine:
    """Two regions; ``after`` follows the right one. Either ends both."""
    machine = OperatableStateMachine(outcomes=['finished', 'left'])
    with machine:
        second = OperatableStateMachine(outcomes=['over'])
        with second:
            follows = dict.fromkeys(right.outcomes, 'over' if after is None else 'After')
            add('First', right, follows)
            if after is not None:
                add('After', after, dict.fromkeys(after.outcomes, 'over'))
        both = ConcurrencyContainer(
            outcomes=['left', 'over'],
            conditions=[*(('left', [('Left', outcome)]) for outcome in left.outcomes), ('over', [('Right', 'over')])],
        )
        with both:
            add('Left', left, dict.fromkeys(left.outcomes, 'left'))
            add('Right', second, {'over': 'over'})
        add('Both', both, {'left': 'left', 'over': 'finished'})
    return machine


def test_what_takes_its_time_leaves_less_of_it_to_what_follows() -> None:
    limits = with_timeout(Hold(), 10.0), with_timeout(Hold(), 8.0)
    definition = define(side_by_side(limits[0], Hold(), limits[1]))
    required = parse_requirement('after /Both/Right/After, =finished before the end', 'test').requirement
    bounds = MachineBounds(stops=False)

    def only_work(state: StateDefinition) -> StateModel:
        return replace(state_model(state), outcomes=('done',) if 'First' in state.path else ())

    def system() -> MachineSystem:
        return MachineSystem(definition, only_work, bounds, [required])

    (found,) = explore(system, 'mission').counterexamples
    assert found.violation in replay(system, found.moves)


def test_while_a_cancel_is_awaited_the_time_of_something_else_may_be_over() -> None:
    """That is no fault: the cancel is confirmed in time."""
    definition = define(side_by_side(with_timeout(Hold(), 4.0), with_timeout(Work(), 3.0)))
    required = parse_requirement('never =left', 'test').requirement

    def system() -> MachineSystem:
        bounds = MachineBounds(faults=0, stops=False)
        return MachineSystem(definition, lambda state: replace(state_model(state), outcomes=()), bounds, [required])

    (found,) = explore(system, 'mission').counterexamples
    assert found.violation in replay(system, found.moves)


def test_what_is_entered_again_within_a_step_may_end_otherwise() -> None:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        add('First', Count(), {'more': 'First', 'none': 'finished'})
    definition, required = define(machine), parse_requirement('after /First > more, =failed before the end', 'test')

    def system() -> MachineSystem:
        return MachineSystem(definition, state_model, requirements=[required.requirement])

    found = explore(system, 'mission').counterexamples
    assert {one.violation.property for one in found} == {Property.NO_LIVELOCK, Property.REQUIREMENT}
    assert all(one.violation in replay(system, one.moves) for one in found)
