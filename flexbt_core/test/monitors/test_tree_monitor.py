# SPDX-License-Identifier: BSD-3-Clause
"""Monitors find controls and leaves that do wrong, and let random sound trees alone."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction
from flexbt_core.behavior_tree.engine.context import UnfinishedWork
from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction
from flexbt_core.behavior_tree.engine.parents import Control
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.ports import STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.controls import PauseResumeController, PipelineSequence
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirement_text import parse_requirement
from flexbt_core.monitors.requirements import Apart, AtMost, Before, Never, Requirement, Requirements, While, Within
from flexbt_core.monitors.tree_monitor import TreeMonitor
from flexbt_core.skills.skill import Skill
from flexbt_testing.behavior_trees import random_trees, scripted_nodes
from flexbt_testing.seeded_missions import ForgetfulFallback

RUNNING, SUCCESS = NodeStatus.RUNNING, NodeStatus.SUCCESS
TWO = '<Sequence><Work name="one"/><Work name="other"/></Sequence>'


class Work(StatefulAction):
    """Works until it is told how it ends; what it has begun may end later than its halt."""

    results: dict[str, NodeStatus] = {}
    ends_later = False
    working: UnfinishedWork | None = None

    def on_start(self) -> NodeStatus:
        return self.on_running()

    def on_running(self) -> NodeStatus:
        return self.results.pop(self.name, RUNNING)

    def on_halted(self) -> None:
        if self.ends_later:
            Work.working = self.context.add_unfinished(f'{self.name} rolls on')


class Drive(Work):
    skill = Skill.of(resources=['base'])


class RollOn(Drive):
    ends_later = True


class Takes(CoroutineAction):
    """Done in its third tick."""

    async def run(self) -> NodeStatus:
        await self.next_tick()
        await self.next_tick()
        return SUCCESS


class Flag(Condition):
    holds: dict[str, bool] = {}

    def tick(self) -> NodeStatus:
        return SUCCESS if self.holds.get(self.name, True) else NodeStatus.FAILURE


class Wavers(Condition):
    """Holds whenever it, or another one, did not when it was asked before."""

    holds = False

    def tick(self) -> NodeStatus:
        Wavers.holds = not Wavers.holds
        return SUCCESS if Wavers.holds else NodeStatus.FAILURE


class Turns(Control):
    """Ticks its children by turns, and forgets to halt the one before."""

    def tick(self) -> NodeStatus:
        Turns.number += 1
        return self.tick_child(Turns.number % len(self.children))

    number = 0


class Stalled(Control):
    """RUNNING, with nothing that would ever wake it."""

    def tick(self) -> NodeStatus:
        return RUNNING


class Watched:
    """A tree with a monitor, and what that has found."""

    def __init__(self, body: str, *requirements: Requirement) -> None:
        registry = builtin_registry()
        registry.register_classes([
            Work, Drive, RollOn, Takes, Flag, Wavers, Turns, Stalled, ForgetfulFallback, PipelineSequence,
            PauseResumeController,
        ])  # fmt: skip
        text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
        self.found: list[Violation] = []
        self.clock = ManualClock()
        self.monitor = TreeMonitor(self.found.append, requirements, is_woken_only=True)
        library = TreeLibrary([load_xml(text, 'main.xml', registry)])
        self.tree = Tree(library, 'Main', clock=self.clock, substitute=self.monitor.watched)
        self.monitor.begins(self.tree)
        Work.results, Work.working, Flag.holds, Wavers.holds, Turns.number = {}, None, {}, False, 0

    def tick(self, **results: NodeStatus) -> list[str]:
        """One tick, after which leaves have these results; what was found in it."""
        Work.results = dict(results)
        before = len(self.found)
        self.monitor.ticked(self.tree.tick_once())
        return [one.text for one in self.found[before:]]

    def halt(self) -> None:
        self.tree.halt()
        self.monitor.halted()

    def leaf(self, name: str) -> Work:
        (found,) = [node for node in self.tree.nodes if node.name == name]
        assert isinstance(found, Work)
        return found


def test_a_leaf_that_its_control_forgets_is_found() -> None:
    watched = Watched('<Turns><Work name="one"/><Work name="other"/></Turns>')
    assert watched.tick() == []
    assert watched.tick() == ['other continues, but nothing ticks it any more: it was not halted']
    assert watched.found[0].property is Property.HALTED


def test_a_leaf_that_goes_on_when_the_tree_ends_is_found() -> None:
    watched = Watched('<ForgetfulFallback><Flag name="done"/><Work name="one"/></ForgetfulFallback>')
    Flag.holds['done'] = False
    assert watched.tick() == []
    Flag.holds['done'] = True
    assert any('it was not halted' in text for text in watched.tick())


def test_two_owners_of_an_actuator_are_found() -> None:
    watched = Watched('<Parallel><Drive name="one"/><Drive name="other"/></Parallel>')
    assert watched.tick() == ['base has two owners at once: one and other']
    assert watched.tick() == []  # told once
    assert Watched('<Parallel><Drive name="one"/><Work name="other"/></Parallel>').tick() == []


def test_a_halted_leaf_keeps_its_actuator_until_its_work_has_ended() -> None:
    guarded = '<Sequence><Flag name="f"/><Drive name="next"/></Sequence>'
    body = f'<ReactiveFallback>{guarded}<RollOn name="one"/></ReactiveFallback>'
    watched = Watched(body)
    Flag.holds['f'] = False
    assert watched.tick() == []
    Flag.holds['f'] = True
    assert watched.tick() == ['base has two owners at once: next and one']
    watched = Watched(body)
    Flag.holds['f'] = False
    watched.tick()
    watched.leaf('one').ends_later = False
    Flag.holds['f'] = True
    assert watched.tick() == []


def test_a_leaf_that_acts_after_its_halt_is_found() -> None:
    watched = Watched('<Work name="one"/>')
    watched.tick()
    watched.leaf('one').acts()
    assert watched.found == []
    watched.halt()
    assert watched.found == []
    watched.leaf('one').acts()
    assert [one.property for one in watched.found] == [Property.STOP_STOPS]


def test_a_second_result_is_found() -> None:
    watched = Watched(TWO)
    watched.tick()
    assert watched.tick(one=SUCCESS) == []
    Work.results = {'one': SUCCESS}
    watched.leaf('one').on_running()
    assert watched.found[-1].text == 'one gives SUCCESS, and it has ended before, or was halted'


def test_a_leaf_that_is_done_as_it_begins_is_sound() -> None:
    """Its on_start asks its on_running, as that of many leaves does."""
    watched = Watched(TWO)
    assert watched.tick(one=SUCCESS) == [] and watched.tick(other=NodeStatus.FAILURE) == []
    watched.halt()
    assert watched.found == []


def test_a_control_that_nothing_wakes_is_found() -> None:
    assert Watched('<Stalled><Work/></Stalled>').tick() == [
        'Stalled::1 is RUNNING with no child that is, and nothing wakes the tree'
    ]
    assert Watched('<Sequence><Sleep msec="100"/></Sequence>').tick() == []
    assert Watched('<Delay delay_msec="100"><Work/></Delay>').tick() == []
    # The sequence stays RUNNING, since all its children were skipped; the tree goes on all the same.
    skipped = '<Sequence><Work _skipIf="true"/></Sequence>'
    assert Watched(f'<Fallback>{skipped}<Takes/></Fallback>').tick() == []
    assert Watched(f'<KeepRunningUntilFailure>{skipped}</KeepRunningUntilFailure>').tick() == []


def test_a_control_that_is_skipped_while_it_is_running_is_not_stuck() -> None:
    pipeline = '<PipelineSequence><Work _while="wanted"/></PipelineSequence>'
    watched = Watched(f'<KeepRunningUntilFailure>{pipeline}</KeepRunningUntilFailure>')
    for is_wanted in (True, False, False, True):
        watched.tree.blackboard.set('wanted', is_wanted)
        assert watched.tick() == []


def test_a_control_that_is_paused_is_woken_by_a_request() -> None:
    watched = Watched('<PauseResumeController><Work/></PauseResumeController>')
    watched.tick()
    control = watched.tree.root
    assert isinstance(control, PauseResumeController)
    assert control.pause()
    assert watched.tick() == watched.tick() == []
    assert control.resume()
    assert watched.tick() == []
    assert watched.leaf('Work').status is RUNNING


ASKED_TWICE = (
    '<Sequence><Work name="one"/><ReactiveSequence><{0}/><ForceSuccess><{0}/></ForceSuccess><Work name="other"/>'
    '</ReactiveSequence></Sequence>'
)
BOTH = '<Sequence><Work name="one"/><Parallel><Work/><Work{}/></Parallel></Sequence>'
REQUIREMENTS: list[tuple[str, Requirement, str]] = [
    (TWO, Before('other', 'gate > SUCCESS'), 'other comes without gate > SUCCESS'),
    (TWO, Never('one > SUCCESS'), 'one > SUCCESS happens'),
    (
        '<Sequence><Work name="one"/><Flag name="flag"/><Work name="other"/></Sequence>',
        While('other', 'flag'),
        '',
    ),
    (TWO, While('other', 'flag'), 'other works on, and flag was not asked, or does not hold'),
    (ASKED_TWICE.format('Flag'), While('other', 'Flag'), ''),
    (
        ASKED_TWICE.format('Wavers'),
        While('other', 'Wavers'),
        'other works on, and Wavers was not asked, or does not hold',
    ),
    (BOTH.format(''), Apart('Work', 'Work'), 'Work works while Work does'),
    (BOTH.format(' name="x"'), Apart('Work', 'Work'), ''),
    ('<Sequence><Work name="one"/><Flag/><Work name="Flag"/></Sequence>', Never('Flag > SUCCESS'), ''),
    ('<Sequence><Work name="one"/><Work name="other::2"/></Sequence>', Never('other'), ''),
]


@pytest.mark.parametrize(('body', 'required', 'text'), REQUIREMENTS)
def test_a_requirement_is_watched(body: str, required: Requirement, text: str) -> None:
    watched = Watched(body, required)
    assert watched.tick() == []
    found = watched.tick(one=SUCCESS)
    assert [one.partition(';')[0] for one in found] == ([text] if text else [])


def test_what_is_required_twice_counts_once() -> None:
    """An option of a command and a file may require the same."""
    found: list[Violation] = []
    twice = Requirements([AtMost('A', 2), Before('B', 'A', times=2)] * 2, lambda: 0.0, found.append)
    twice.event('A')
    twice.event('B')
    assert [one.text.partition('; ')[0] for one in found] == ['B comes when A has come once only']


def test_a_deadline_of_a_tree_is_watched_at_its_ticks() -> None:
    watched = Watched(TWO, Within('one > SUCCESS', 'other > SUCCESS', 5.0))
    watched.tick()
    assert watched.tick(one=SUCCESS) == []
    watched.clock.advance(5.0)
    assert [one.partition(';')[0] for one in watched.tick()] == ['other > SUCCESS has not come 5 s after one > SUCCESS']


UNSOUND = re.compile(r'R&gt;|_script="[A-Z]*(?:R[A-Z]*K|K[A-Z]*R)')
"""A decorator that makes something else of RUNNING, and forgets its child; a leaf that works, and says SKIPPED."""


@pytest.mark.parametrize('make', [random_trees.wheel_case, random_trees.script_case])
def test_random_trees_give_no_alarm(make: Callable[[int], dict[str, object]]) -> None:
    seen = 0
    for seed in range(300):
        case = make(seed)
        if UNSOUND.search(str(case['xml'])):
            continue
        found: list[Violation] = []
        scripted_nodes.Run(case, monitor=TreeMonitor(found.append)).trace()
        assert not found, f'{found}\n{case["xml"]}'
        seen += 1
    assert seen > 100


def test_a_deadline_stands_still_in_a_pause() -> None:
    watched = Watched(TWO, Within('one > SUCCESS', 'other > SUCCESS', 5.0))
    watched.tick()
    watched.tick(one=SUCCESS)
    for is_paused, seconds in ((True, 60.0), (False, 4.0)):
        (watched.tree.pause if is_paused else watched.tree.resume)()
        watched.monitor.paused(is_paused)
        watched.clock.advance(seconds)
    assert watched.tick() == []
    watched.clock.advance(1.0)
    assert len(watched.tick()) == 1


def test_what_comes_in_a_pause_leaves_the_next_deadline_as_it_is() -> None:
    watched = Watched(TWO, Within('one > SUCCESS', 'other', 5.0))
    watched.tick()
    watched.tree.pause()
    watched.monitor.paused(True)
    watched.tick(one=SUCCESS)  # a step
    watched.clock.advance(60.0)
    watched.tree.resume()
    watched.monitor.paused(False)
    assert watched.tick() == []


def test_a_pause_does_not_lengthen_the_time_in_which_something_may_happen_so_often() -> None:
    now = [0.0]
    found: list[Violation] = []
    watched = Requirements([AtMost('one', 1, 2.0)], lambda: now[0], found.append)
    watched.event('one')
    watched.rests(True)
    now[0] = 60.0
    watched.rests(False)
    watched.event('one')
    assert not found
    now[0] = 61.0
    watched.event('one')
    assert len(found) == 1


def test_what_has_to_come_again_and_again_has_its_time_anew_each_time() -> None:
    found: list[Violation] = []
    now = [0.0]
    watched = Requirements([Within('beat', 'beat', 5.0)], lambda: now[0], found.append)
    for now[0] in (0.0, 4.0, 8.0):
        watched.event('beat')
        watched.rests(False)
    assert not found and watched.next_due() == 13.0
    now[0] = 13.0
    watched.rests(False)
    assert len(found) == 1


def test_attempts_of_a_run_that_is_resumed_are_not_owed_again() -> None:
    found: list[Violation] = []
    watched = Requirements([Within('one > FAILURE', 'one', times=2)], lambda: 0.0, found.append)
    watched.resume()
    watched.event('one > FAILURE')
    watched.ended()
    assert not found


def test_inputs_are_told_apart_by_the_keys_of_the_whole_tree_whatever_sub_trees_call_them() -> None:
    go = '<BehaviorTree ID="Go"><Work name="drive" to="{target}"/></BehaviorTree>'
    trees = '<SubTree ID="Go" name="there" target="{goal}"/><SubTree ID="Go" name="home" target="{base}"/>'
    trees += '<Inverter name="Work"><Work to="x"/></Inverter>'
    trees += '<SubTree ID="Go" name="away"/><Drive to="{a}"/><Drive/>'
    registry = builtin_registry()
    for base in (Work, Drive):
        registry.register(
            base.__name__, type(base.__name__, (base,), {'ports': {'to': input_port(STRING, default='')}})
        )
    main = f'<BehaviorTree ID="Main"><Sequence>{trees}</Sequence></BehaviorTree>'
    library = TreeLibrary([load_xml(f'<root BTCPP_format="4">{main}{go}</root>', 'main.xml', registry)])
    wrong = ['home/drive has to={target}', 'there is a Come', 'there has target={base}']
    wrong += ['away/drive has to={target}', 'Drive has to={a}']
    required = [
        'there/drive has to={goal}',
        'home/drive has to={base}',
        'home is a Go',
        'away/drive has to={away/target}',
        'Work is an Inverter',
        'Work has to=x',
        'Sequence is a Sequence',
        *wrong,
    ]
    found: list[Violation] = []
    monitor = TreeMonitor(found.append, [parse_requirement(text, 'test').requirement for text in required])
    monitor.begins(Tree(library, 'Main', clock=ManualClock(), substitute=monitor.watched))
    monitor.check_parts()
    assert [one.text.partition('; required is: ')[2] for one in found] == wrong


def test_a_coroutine_begins_once_and_gives_its_result_once() -> None:
    asked_again = '<PipelineSequence><Takes name="it"/><Work name="one"/></PipelineSequence>'
    watched = Watched(asked_again, AtMost('it', 1), AtMost('it > SUCCESS', 1))
    for result in (RUNNING, RUNNING, RUNNING, RUNNING, SUCCESS):
        assert watched.tick(one=result) == []
    assert watched.tick() == ['it happens more than once; required is: it at most 1 time']
