# SPDX-License-Identifier: BSD-3-Clause
"""Trees with seeded defects: each is found, by a way that replays; those without are followed to their end."""

from __future__ import annotations

import gc
import inspect
import weakref
from collections.abc import Iterable
from dataclasses import dataclass

import pytest

from flexbt_core.behavior_tree.engine.leaf import Condition, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import Control, Decorator
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.ports import DOUBLE, STRING, UINT16, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2 import controls, decorators
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.monitors.properties import Property
from flexbt_core.monitors.requirement_text import parse_requirement
from flexbt_core.skills.literals import Predicate
from flexbt_core.skills.skill import Skill
from flexbt_formal.exploration.explorer import ExplorationLimits, explore, replay
from flexbt_formal.exploration.model import EnvironmentChoices, Label, Report
from flexbt_formal.exploration.tree_system import TIMED, TreeSystem
from flexbt_testing.seeded_missions import Plan, StandIn, Turn


class Drive(StandIn):
    skill = Skill.of(resources=['base'])
    ports = {'path': input_port(STRING, optional=True)}


class Ask(StandIn):
    skill = Skill.of(ignores_cancel=True)


class AskSoon(Ask):
    answers_soon = True


class Follow(StandIn):
    ports = {'path': input_port(STRING)}


class IsSafe(Condition):
    def tick(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')


OPEN = Predicate('open', {'door': 'door'})


class DistanceController(decorators.DistanceController):
    def position(self) -> None:
        raise AssertionError('a proof runs no real decorator')


class IsKnown(IsSafe):
    ports = {'path': input_port(STRING, optional=True)}


class IsPathValid(IsKnown):
    pass


class IsOpen(IsSafe):
    skill = Skill.measuring(OPEN)
    ports = {'door': input_port(STRING)}


class Enter(StandIn):
    """Needs an open door, and leaves it closed."""

    skill = Skill.of(
        parameters={'which': 'door'},
        preconditions=['open(which)'],
        outcomes={'SUCCESS': ['not open(which)']},
        arguments={'door': '$which'},
        predicates=[OPEN],
    )
    ports = {'door': input_port(STRING)}


AT = Predicate('at', {'goal': 'pose'}, exclusive='goal')
GOAL = {'goal': input_port(STRING)}


class IsAt(IsSafe):
    skill = Skill.measuring(AT)
    ports = {**GOAL, 'tolerance': input_port(DOUBLE, default='0.5')}


class Go(StandIn):
    skill = Skill.of(parameters=AT.parameters, outcomes={'SUCCESS': ['at(goal)']}, predicates=[AT])
    ports = GOAL


class Serve(StandIn):
    skill = Skill.of(parameters=AT.parameters, preconditions=['at(goal)'], predicates=[AT])
    ports = GOAL


class Leave(Go):
    skill = Skill.of(parameters=AT.parameters, outcomes={'SUCCESS': ['not at(goal)']}, predicates=[AT])


class Lift(StandIn):
    skill = Skill.of(deadline=10.0)


class Dock(StandIn):
    ports = {'error_code_id': output_port(UINT16)}


class Choose(StandIn):
    ports = {'door': output_port(STRING)}


class Measure(StandIn):
    ports = {
        'level': output_port(DOUBLE),
        'other': output_port(DOUBLE),
        'third': output_port(DOUBLE),
        'count': output_port(UINT16),
        'kind': output_port(STRING),
        'mode': output_port(STRING),
    }


class Look(StandIn):
    """Tells things of no type."""

    ports = {'level': output_port(), 'other': output_port(), 'kind': output_port()}


class PauseResumeController(controls.PauseResumeController):
    """Has its services from its host, which a proof has not."""


class Forgetful(Control):
    """Ticks its children by turns, and forgets to halt the one before."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._next = 0

    def tick(self) -> NodeStatus:
        status = self.tick_child(self._next % len(self.children))
        self._next = (self._next + 1) % len(self.children)
        return status


class Take(SyncAction):
    """Takes the next thing of a list, within a tick; fails when there is none left."""

    left = 1

    def tick(self) -> NodeStatus:
        self.left -= 1
        return NodeStatus.SUCCESS if self.left >= 0 else NodeStatus.FAILURE


class Turns:
    """What a node keeps in an object of its own."""

    def __init__(self) -> None:
        self.number = 0


class Alternating(Control):
    """One child after the other, and after the last the first; ends with the fifth."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._turns = Turns()

    def tick(self) -> NodeStatus:
        status = self.tick_child(self._turns.number % len(self.children))
        if status is NodeStatus.RUNNING:
            return status
        self.halt_child(self._turns.number % len(self.children))
        self._turns.number += 1
        if self._turns.number < 5:
            self.wake()
            return NodeStatus.RUNNING
        self._turns.number = 0
        return status

    def on_halt(self) -> None:
        self._turns.number = 0


@dataclass(frozen=True)
class Laps:
    """What a node keeps in an object that it replaces by another one."""

    number: int = 0


class ThreeTimes(Decorator):
    """Does it three times, whatever comes of it, and keeps them by a name that nodes of the engine use, too."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._seen = Laps()

    def tick(self) -> NodeStatus:
        status = self.tick_child()
        if status is NodeStatus.RUNNING:
            return status
        self.halt_child()
        self._seen = Laps((self._seen.number + 1) % 3)
        if self._seen.number:
            self.wake()
            return NodeStatus.RUNNING
        return status

    def on_halt(self) -> None:
        self._seen = Laps()


class Stalled(Control):
    """RUNNING, with nothing that would ever wake it."""

    def tick(self) -> NodeStatus:
        return NodeStatus.RUNNING


def registry() -> NodeRegistry:
    found = builtin_registry()
    register_nav2(found)
    leaves = (Drive, Ask, Turn, Plan, Follow, IsSafe, IsOpen, Enter, Dock, Choose, Lift, IsAt, Go, Serve, Leave, Look)
    own = (AskSoon, Take, PauseResumeController, Forgetful, Stalled, Alternating, ThreeTimes)
    found.register_classes([*leaves, *own, DistanceController, IsKnown, IsPathValid, Measure])
    return found


def library_of(body: str) -> TreeLibrary:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return TreeLibrary([load_xml(text, 'main.xml', registry())])


def system(body: str, *required: str, given: Iterable[str] = ()) -> TreeSystem:
    requirements = [parse_requirement(text, 'test').requirement for text in required]
    return TreeSystem(library_of(body), TreeKey('main.xml', 'Main'), requirements=requirements, given=given)


def proved(body: str, *given: str) -> Report:
    return explore(lambda: system(body, given=given), 'Main', limits=ExplorationLimits(seconds=600))


SOUND = """
<Sequence>
  <RetryUntilSuccessful num_attempts="3"><Plan path="{path}"/></RetryUntilSuccessful>
  <ReactiveSequence><IsSafe/><Timeout msec="5000"><Drive path="{path}"/></Timeout></ReactiveSequence>
  <Delay delay_msec="10"><Turn/></Delay>
</Sequence>
"""

DEFECTS = {
    'read before it is written': (
        '<Sequence><Fallback><Plan path="{path}"/><AlwaysSuccess/></Fallback><Follow path="{path}"/></Sequence>',
        Property.DATA,
    ),
    'two owners': (
        '<Parallel success_count="2"><Drive/><Sequence><Plan/><Turn/></Sequence></Parallel>',
        Property.ONE_OWNER,
    ),
    'two writers': (
        '<Sequence><Parallel success_count="2"><Plan path="{path}"/><Plan path="{path}"/></Parallel>'
        '<Follow path="{path}"/></Sequence>',
        Property.ONE_WRITER,
    ),
    'not halted': ('<Forgetful><Plan/><Plan/></Forgetful>', Property.HALTED),
    'wakes itself': (
        '<RetryUntilSuccessful num_attempts="-1"><IsSafe/></RetryUntilSuccessful>',
        Property.NO_LIVELOCK,
    ),
    'no time goes by': (
        '<RetryUntilSuccessful num_attempts="-1"><Delay delay_msec="0"><IsSafe/></Delay></RetryUntilSuccessful>',
        Property.NO_LIVELOCK,
    ),
    'inverted condition': (
        '<Sequence><Inverter><IsOpen door="front"/></Inverter><Enter door="front"/></Sequence>',
        Property.PRECONDITION,
    ),
    'needs what was undone': (
        '<Sequence><Enter door="front"/><Enter door="back"/><Enter door="front"/></Sequence>',
        Property.PRECONDITION,
    ),
    'needs to be elsewhere': ('<Sequence><Go goal="home"/><Serve goal="dock"/></Sequence>', Property.PRECONDITION),
    'is told that it is not there': (
        '<Sequence><Inverter><IsAt goal="dock" tolerance="0.50"/></Inverter><Serve goal="dock"/></Sequence>',
        Property.PRECONDITION,
    ),
    'is told to be elsewhere': ('<Sequence><IsAt goal="home"/><Serve goal="dock"/></Sequence>', Property.PRECONDITION),
    'begun once what is to be begun again': (
        '<Sequence><RateController hz="1.0"><Plan/></RateController><Drive/></Sequence>',
        Property.LIMITS,
    ),
    'not given up': ('<Timeout msec="10001"><Lift/></Timeout>', Property.DEADLINE),
    'lost wake-up': (
        '<Sequence><Drive/><Stalled><Turn/></Stalled></Sequence>',
        Property.NO_DEADLOCK,
    ),
    'dead node': ('<Sequence><Fallback><AlwaysSuccess/><Drive/></Fallback><Plan/></Sequence>', Property.REACHABLE),
    'cannot end': (
        '<Sequence><Drive/><Inverter><KeepRunningUntilFailure><Delay delay_msec="5"><AlwaysSuccess/></Delay>'
        '</KeepRunningUntilFailure></Inverter></Sequence>',
        Property.CAN_END,
    ),
}


def test_a_sound_tree_is_followed_to_its_end() -> None:
    report = proved(SOUND)
    assert report.is_complete and report.holds, report.counterexamples
    assert set(report.ends) == {'SUCCESS', 'FAILURE', 'stopped'}
    assert report.uncovered == ()


@pytest.mark.parametrize(('body', 'kind'), DEFECTS.values(), ids=DEFECTS.keys())
def test_a_defect_is_found_and_replays(body: str, kind: Property, caplog: pytest.LogCaptureFixture) -> None:
    report = proved(body)
    assert {found.violation.property for found in report.counterexamples} == {kind}
    found = report.counterexamples[0]
    if kind.is_shown_by_a_way:  # the others are about what does not follow
        assert found.violation in replay(lambda: system(body), found.moves)
        assert not replay(lambda: system(body), found.moves[:-1])
    assert not caplog.records, 'the report tells it all'


NOTHING = 'and there is nothing by that key: it was never written, or has been removed'


@pytest.mark.parametrize(
    ('body', 'kind', 'text'),
    [
        ('<SetBlackboard value="{no}" output_key="to"/>', Property.DATA, f'reads {{no}} by its port value, {NOTHING}'),
        (
            '<LoopString queue="{no}" value="{it}"><Turn/></LoopString>',
            Property.DATA,
            f'reads {{no}} by its port queue, {NOTHING}',
        ),
        (
            '<Repeat num_cycles="{no}"><Turn/></Repeat>',
            Property.DATA,
            f'reads {{no}} by its port num_cycles, {NOTHING}',
        ),
        ('<Script code="x := no + 1"/>', Property.DATA, 'the blackboard has no entry [no]'),
        ('<Script code="x := y := (1..2)"/>', Property.DATA, 'an entry that was never written'),
        ('<Turn _skipIf="no == 1"/>', Property.DATA, '_skipIf: the blackboard has no entry [no]'),
        ('<Script code="x := \'text\' - 1"/>', Property.NO_FAULT, 'operator [-] does not apply to the text'),
    ],
)
def test_what_is_absent_is_told_alike_by_ports_and_scripts_and_what_does_not_fit_is_a_fault(
    body: str, kind: Property, text: str
) -> None:
    report = proved(f'<Sequence><UnsetBlackboard key="no"/>{body}</Sequence>')
    (violation,) = {found.violation for found in report.counterexamples}
    assert (violation.property, text in violation.text) == (kind, True), violation


def test_what_a_skill_needs_may_be_what_nobody_has_looked_at_or_what_has_changed() -> None:
    sound = (
        '<Enter door="front"/>',
        '<Sequence><Timeout msec="10000"><Lift/></Timeout><Timeout msec="60000"><Turn/></Timeout></Sequence>',
        '<Sequence><IsOpen door="front"/><Enter door="front"/></Sequence>',
        '<Sequence><Inverter><IsOpen door="back"/></Inverter><Enter door="front"/></Sequence>',
        '<Sequence><Inverter><IsOpen door="front"/></Inverter><Turn/><Enter door="front"/></Sequence>',
        '<Sequence><Enter door="front"/><IsOpen door="front"/><Enter door="front"/></Sequence>',
        '<Sequence><Choose door="{it}"/><Enter door="{it}"/><Choose door="{it}"/><Enter door="{it}"/></Sequence>',
        '<LoopString queue="front;back" value="{it}"><Enter door="{it}"/></LoopString>',
        '<Sequence><Choose door="{it}"/><Repeat num_cycles="2"><Sequence><Enter door="{it}"/>'
        '<Script code="it := &apos;back&apos;"/></Sequence></Repeat></Sequence>',
        '<Sequence><Enter door="front"/><Turn/><Enter door="front"/></Sequence>',  # who knows what it does
        '<Sequence><IsAt goal="home"/><Turn/><Serve goal="dock"/></Sequence>',
        '<Sequence><Inverter><IsAt goal="dock" tolerance="0.1"/></Inverter><Serve goal="dock"/></Sequence>',
        '<Sequence><Go goal="{a}"/><Serve goal="{b}"/></Sequence>',  # of the same value, maybe
        '<Sequence><Leave goal="dock"/><Go goal="{a}"/><Serve goal="dock"/></Sequence>',
        '<Sequence><Leave goal="dock"/><ForceSuccess><Go goal="dock"/></ForceSuccess><Serve goal="dock"/></Sequence>',
    )
    for body in sound:
        assert proved(body).holds, body
    same = '<Sequence><Choose door="{it}"/><Enter door="{it}"/><Enter door="{it}"/></Sequence>'
    (found,) = proved(same).counterexamples
    assert found.violation.text == (
        'Enter::4 begins, and its skill needs open(it): Enter::3 has brought about not open(it)'
    )


def test_a_limit_that_is_asked_again_makes_a_difference() -> None:
    again = '<PipelineSequence><RateController hz="1.0"><Plan/></RateController><Drive/></PipelineSequence>'
    assert proved(again).holds


@pytest.mark.parametrize('body', ['<Drive name="drive"/>', '<Timeout msec="9001"><Drive name="drive"/></Timeout>'])
def test_what_is_required_in_time_is_missed_when_nothing_else_waits_for_a_time(body: str) -> None:
    required = 'after drive, drive > halted within 9 s'
    (found,) = explore(lambda: system(body, required), 'Main', limits=ExplorationLimits(seconds=600)).counterexamples
    assert found.violation.text.startswith('drive > halted has not come 9 s after drive')
    in_time = '<Sequence><Timeout msec="9000"><Inverter><Drive name="drive"/></Inverter></Timeout></Sequence>'
    assert not replay(lambda: system(in_time, required), found.moves)


SECOND = 'after second, second > SUCCESS before the end'


@pytest.mark.parametrize('times', ['b == 1 ? 3000 : 5000', 'b == 1 ? 5000 : 3000'])
def test_what_began_later_is_due_later(times: str) -> None:
    """Both ways lead to the same nodes, with one timer ahead; only one of them leaves enough time for the second."""
    first = f'<Script code="t := {times}"/><Delay delay_msec="{{t}}"><AlwaysSuccess/></Delay>'
    then = '<Script code="t := 0; b := 0"/><Turn/><Sleep name="second" msec="6000"/>'
    body = f'<Parallel success_count="1"><Sleep msec="10000"/><Sequence>{first}{then}</Sequence></Parallel>'
    report = explore(lambda: system(body, SECOND, given=['b']), 'Main')
    (found,) = report.counterexamples
    assert found.violation in replay(lambda: system(body, SECOND, given=['b']), found.moves)


def test_what_takes_its_time_leaves_less_of_it_to_what_follows() -> None:
    body = '<Timeout msec="{}"><Sequence><Turn/><Sleep name="second" msec="8000"/></Sequence></Timeout>'
    (found,) = explore(lambda: system(body.format(10_000), SECOND), 'Main').counterexamples
    assert 'time goes by, and nothing is due yet' in [str(move.label) for move in found.moves]
    assert found.violation in replay(lambda: system(body.format(10_000), SECOND), found.moves)
    assert explore(lambda: system(body.format(0), SECOND), 'Main').is_proof


def test_the_nodes_that_wait_for_a_time_are_known() -> None:
    for manifest in registry():
        engine = [one for one in manifest.node_class.__mro__ if '.behavior_tree.nodes.' in one.__module__]
        has_model = (
            manifest.kind in (NodeKind.ACTION, NodeKind.CONDITION) and '.nav2.' in manifest.node_class.__module__
        )
        if not has_model and any('wake_at' in inspect.getsource(one) for one in engine):
            assert issubclass(manifest.node_class, TIMED)


def test_nodes_of_one_name_are_told_apart() -> None:
    """Two conditions need not hold at once, two actions each get a result, and neither hides that the other is dead."""
    asked = (
        '<Sequence><IsSafe name="ok"/><Inverter><IsOpen name="ok" door="a"/></Inverter><Drive name="go"/></Sequence>'
    )
    report = explore(lambda: system(f'<Fallback>{asked}<Turn/></Fallback>', 'never go'), 'Main')
    assert [found.violation.property for found in report.counterexamples] == [Property.REQUIREMENT]
    both = '<Parallel success_count="2" failure_count="2"><Plan name="it"/><Ask name="it"/></Parallel>'
    assert proved(both).is_proof
    (dead,) = proved(
        '<Sequence><Turn name="it"/><Fallback><AlwaysSuccess/><Turn name="it"/></Fallback></Sequence>'
    ).uncovered
    assert dead == 'it::5'


def test_what_is_done_again_within_a_tick_may_end_otherwise() -> None:
    body = '<Repeat num_cycles="2"><Take name="take"/></Repeat>'
    assert Tree(library_of(body), 'Main').tick_once() is NodeStatus.FAILURE
    required = 'after take > SUCCESS, =SUCCESS before the end'
    (found,) = explore(lambda: system(body, required), 'Main').counterexamples
    assert found.violation in replay(lambda: system(body, required), found.moves)


def test_the_third_of_three_attempts_within_a_tick_may_succeed() -> None:
    attempt = '<Sequence><Script code="n += 1"/><Take/></Sequence>'
    report = proved(
        '<Sequence><Script code="n := 0"/>'
        f'<RetryUntilSuccessful num_attempts="3">{attempt}</RetryUntilSuccessful>'
        '<ForceSuccess><Sequence><ScriptCondition code="n == 3"/><Turn/></Sequence></ForceSuccess></Sequence>'
    )
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_a_node_that_can_be_paused_is_asked_by_the_services_that_it_names() -> None:
    children = '<Turn name="work"/><Plan name="rest"/><Turn name="stop"/><Turn name="go_on"/>'
    both = 'pause_service_name="pause" resume_service_name="resume"'
    report = proved(f'<PauseResumeController {both}>{children}</PauseResumeController>')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples
    unpaused = proved(f'<PauseResumeController>{children}</PauseResumeController>')
    assert unpaused.uncovered == ('go_on', 'rest', 'stop')


def test_what_never_changes_is_no_part_of_what_is_kept() -> None:
    def size(body: str) -> tuple[int, int]:
        tree = system(body)
        tree.step(Label('start'), EnvironmentChoices())
        return len(tree.capture().parts), len(tree.tree.nodes)

    (parts, nodes), (more_parts, more_nodes) = size(SOUND), size(f'<Sequence>{SOUND * 5}</Sequence>')
    assert more_parts - parts < 1.5 * (more_nodes - nodes)


def test_restored_configurations_are_what_the_steps_lead_to() -> None:
    report = proved(f'<Repeat num_cycles="2">{SOUND}</Repeat>')
    assert report.is_complete and report.holds
    assert report.checked_restores > 0  # each would raise


def test_what_nodes_of_ones_own_keep_is_restored() -> None:
    report = proved('<Repeat num_cycles="2"><Alternating><Plan/><Turn/></Alternating></Repeat>')
    assert report.is_complete and report.holds, report.counterexamples
    assert report.configurations > 10 and report.checked_restores > 0
    assert report.depth == 11  # the start, and five results in each cycle
    replaced = proved('<ThreeTimes><Plan/></ThreeTimes>')
    assert replaced.is_complete and replaced.holds, replaced.counterexamples
    assert replaced.depth == 4  # the start, and three results


def test_counters_without_a_limit_are_one_situation() -> None:
    report = proved(
        '<RetryUntilSuccessful num_attempts="-1"><Delay delay_msec="10"><IsSafe/></Delay></RetryUntilSuccessful>'
    )
    assert report.is_complete and report.configurations < 10


def test_a_number_of_cycles_that_the_tree_writes_itself_is_kept_to() -> None:
    report = proved('<Sequence><Turn/><Script code="n := 3"/><Repeat num_cycles="{n}"><Turn/></Repeat></Sequence>')
    assert report.is_complete and report.holds, report.counterexamples
    assert report.depth == 5  # the start, and the results of four turns


def test_a_limit_that_comes_later_applies_to_what_was_counted_before() -> None:
    """The Repeat has enough, and leaves what it has just begun."""
    repeated = '<Repeat num_cycles="{n}"><Turn/></Repeat>'
    both = f'<Parallel success_count="2">{repeated}<Sequence><Plan/><Script code="n := 2"/></Sequence></Parallel>'
    report = proved(f'<Sequence><Script code="n := -1"/>{both}</Sequence>')
    assert report.is_complete
    assert {found.violation.property for found in report.counterexamples} == {Property.HALTED}


FOR_EVER = (
    '<RetryUntilSuccessful num_attempts="-1"><Sequence><Plan path="{p}"/><Drive/></Sequence></RetryUntilSuccessful>'
)


def test_what_goes_on_for_ever_without_a_server_is_found() -> None:
    report = proved(FOR_EVER)
    assert {found.violation.property for found in report.counterexamples} == {Property.CAN_END}
    assert [found.violation.where for found in report.counterexamples] == ['Drive', 'Plan']
    assert 'when the server of Drive is gone for good' in report.counterexamples[0].violation.text


def test_a_server_that_is_gone_is_no_fault_where_it_is_given_up() -> None:
    assert proved(FOR_EVER.replace('-1', '3')).holds
    another = f'<ReactiveFallback><IsSafe/>{FOR_EVER}</ReactiveFallback>'
    assert proved(another).holds


def test_that_an_answer_is_waited_for_without_limit_is_told() -> None:
    unlimited = [note for note in proved(SOUND).notes if 'no time limit' in note]
    assert unlimited == ['no time limit: if one of these never answers, only a stop ends it: Plan, Turn']


@pytest.mark.parametrize(('name', 'is_confirmed'), [('Drive', True), ('Ask', False)])
def test_a_tree_does_not_wait_for_what_ignores_a_cancel(name: str, is_confirmed: bool) -> None:
    tree = system(f'<Sequence><ReactiveFallback><IsSafe/><{name}/></ReactiveFallback><Plan/></Sequence>')
    tree.step(Label('start'), EnvironmentChoices((1,)))
    tree.step(Label('tick'), EnvironmentChoices((0,)))
    kinds = {label.kind for label in tree.labels()}
    assert ('cancel confirmed' in kinds) is is_confirmed
    assert ('result' in kinds) is not is_confirmed  # Plan has begun


GO = '<Go name="go" goal="x"/>'
ATTEMPTS = (
    f'<Fallback><RetryUntilSuccessful num_attempts="{{}}">{GO}</RetryUntilSuccessful><Ask name="ask"/></Fallback>'
)
TWO = '<Sequence><Go goal="{{{}}}"/><Drive name="drive" path="{{{}}}"/></Sequence>'
RATE = f'<PipelineSequence><RateController hz="{{}}">{GO}</RateController><Drive/></PipelineSequence>'


@pytest.mark.parametrize(
    ('right', 'wrong', 'required', 'why'),
    [
        (ATTEMPTS.format(3), ATTEMPTS.format(2), 'ask only after go > FAILURE, 3 times', 'has come 2 times only'),
        (
            ATTEMPTS.format(3),
            ATTEMPTS.format(2),
            'after go > FAILURE, go before the end, up to 3 times',
            'it ends, and go has not come after go > FAILURE',
        ),
        (RATE.format(2), RATE.format(10), 'go at most 1 time in 500 ms', 'go happens more than once in 0.5 s'),
        (TWO.format('a', 'b'), TWO.format('a', 'a'), 'drive has path={b}', "drive has path='{a}'; required is"),
        (GO, '<Serve name="go" goal="x"/>', 'go is a Go', 'go is a Serve; required is: go is a Go'),
        (GO, '<Go name="go" goal="y"/>', 'go has goal=x', "go has goal='y'; required is: go has goal=x"),
        (
            '<Sequence><Ask/><Go goal="x"/></Sequence>',
            '<Sequence><Go goal="x"/><Ask/></Sequence>',
            'Go only after Ask > SUCCESS',
            'Go comes without Ask > SUCCESS',
        ),
    ],
    ids=['attempts before', 'attempts', 'rate', 'key', 'type', 'text', 'without names'],
)
def test_what_is_not_as_it_is_required_is_found(right: str, wrong: str, required: str, why: str) -> None:
    limits = ExplorationLimits(seconds=600)
    report = explore(lambda: system(right, required), 'Main', limits=limits)
    assert report.is_proof, report.counterexamples
    (found,) = explore(lambda: system(wrong, required), 'Main', limits=limits).counterexamples
    assert why in found.violation.text
    assert replay(lambda: system(wrong, required), found.moves) and not replay(
        lambda: system(right, required), found.moves
    )


def test_what_is_wrong_in_many_places_is_counted_by_places() -> None:
    perhaps = '<Fallback><Choose door="{path}"/><AlwaysSuccess/></Fallback><Fallback><Drive/><Turn/></Fallback>'
    places = (f'<IsOpen door="{number}"/><Follow name="{number}" path="{{path}}"/>' for number in range(5))
    reads = ''.join(f'<Sequence>{place}</Sequence>' for place in places)
    report = proved(f'<Sequence>{perhaps}<Fallback>{reads}</Fallback></Sequence>')
    assert {found.violation.property for found in report.counterexamples} == {Property.DATA}
    assert len(report.counterexamples) == 3 and f'2 more of "{Property.DATA.value}"' in report.notes


def test_what_is_wrong_from_the_beginning_hides_nothing() -> None:
    required = 'go is a Serve', 'go has goal=y', 'never go > FAILURE', 'never =SUCCESS'
    report = explore(lambda: system(GO, *required), 'Main')
    assert {found.violation.text.partition('; required is: ')[2] for found in report.counterexamples} == {*required}


def test_what_has_come_about_stays_possible_while_what_was_canceled_ends() -> None:
    either = '<Parallel success_count="1"><Go goal="x"/><Drive/></Parallel>'
    report = explore(lambda: system(either, '=SUCCESS is always still possible'), 'Main')
    assert report.is_proof, report.counterexamples


def test_what_stands_for_the_leaves_goes_with_the_proof() -> None:
    ends = [weakref.ref(type(node)) for node in system(RATE.format(2), 'never go > halted').tree.nodes[-2:]]
    gc.collect()
    assert [end() for end in ends] == [None, None]


def test_what_two_write_at_once_and_nobody_reads_is_no_matter() -> None:
    assert proved('<Parallel success_count="2"><Plan path="{path}"/><Plan path="{path}"/></Parallel>').holds


def test_what_is_given_is_called_as_where_the_tree_begins() -> None:
    """What a sub-tree calls it says nothing about who has written it."""
    body = '<Sequence><Plan path="{path}"/><SubTree ID="Away" path="{route}"/></Sequence>'
    away = '<BehaviorTree ID="Away"><Follow path="{path}"/></BehaviorTree>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree>{away}</root>'
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])

    def made() -> TreeSystem:
        return TreeSystem(library, TreeKey('main.xml', 'Main'), observed=['path'])

    assert made().given == ('route',) and made().needed == {'route'}
    assert explore(made, 'Main').written == {'SUCCESS': {'path'}, 'FAILURE': set(), 'stopped': set()}


@pytest.mark.parametrize(
    ('writer', 'ports', 'is_given'),
    [
        ('<Script code="path := 1"/>', '', True),
        ('<Script code="path := 1"/>', 'path="{path}"', False),
        ('<Script code="path := 1"/>', '_autoremap="true"', False),
        ('<Script code="way := 1"/>', 'way="{path}"', False),
        ('<Script code="@path := 1"/>', '', False),
        ('<SetBlackboard value="1" output_key="way"/>', 'way="{path}"', False),
        ('<SetBlackboard value="1" output_key="@path"/>', '', False),
        ('<SetBlackboard value="{@path}" output_key="way"/>', '', True),
        ('<WasEntryUpdated entry="path"/>', '_autoremap="true"', True),
    ],
)
def test_what_a_sub_tree_writes_by_a_name_is_not_given(writer: str, ports: str, is_given: bool) -> None:
    """By the key that it has there; a key of the sub-tree itself is another one."""
    text = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Inner">{writer}</BehaviorTree><BehaviorTree '
        f'ID="Main"><Sequence><SubTree ID="Inner" {ports}/><Follow path="{{path}}"/></Sequence></BehaviorTree></root>'
    )
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])
    system = TreeSystem(library, TreeKey('main.xml', 'Main'))
    assert system.given == (('path',) if is_given else ())


@pytest.mark.parametrize(('ports', 'is_given'), [('', False), ('path="{path}"', True), ('_autoremap="true"', True)])
def test_nobody_outside_writes_what_only_a_sub_tree_has(ports: str, is_given: bool) -> None:
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Inner"><Follow path="{path}"/></BehaviorTree>'
        f'<BehaviorTree ID="Main"><SubTree ID="Inner" {ports}/></BehaviorTree></root>'
    )
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])
    report = explore(lambda: TreeSystem(library, TreeKey('main.xml', 'Main')), 'Main')
    assert [one.violation.property for one in report.counterexamples] == ([] if is_given else [Property.DATA])


@pytest.mark.parametrize(('condition', 'may_succeed'), [('IsKnown', True), ('IsPathValid', False)])
def test_a_condition_may_give_anything_without_an_optional_input(condition: str, may_succeed: bool) -> None:
    """One of Nav2 of which that is known fails."""
    either = f'<Fallback><Sequence><{condition} path="{{path}}"/><Turn/></Sequence><Drive/></Fallback>'
    report = proved(f'<Sequence>{either}<Plan path="{{path}}"/></Sequence>')
    assert report.is_complete and report.holds is may_succeed


def test_a_distance_controller_fails_when_the_robot_is_lost() -> None:
    driving = '<DistanceController><ForceSuccess><Drive/></ForceSuccess></DistanceController>'
    asking = '<ForceSuccess><Ask/></ForceSuccess>'
    report = proved(f'<Fallback><PipelineSequence>{driving}{asking}</PipelineSequence><Turn/></Fallback>')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_what_a_path_that_is_short_again_leaves_as_it_is_is_found() -> None:
    """As in Nav2: the decorator succeeds, and its child still works."""
    longer = '<PathLongerOnApproach path="{path}"><Drive/></PathLongerOnApproach>'
    found = proved(f'<Sequence>{longer}<Turn/></Sequence>', 'path').counterexamples
    assert {Property.HALTED, Property.ONE_OWNER} & {one.violation.property for one in found}


def test_what_is_written_on_one_way_only_is_not_always_written() -> None:
    """Nothing reads it, so that the situations after both ways are one."""
    either = '<IfThenElse><IsSafe/><Plan path="{path}"/><Repeat num_cycles="2"><Turn/></Repeat></IfThenElse>'
    assert proved(f'<Sequence>{either}<Turn/></Sequence>').written['SUCCESS'] == set()


def test_what_is_given_has_every_value_that_is_asked_for() -> None:
    """By a port or scripts, of a type, of any or of none: no branch is called dead that some value leads to."""
    cases = '<Switch2 variable="{mode}" case_1="fast" case_2="slow"><Plan/><Turn/><AlwaysSuccess/></Switch2>'
    level = """<ScriptCondition code="level > 3 &amp;&amp; kind == 'van'"/>"""
    for first in ('', '<WasEntryUpdated entry="{mode}"/>'):
        report = proved(f'<Sequence>{first}{cases}<Fallback>{level}<Plan/></Fallback></Sequence>', 'level', 'kind')
        assert report.is_complete and report.holds, report.counterexamples
    (absent,) = proved(level).counterexamples
    assert absent.violation.property is Property.DATA


@pytest.mark.parametrize('loop', ['LoopInt', 'LoopBool', 'LoopDouble', 'LoopString'])
def test_a_queue_that_is_given_or_written_has_elements_or_none(loop: str) -> None:
    body = f'<{loop} queue="{{queue}}" value="{{element}}" if_empty="FAILURE"><Turn/></{loop}>'
    for whole, given in ((body, ['queue']), (f'<Sequence><Look other="{{queue}}"/>{body}</Sequence>', [])):
        report = proved(f'<Fallback>{whole}<Plan/></Fallback>', *given)
        assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


@pytest.mark.parametrize(
    'body',
    [
        '<RetryUntilSuccessful num_attempts="{number}"><Turn/></RetryUntilSuccessful>',
        '<RecoveryNode number_of_retries="{number}"><Turn/><Plan/></RecoveryNode>',
        '<Parallel success_count="{number}" failure_count="1"><Turn/><Plan/></Parallel>',
        '<Fallback><Timeout msec="{number}"><Turn/></Timeout><Plan/></Fallback>',
        '<PipelineSequence><RateController hz="{number}"><Plan/></RateController><Turn/></PipelineSequence>',
        '<SubTree ID="Inner" attempts="{number}"/>',
    ],
)
def test_a_number_from_outside_by_which_a_node_counts_is_not_zero(body: str) -> None:
    inner = '<Repeat num_cycles="{attempts}"><Turn/></Repeat>'
    text = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Inner">{inner}</BehaviorTree>'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    )
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])
    report = explore(lambda: TreeSystem(library, TreeKey('main.xml', 'Main')), 'Main')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_constants_of_one_key_are_not_tried_for_another_one_in_the_same_script() -> None:
    """Of outputs of no type: a text is beside no number, and what is compared has values in common."""
    script = "level &gt; 3 &amp;&amp; other == level &amp;&amp; kind == 'van; car'"
    look = '<Look level="{level}" other="{other}" kind="{kind}"/>'
    asked = f'<Sequence><ScriptCondition code="{script}"/><Turn/></Sequence>'
    report = proved(f'<Sequence>{look}<Fallback>{asked}<Plan/></Fallback></Sequence>')
    assert report.is_complete and report.holds, report.counterexamples


@pytest.mark.parametrize(
    'use',
    [
        '<Sequence><Script code="copy := level"/><Turn _skipIf="copy != 5"/></Sequence>',
        '<Sequence><SetBlackboard value="{level}" output_key="copy"/>'
        '<Switch2 variable="{copy}" case_1="5" case_2="7"><Turn/><Plan/><AlwaysSuccess/></Switch2></Sequence>',
        '<SubTree ID="Inner" inner="{level}"/>',
    ],
)
def test_constants_of_a_key_are_tried_for_what_it_is_copied_from_or_called_elsewhere(use: str) -> None:
    inner = '<Fallback><ScriptCondition code="inner == 5"/><Turn/></Fallback>'
    text = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Inner">{inner}</BehaviorTree><BehaviorTree '
        f'ID="Main"><Sequence><Look level="{{level}}"/>{use}</Sequence></BehaviorTree></root>'
    )
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])
    report = explore(lambda: TreeSystem(library, TreeKey('main.xml', 'Main')), 'Main')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


@pytest.mark.parametrize(
    'code',
    [
        *('level == -1', 'level &lt; -3', '-2 * 3 == level', 'level == 0x1F', 'level == 5e2', "level == '7'"),
        *("level != ''", "level .. '' != ''"),
    ],
)
def test_the_constants_of_a_script_are_what_they_mean(code: str) -> None:
    body = f'<Fallback><Sequence><ScriptCondition code="{code}"/><Turn/></Sequence><Plan/></Fallback>'
    report = proved(f'<Sequence><Look level="{{level}}"/>{body}</Sequence>')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


@pytest.mark.parametrize(
    'code',
    [
        *(
            'level &gt; 0.2 &amp;&amp; level &lt; 0.8',
            'level &gt; 1 &amp;&amp; level &lt; 2',
            'level &lt; other',
            'count',
        ),
        *('level &gt; other &amp;&amp; other &gt; 5', 'other &lt; level &amp;&amp; level &lt; third', 'kind != mode'),
        'other &lt; level &amp;&amp; level &lt; third &amp;&amp; other &gt; 1 &amp;&amp; third &lt; 2',
    ],
)
def test_what_is_of_a_type_has_values_between_constants_and_above_each_other(code: str) -> None:
    ports = ' '.join(f'{key}="{{{key}}}"' for key in Measure.ports)
    body = f'<Fallback><Sequence><ScriptCondition code="{code}"/><Turn/></Sequence><Plan/></Fallback>'
    report = proved(f'<Sequence><Measure {ports}/>{body}</Sequence>')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_an_enum_constant_is_a_constant() -> None:
    enums = registry()
    enums.scripts.register_enum('DOCKED', 31)
    body = '<Sequence><Look level="{level}"/><ScriptCondition code="level == DOCKED"/><Turn/></Sequence>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(text, 'main.xml', enums)])
    report = explore(lambda: TreeSystem(library, TreeKey('main.xml', 'Main')), 'Main')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_a_failure_has_any_error_code_that_is_asked_for() -> None:
    recover = '<Sequence><ScriptCondition code="code == 102"/><Turn/></Sequence>'
    report = proved(f'<Fallback><Dock error_code_id="{{code}}"/>{recover}<Plan/></Fallback>')
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


ENOUGH = '<Fallback><ScriptCondition code="level &gt; least"/><Turn name="charge"/></Fallback>'


@pytest.mark.parametrize(
    ('use', 'charge'),
    [
        ('<SubTree ID="Inner" level="{level}" least="20"/>', 'Inner/charge'),
        (f'<Sequence><SetBlackboard value="20" output_key="least"/>{ENOUGH}</Sequence>', 'charge'),
        (f'<LoopInt queue="20" value="{{least}}">{ENOUGH}</LoopInt>', 'charge'),
    ],
)
def test_constants_that_the_tree_writes_without_a_script_are_tried(use: str, charge: str) -> None:
    """Only a level above the least one leads past the charging."""
    text = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Inner">{ENOUGH}</BehaviorTree><BehaviorTree ID="Main">'
        f'<Sequence><Look level="{{level}}"/>{use}<Plan name="plan"/></Sequence></BehaviorTree></root>'
    )
    library = TreeLibrary([load_xml(text, 'main.xml', registry())])
    required = [parse_requirement(f'plan only after {charge} > SUCCESS', 'test').requirement]
    report = explore(lambda: TreeSystem(library, TreeKey('main.xml', 'Main'), requirements=required), 'Main')
    assert Property.REQUIREMENT in {one.violation.property for one in report.counterexamples}


def test_attempts_without_a_limit_are_counted_up_to_a_limit_that_is_written_later() -> None:
    """A Repeat that has enough cycles when its limit comes ends without halting its child, as in BehaviorTree.CPP."""
    limited = '<Sequence><Look level="{other}"/><SetBlackboard value="4" output_key="cycles"/><Plan/></Sequence>'
    report = proved(
        '<Sequence><Script code="cycles := -1"/><Parallel success_count="1" failure_count="1">'
        '<Repeat num_cycles="{cycles}"><Turn/></Repeat>'
        f'<KeepRunningUntilFailure>{limited}</KeepRunningUntilFailure></Parallel></Sequence>'
    )
    assert {one.violation.property for one in report.counterexamples} == {Property.HALTED}


@pytest.mark.parametrize(('leaf', 'can_succeed'), [('Ask', False), ('AskSoon', True)])
def test_what_answers_within_the_tick_does_not_halt_what_is_behind_it(leaf: str, can_succeed: bool) -> None:
    """An action of which nothing more is known is RUNNING when it begins anew, and halts what is behind it."""
    report = proved(f'<ReactiveSequence><{leaf}/><Drive/></ReactiveSequence>')
    assert ('SUCCESS' in report.ends) is can_succeed


def test_what_one_way_writes_is_not_there_on_another() -> None:
    """A script and a node that have found an entry do not keep it, where that way was not taken."""
    number = '<IfThenElse><IsSafe/><Script code="number := 1"/><Script code="number := 2"/></IfThenElse>'
    report = proved(f'<Sequence>{number}<Turn _skipIf="number == 1"/></Sequence>')
    assert report.is_complete and report.holds, report.counterexamples
    place = '<Fallback><Sequence><IsSafe/><SetBlackboard value="1" output_key="place"/></Sequence><Turn/></Fallback>'
    (absent,) = proved(
        f'<Sequence><UnsetBlackboard key="place"/>{place}<Follow path="{{place}}"/></Sequence>', 'place'
    ).counterexamples
    assert absent.violation.property is Property.DATA


def test_writes_before_an_entry_was_removed_are_counted() -> None:
    """A new entry that was written as often as its node has seen before is missed, as in BehaviorTree.CPP."""
    again = '<Sequence><IsSafe/><Script code="level := 1"/></Sequence>'
    updated = '<Sequence><WasEntryUpdated entry="level"/><ForceSuccess><Turn/></ForceSuccess></Sequence>'
    body = f'<Fallback>{updated}<Plan/></Fallback><UnsetBlackboard key="level"/><Script code="level := 1"/>'
    report = proved(
        f'<Sequence><Script code="level := 1"/><Fallback>{again}<AlwaysSuccess/></Fallback>'
        f'<Repeat num_cycles="2"><Sequence>{body}</Sequence></Repeat></Sequence>'
    )
    assert report.is_complete and report.holds and not report.uncovered, report.counterexamples


def test_an_entry_has_the_type_of_its_way() -> None:
    """Text that is written to a number of no type, by a second node, is an error, and by the first one is none."""
    first = (
        '<Fallback><Sequence><IsSafe/><SetBlackboard value="1" output_key="x"/></Sequence><AlwaysSuccess/></Fallback>'
    )
    body = f'<Sequence><Script code="x := 1"/><Turn/>{first}<SetBlackboard value="1" output_key="x"/></Sequence>'
    assert {'ERROR', 'SUCCESS'} <= proved(body).ends.keys()


def test_how_often_a_script_has_run_makes_no_difference() -> None:
    """Not even as its code is generated, which takes several runs."""
    body = '<KeepRunningUntilFailure><Sequence><Script code="n := 1"/><Turn/></Sequence></KeepRunningUntilFailure>'
    assert proved(body).configurations < 8
