# SPDX-License-Identifier: BSD-3-Clause
"""The nemesis: its plans, a few seeds, and mutations that it finds."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import pytest

from flexbt_testing.one_process import nemesis, nemesis_run
from flexbt_testing.one_process.invariants import Violation
from flexbt_testing.one_process.mutations import MUTATIONS, Mutation
from flexbt_testing.one_process.nemesis import shrink
from flexbt_testing.one_process.nemesis_run import Job, Outcome, Plan, Step, run_all, run_one
from flexbt_testing.one_process.scheduler import SCHEDULER

CRASH = Plan(1, steps=(Step(4.0, 'kill', 'onboard_executive', 4.0),))
STOP = Plan(1, steps=(Step(5.0, 'stop', 'engineer', 0.0),))


def test_plans_are_drawn_by_the_seed_and_survive_a_file() -> None:
    for seed in range(200):
        plan = Plan.draw(seed)
        assert plan == Plan.draw(seed) == Plan.read(plan.text())
    assert len({Plan.draw(seed).steps for seed in range(200)}) > 150


@pytest.mark.parametrize('world', nemesis_run.WORLDS)
def test_seeds_break_no_invariant_and_give_the_same_run_again(world: str) -> None:
    plans = [Plan.draw(seed, 4.0, world, 'abstract') for seed in (1, 2)]
    outcomes = {job.plan.seed: outcome for job, outcome in run_all(map(Job, plans), at_once=2)}
    assert {seed: outcome.violations for seed, outcome in outcomes.items()} == {1: [], 2: []}
    assert run_one(Job(plans[1])).hash == outcomes[2].hash


def test_threads_and_another_interpreter_give_the_same_run(tmp_path: Path) -> None:
    steps = (Step(1.0, 'slow_disk', 'robot', 3.0), Step(2.0, 'power', 'robot', 2.0), Step(4.0, 'jump', 'robot', 0.5))
    job = Job(Plan(7, preemption=0.1, computing=0.0005, seconds=5.0, steps=steps))
    assert run_one(job).violations == []
    other = nemesis._again(job, PYTHONHASHSEED='99', FLEXBT_ONE_PROCESS='threads', TMPDIR=str(tmp_path))
    assert nemesis._again(job) == other
    assert list(tmp_path.iterdir()) == []
    assert len(nemesis._again(replace(job, plan=Plan(1, autonomy='of nobody'))).split()) < 2, 'a run that fails'


def test_a_run_with_the_full_robot() -> None:
    assert run_one(Job(replace(STOP, motion='full'))).violations == []


def test_a_crash_of_the_executive_loses_nothing_that_was_shown() -> None:
    assert run_one(Job(CRASH)).violations == []


def test_a_stop_whose_executive_ends_at_once_stops_a_robot_that_a_program_drives() -> None:
    steps = (
        Step(4.2e-05, 'terminate', 'onboard_executive', 1.222, 'command 1'),
        Step(0.159, 'stop', 'pilot', 0.045, 'fault 1'),
        Step(0.200078, 'hang', 'stop_guard', 0.11, 'goal 4'),
    )
    plan = Plan(
        100198, 'nav2_robot', behavior='', autonomy='HIGH', seconds=3.200078, steps=steps, answers=((1.876, 0.592),)
    )
    assert run_one(Job(plan)).violations == []


def test_a_goal_of_an_executive_that_is_killed_at_once_is_not_taken_for_one_of_the_next() -> None:
    kill = Step(0.0, 'kill', 'onboard_executive', 0.5, 'goal 3')
    assert run_one(Job(Plan(29, computing=0.0001, steps=(kill,)))).violations == []


def test_a_command_that_was_decided_as_the_executive_was_killed_need_not_be_decided_again() -> None:
    steps = (
        Step(0.008037, 'hang', 'onboard_executive', 0.125, 'goal 8'),
        Step(0.02003, 'pause', 'engineer', 0.475, 'fault 2'),
        Step(0.052906, 'force', 'engineer', 0.315, 'fault 1'),
        Step(0.172607, 'kill', 'onboard_executive', 0.047, 'goal 7'),
        Step(1.177498, 'jump', 'robot', 0.281),
    )
    plan = Plan(92, motion='full', seconds=4.177498, steps=steps, answers=((0.073, 0.003),))
    assert run_one(Job(plan)).violations == []


def test_a_stop_whose_executive_hangs_while_a_hung_bt_server_has_not_canceled_is_carried_out_in_time() -> None:
    steps = (
        Step(0.040142, 'stop', 'engineer', 0.917, 'fault 2'),
        Step(0.046068, 'loss', 'operator', 4.662, 'goal 4'),
        Step(0.807377, 'hang', 'bt_server', 6.044, 'goal 5'),
        Step(4.344668, 'hang', 'onboard_executive', 6.021),
    )
    answers = ((2.985, 0.464), (0.186, 0.076), (2.218, 0.4))
    plan = Plan(55, 'nav2_robot', 'abstract', 'Navigate', seconds=7.0, steps=steps, answers=answers)
    assert run_one(Job(plan)).violations == []


def test_a_stop_after_which_nobody_is_there_need_not_stop_what_a_program_drives() -> None:
    steps = (
        Step(0.010052, 'kill', 'stop_guard', 2.279, 'command 2'),
        Step(0.152, 'stop', 'engineer', 0.354, 'fault 1'),
        Step(1.866452, 'hang', 'onboard_executive', 2.574),
    )
    plan = Plan(130680, 'nav2_robot', 'abstract', behavior='', autonomy='FULL', preemption=0.1, steps=steps)
    assert run_one(Job(replace(plan, seconds=6.0, answers=((0.28, 0.197),)))).violations == []


def test_a_stop_need_not_discover_what_a_program_drives_by() -> None:
    steps = (
        Step(0.659, 'hang', 'stop_guard', 8.977),
        Step(1.04, 'stop', 'engineer', 0.45),
        Step(1.108, 'kill', 'onboard_executive', 3.231),
    )
    plan = Plan(114126, 'nav2_robot', 'abstract', behavior='', autonomy='LOW', preemption=0.02, steps=steps)
    assert run_one(Job(replace(plan, seconds=10.0, settle=7.0, answers=((0.296, 0.071),)))).violations == []


def test_a_young_bt_server_need_not_miss_an_executive_that_hangs_before_it_was_heard() -> None:
    hang = Step(0.0, 'hang', 'onboard_executive', 9.0, 'goal 4')
    assert run_one(Job(Plan(6204, motion='full', settle=7.0, steps=(hang,), answers=((0.1, 0.7),)))).violations == []


@pytest.mark.parametrize(
    ('world', 'robots'),
    [
        ('flexbt_demo_behaviors/goals/flat.yaml', ['']),
        ('flexbt_demo_behaviors.night_watch.watch:watch_processes', ['alpha', 'beta']),
    ],
)
def test_a_behavior_with_parameters_in_another_world(world: str, robots: list[str]) -> None:
    assert nemesis._robots(world) == robots
    plan = Plan.draw(3, 4.0, world, 'abstract', 'Ask Operator', robots)
    assert {one.target.rpartition('/')[0] for one in plan.steps} >= {*robots}
    plan = replace(plan, arguments=(('question', 'Is it ready?'),))
    assert plan == Plan.read(plan.text())
    assert run_one(Job(plan)).violations == []


@pytest.mark.parametrize(
    ('behavior', 'why'),
    [('Navigat', "there is no behavior 'Navigat'"), ('Inspect Site', "input 'site' is needed and has no default")],
)
def test_a_behavior_that_cannot_be_started_is_told_once(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], behavior: str, why: str
) -> None:
    monkeypatch.setattr(sys, 'argv', ['nemesis', '--behavior', behavior, '--seeds', '9', '--motion', 'abstract'])
    assert nemesis.main() == 2
    told = capfd.readouterr().out
    assert told.startswith('without any fault:\n') and told.count(f'cannot be started: {why}') == 1


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['--world', 'nowhere'], "there is no world 'nowhere'"),
        (['--world', 'none.yaml'], 'none.yaml: not a file name'),
        (['--behavior', 'Navigate', 'speed'], "'speed': expected PARAMETER=VALUE"),
        (['speed=3'], 'speed: a parameter is of a behavior'),
        (['--mutation', 'a stop'], "--mutation 'a stop': there are "),
        (['--jobs', '0'], "'0' is not a whole number from 1 on"),
        (['--seconds', 'nan'], "'nan' is not a number from 1 on"),
        (['--live', 'soon prompt'], "'soon' is not a number from 0 on"),
        (['--plan', 'none.yaml'], 'none.yaml: [Errno 2] No such file'),
    ],
)
def test_wrong_words_are_refused(
    words: list[str], told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, 'argv', ['nemesis', *words])
    with pytest.raises(SystemExit):
        nemesis.main()
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('- steps', 'dictionary'),
        ('speed: 3', "'speed'"),
        ('{seed: 1, motion: fast}', "motion 'fast' is neither full nor abstract"),
        ('{seed: 1, steps: [{time: 1.0, act: kil, target: bt_server, amount: 1.0}]}', "'kil' is none of "),
        ('{seed: 1, steps: [{time: 1.0, act: kill, target: alpha/server, amount: 1.0}]}', "'server' is none of "),
        ('{seed: 1, steps: [{time: soon, act: kill, target: bt_server, amount: 1.0}]}', "'soon'"),
        ('{seed: 1, steps: [{time: 1.0, act: stop, target: pilot, amount: 0, moment: gol 1}]}', "'gol' is none of "),
    ],
)
def test_what_is_no_plan_is_told(text: str, told: str) -> None:
    with pytest.raises(ValueError, match='it is no plan: ') as raised:
        Plan.read(text)
    assert told in str(raised.value)


ALONE: dict[int, tuple[str, tuple[Step, ...]]] = {
    1: ('a call does not see that its server is gone', (Step(4.0, 'kill', 'bt_server', 5.0),)),
    2: ('a stop cancels late', STOP.steps),
    3: ('a node that has replaced another is not seen', (Step(4.0, 'kill', 'bt_server', 0.1),)),
    4: ('a pause does not pause the state', (Step(4.0, 'pause', 'engineer', 0.0),)),
    5: ('states are not left at a stop', STOP.steps),
    6: ('a mirror stays live', (Step(2.0, 'cut', 'operator', 5.0),)),
    7: ('a command that is sent again is applied again', ()),
    8: ('positions are not journaled', CRASH.steps),
    9: ('a node does not close its parts', ()),
    10: (
        'the robot is held until the next start',
        (Step(3.1, 'stop', 'engineer', 0.0), Step(5.5, 'stop', 'engineer', 0.0)),
    ),
    11: ('ends are not in the event log', STOP.steps),
    13: ('the executive shows no node again', (Step(3.0, 'kill', 'bt_server', 1.0),)),
    14: ('the authority is not asked', (Step(2.0, 'claim', 'pilot', 0.0), Step(4.0, 'pause', 'engineer', 0.0))),
}
"""For each invariant a mutation, and the steps of a plan that shows it."""


def _mutation(name: str) -> Mutation:
    return next(one for one in MUTATIONS if one.name == name)


def test_each_invariant_finds_a_mutation_that_no_other_finds() -> None:
    slow = (0.3, 0.3), (1.0, 0.6)  # answers, so that a robot is seen at rest before
    jobs = [Job(Plan(1, seconds=6.0, steps=steps, answers=slow), _mutation(name)) for name, steps in ALONE.values()]
    found = {job.mutation.name: outcome.broken for job, outcome in run_all(jobs, at_once=2) if job.mutation}
    assert found == {name: {number} for number, (name, _) in ALONE.items()}


_HANG = Step(2.5, 'hang', 'bt_server', 7.0)
_DEAD_OWNER = Plan(
    104198,
    behavior='Navigate Split',
    autonomy='HIGH',
    preemption=0.1,
    computing=0.0005,
    settle=7.0,
    steps=(
        Step(0.0, 'kill', 'stop_guard', 0.191, 'goal 7'),
        Step(0.283591, 'hang', 'navigation', 6.276, 'fault 1'),
        Step(3.00489, 'hang', 'bt_server', 8.511),
        Step(3.030014, 'cut', 'operator', 1.588),
        Step(5.780537, 'loss', 'operator', 0.004),
        Step(6.627772, 'kill', 'onboard_executive', 1.28),
    ),
    answers=((0.05, 0.021), (2.938, 0.147), (0.101, 0.928), (0.472, 0.723), (0.02, 0.815), (0.843, 0.239)),
)
_PROGRAM = Plan(1, world='nav2_robot', behavior='', seconds=5.0)
RARE: dict[str, tuple[Plan, set[int]]] = {
    'a call leaves no cancel to a server that is late': (
        Plan(1, settle=7.0, steps=(_HANG,), answers=((0.3, 0.3),)),
        {1},
    ),
    'a server that has returned is not asked for the goal': (
        Plan(
            1,
            settle=1.5,
            steps=(Step(0.0, 'kill', 'navigation', 9.0, 'command 2'), Step(0.4, 'stop', 'pilot', 0.2, 'fault 1')),
            answers=((0.1, 0.8),),
        ),
        {10},
    ),
    'trees run on while their owner hangs': (
        Plan(
            1,
            motion='full',
            settle=7.0,
            steps=(Step(0.3, 'hang', 'onboard_executive', 9.0, 'goal 4'),),
            answers=((0.1, 0.7),),
        ),
        {3},
    ),
    'trees go on after a long hang': (replace(_PROGRAM, settle=7.0, steps=(_HANG,)), {1}),
    'a goal that is replaced does not end': (
        replace(_PROGRAM, steps=(Step(3.0, 'goal_pose', 'engineer', 0.5),)),
        {1, 9},
    ),
    'a command is decided before it has its effect': (
        Plan(1, seconds=4.0, steps=(Step(3.0, 'pause', 'engineer', 0.0),)),
        {7},
    ),
    'a goal belongs to whoever has the name of its owner': (_DEAD_OWNER, {1}),
    'a console does not begin anew with a new executive': (
        Plan(1, seconds=4.0, steps=(Step(2.0, 'kill', 'onboard_executive', 0.3),)),
        {10},
    ),
}
"""Mutations that few seeds find, each with a plan that shows it, and the invariants that it breaks."""


def test_mutations_that_few_seeds_find_are_found_by_plans_made_for_them() -> None:
    jobs = [Job(plan, _mutation(name)) for name, (plan, _) in RARE.items()]
    found = {job.mutation.name: outcome.broken for job, outcome in run_all(jobs, at_once=2) if job.mutation}
    assert found == {name: broken for name, (_, broken) in RARE.items()}
    unchanged = run_all([replace(job, mutation=None) for job in jobs])
    assert [outcome.violations for _, outcome in unchanged] == [[]] * len(jobs)


_THREAD: Final = 'import threading; threading.Thread(target=lambda: 1 / 0).start()'


@pytest.mark.parametrize(
    ('where', 'old', 'new', 'told'),
    [
        ('flexbt_onboard.runs.behavior_run:BehaviorRun.stop', '', _THREAD, 'Exception in thread '),
        (
            'flexbt_common.runtime.node_runtime:run_node',
            ' wait()\n',
            ' __import__("time").sleep(1e6)\n',
            "_server': None",
        ),
        ('flexbt_common.runtime.node_runtime:NodeRuntime.close', '', 'self.post(lambda: 1 / 0)', ' raised; '),
    ],
)
def test_threads_that_die_programs_that_do_not_end_and_what_raises_at_the_end_are_found(
    where: str, old: str, new: str, told: str
) -> None:
    steps = (Step(0.1, 'kill', 'bt_server', 0.1), *STOP.steps)
    found = run_one(Job(replace(STOP, steps=steps), Mutation('', where, new, old))).violations
    assert {one.number for one in found} == {9} and told in found[0].text


def test_no_operator_of_a_plan_acts_after_another_one_has_taken_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    steps = (Step(0.1, 'stop', 'engineer', 0.0, 'fault 1'), Step(2.0, 'kill', 'bt_server', 0.5))
    acted: list[str] = []
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))  # where a child leaves its world
    monkeypatch.setattr(nemesis_run._Operator, 'act', lambda _operator, act, _amount: acted.append(act))
    monkeypatch.setattr(nemesis, 'take_over', lambda world, _words: world.run(5.0))

    def play(seconds: float) -> list[str]:
        nemesis.play_live(Plan(1, seconds=5.0, steps=steps), f'{seconds:g} prompt')
        return acted

    assert [_in_child(partial(play, seconds)) for seconds in (2.0, 4.0)] == [[], ['stop']]


def test_a_mutation_that_runs_differently_is_found_by_running_it_twice() -> None:
    job = Job(Plan(2**40, steps=nemesis._RESTART), next(one for one in MUTATIONS if '(12)' in one.name))
    assert run_one(job).violations == []
    assert nemesis._is_uneven(job)
    assert nemesis._again(replace(job, mutation=None)) == run_one(replace(job, mutation=None)).hash


def _in_child(act: Callable[[], Any]) -> Any:
    """Return what a function returns in a child, since what it does stays; None if it raises."""
    reader, writer = os.pipe()
    if os.fork() == 0:
        with suppress(BaseException):
            os.write(writer, pickle.dumps(act()))
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, 'rb') as stream:
        data = stream.read()
    os.wait()
    return pickle.loads(data) if data else None  # noqa: S301 - from a child of this process


def _run_in_child(mutation: Mutation) -> bool:
    """Return whether a mutation can be made; in a child, since it stays."""

    def apply() -> bool:
        mutation.apply()
        return True

    return bool(_in_child(apply))


def test_all_mutations_can_be_made() -> None:
    assert [one.name for one in MUTATIONS if not _run_in_child(one)] == []
    assert len({one.name for one in MUTATIONS}) == len(MUTATIONS) >= 60


def test_a_mutation_changes_what_objects_have_already() -> None:
    count = nemesis_run._Operator.results
    assert not _run_in_child(Mutation('', 'flexbt_testing.one_process.nemesis_run:_Operator.no', 'return'))
    assert not _run_in_child(Mutation('', 'flexbt_testing.one_process.nemesis_run:_Operator.results', '', 'not there'))
    operator = nemesis_run._Operator.__new__(nemesis_run._Operator)
    operator.commands = {}
    bound, before = operator.results, count.__code__
    try:
        Mutation('', 'flexbt_testing.one_process.nemesis_run:_Operator.results', 'return {"a": 7}').apply()
        assert bound() == {'a': 7}
    finally:
        count.__code__ = before
    assert bound() == {}


def test_a_run_that_fails_is_told_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    play = nemesis_run.Run.play

    def fail(run: nemesis_run.Run) -> Outcome:
        match run._plan.seed:
            case 1:
                os.kill(os.getpid(), signal.SIGKILL)
            case 2:
                raise ValueError('a fault of the nemesis')
        return play(run)

    monkeypatch.setattr(nemesis_run.Run, 'play', fail)
    found = {job.plan.seed: outcome for job, outcome in run_all([Job(Plan(seed, seconds=1.0)) for seed in (1, 2, 3)])}
    assert 'exit code -9' in found[1].violations[0].text
    assert 'a fault of the nemesis' in found[2].violations[0].text
    assert found[3].violations == []


def test_a_fault_goes_on_until_the_last_one_of_its_kind_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = nemesis_run.Run._begin

    def begin_and_tell(run: nemesis_run.Run, step: Step) -> Callable[[], object]:
        end, link = begin(run, step), run._world.network.link()
        SCHEDULER.call_at(SCHEDULER.after(0.5), lambda: run._observer.say(1, f'{link.loss:.3g}, {link.delay:.3g}'))
        return end

    monkeypatch.setattr(nemesis_run.Run, '_begin', begin_and_tell)
    losses = Step(0.5, 'loss', 'operator', 0.8), Step(0.9, 'loss', 'operator', 1.6), Step(1.4, 'delay', 'operator', 1.6)
    told = run_one(Job(Plan(1, seconds=3.0, steps=losses))).violations
    assert [one.text for one in told] == ['0.1, 0', '0.1, 0.1']


def test_a_seed_with_several_violations_is_kept_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def judged(job: Job) -> Outcome:
        kept.append(job.keep)
        return Outcome([Violation(3, 1.0, '')])

    kept: list[Path | None] = []
    monkeypatch.setattr(nemesis, 'run_one', judged)
    monkeypatch.setattr(nemesis, 'run_all', lambda jobs, _at_once: [(job, judged(job)) for job in jobs])
    monkeypatch.setattr(nemesis, '_again', lambda _job, **_environment: 'another hash')
    jobs = [Job(Plan(seed)) for seed in (0, 1)]
    assert nemesis.hunt(jobs, 1, tmp_path, lambda _text: None, shrinks=False) == 2
    assert kept[2:] == [tmp_path / '0', tmp_path / '1']


def test_no_process_is_left_when_the_nemesis_is_interrupted() -> None:
    runs = run_all([Job(Plan(seed, seconds=1.0)) for seed in range(1, 50)], at_once=2)
    assert isinstance(runs, Generator)
    next(runs)
    assert _children() != set()
    runs.close()
    assert _children() == set()


def _children() -> set[int]:
    """Return the processes whose parent is this one."""
    return {int(pid) for pid in Path(f'/proc/self/task/{os.getpid()}/children').read_text().split()}


def test_what_the_unchanged_product_breaks_finds_no_mutation(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(job: Job) -> set[int]:
        return {3} if job.plan.seed > 100 else {2} if job.plan.seed == 90 and job.mutation else set()

    def run(jobs: Iterable[Job], _at_once: int) -> Iterator[tuple[Job, Outcome]]:
        return ((job, Outcome([Violation(number, 1.0, '') for number in broken(job)])) for job in jobs)

    monkeypatch.setattr(nemesis, 'run_all', run)
    monkeypatch.setattr(nemesis, '_ROUNDS', (60, 60, 60))
    monkeypatch.setattr(nemesis, 'MUTATIONS', (_mutation('a stop cancels late'),))
    told: list[str] = []
    assert nemesis.judge(lambda seed, _motion: Plan(seed), 1, told.append) == 0
    assert told[1].endswith(' 2                    1 of the seeds 60 to 119')


_FAIL: Final = Step(1.0, 'fail', 'beta/follow_path', 0.5)


def test_a_plan_of_several_robots_is_shrunk_to_one_with_the_same_fault() -> None:
    found = Mutation('', 'flexbt_testing.one_process.abstract_robot:AbstractRobot._set_fault', _THREAD)
    job = Job(Plan(1, 'night_watch', seconds=2.0, steps=(_FAIL,), answers=()), found)
    small = shrink(job, {9}, lambda _text: None)
    assert (small.world, [step.target for step in small.steps]) == ('navigate', ['follow_path'])
    assert 'Exception in thread' in run_one(replace(job, plan=small)).violations[0].text


def test_a_plan_is_shrunk_to_what_breaks_the_invariant(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs are replaced by a rule: it breaks whenever navigation is killed. What is tested is the search."""

    def judged(job: Job) -> Outcome:
        breaks = any(step.act == 'kill' and step.target == 'navigation' for step in job.plan.steps)
        return Outcome([Violation(3, 1.0, '')] if breaks else [])

    monkeypatch.setattr(nemesis, 'run_one', judged)
    steps = (*Plan.draw(3).steps, *Plan.draw(4).steps, Step(5.0, 'kill', 'navigation', 4.0), *Plan.draw(5).steps)
    small = shrink(Job(replace(Plan.draw(3), steps=steps)), {3}, lambda _text: None, most=100)
    assert [(step.act, step.target) for step in small.steps] == [('kill', 'navigation')]
    assert small.preemption == 0.0
    assert small.steps[0].amount < 4.0
