# SPDX-License-Identifier: BSD-3-Clause
"""The run of a plan of the nemesis, forked from a world that is ready, and all that is kept of it."""

from __future__ import annotations

import gc
import hashlib
import io
import json
import os
import pickle
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final
from unittest import mock

from .world import Mission, World  # isort: skip - it prepares this interpreter

import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import ConsoleError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    AutonomyLevel,
    CommandKind,
    Decision,
    DecisionKind,
    ExecutiveState,
    FramedPose,
)
from flexbt_console.recording.run_file import write_recording
from flexbt_console.recording.topics import TOPICS
from flexbt_core.values.text import one_line
from flexbt_msgs.msg import ExecutiveLog
from flexbt_sim.messages import stamped
from flexbt_sim.world import Pose

from .forks import Fork, ForkError, fork_process
from .graph import DOMAIN
from .invariants import LONG_SECONDS, Observer, Violation, body_of
from .mutations import Mutation
from .programs import named, named_programs
from .scheduler import BOOT, EPOCH, SCHEDULER, SECOND, USES_THREADS, StuckWorldError, Task

SECONDS: Final = 10.0
"""Simulated time in which the steps of a plan happen, s."""

_DEATH: Final = re.compile(r'^(?=the task |Exception in thread |a function at the exit )', re.MULTILINE)
"""Beginnings of lines that tell of the death of a task or a thread, or of a function that raised at the exit."""

_PROCESSOR_SECONDS: Final = 120
"""Processor time after which a run is ended, s: something computes without end."""

_SIMULATED_SECONDS: Final = 250.0
"""Simulated time after which a run is ended, s."""

NEEDED: Final = ('bt_server', 'onboard_executive', 'stop_guard')
"""Programs of each robot of a world, beside a simulator and a navigation."""

WORLDS: Final = ('navigate', 'night_watch', 'nav2_robot', 'goals')
"""The demonstrations."""

_BEHAVIORS: Final = {
    'navigate': ('Navigate', 'Navigate', 'Navigate Split'),
    'night_watch': ('Night Watch', 'Navigate'),
    'nav2_robot': ('', 'Navigate'),  # '': a program drives
    'goals': ('Reach Goal', 'Navigate'),
}
_PROGRAM: Final = 'deliveries'
_PROCESSES: Final = (*['bt_server'] * 3, *['onboard_executive'] * 4, *['navigation'] * 2, 'stop_guard', 'simulator')
_OPERATORS: Final = ('engineer', 'engineer', 'pilot')
_OF_PROCESSES: Final = ('kill', 'kill', 'kill', 'hang', 'hang', 'hang', 'terminate')
_OF_LINKS: Final = ('cut', 'loss', 'delay', 'rate')
_OF_COMPUTERS: Final = ('power', 'full_disk', 'stuck_disk', 'slow_disk', 'jump')
_FAULTS: Final = (*_OF_PROCESSES * 3, *_OF_LINKS, 'cut', *_OF_COMPUTERS, 'power', 'fail')
_ACTS: Final = (
    *('stop', 'stop', 'pause', 'pause', 'resume', 'force', 'start', 'start'),
    *('autonomy', 'repeat', 'switch', 'claim', 'claim', 'release', 'resend'),
)
_ACTS_WITH_PROGRAM: Final = (*_ACTS, *['goal_pose'] * 5)
_MOMENTS: Final = (*['command'] * 2, *['goal'] * 3, 'cancel', *['fault'] * 4)
_FAILING: Final = ('follow_path', 'compute_path_to_pose')
_KNOWN: Final = (
    {*_FAULTS, *_ACTS_WITH_PROGRAM},
    {*_PROCESSES, *_OPERATORS, *_FAILING, 'operator', 'robot'},
    {*_MOMENTS, ''},
)
"""Acts of steps, their targets without the robot, and kinds of moments."""


@dataclass(frozen=True)
class Step:
    """Something that happens at a time (s, from when the robot is ready): a fault, or what an operator does.

    With a ``moment``, such as ``goal 4``, the time begins when that happens: the fourth goal is sent or canceled, the
    executive receives a command, or another fault begins.

    ``target`` is a process, an action, the link of the operator, the computer of the robots, or an operator.
    ``amount``: how long a fault lasts, s; for an operator's step a number from 0 to 1 that decides among what is
    possible then.
    """

    time: float
    act: str
    target: str
    amount: float
    moment: str = ''


def _checked(step: Step) -> Step:
    words = step.act, step.target.rpartition('/')[2], step.moment.partition(' ')[0]
    for word, known in zip(words, _KNOWN, strict=True):
        if word not in known:
            raise ValueError(f'{word!r} is none of {", ".join(sorted(known))}')
    return replace(step, time=float(step.time), amount=float(step.amount))


@dataclass(frozen=True)
class Plan:
    """All that happens in a run."""

    seed: int
    world: str = 'navigate'
    motion: str = 'abstract'
    behavior: str = 'Navigate'
    arguments: tuple[tuple[str, str], ...] = ()
    """Parameters of the behavior, with their values as text."""
    autonomy: str = 'HIGH'
    preemption: float = 0.0
    """Probability that a task is interrupted where it acquires a lock."""
    computing: float = 0.0
    """Mean of the simulated time that a turn of a task takes, s."""
    seconds: float = SECONDS
    settle: float = 1.5
    """Time from the last fault until the mission must work again, s."""
    steps: tuple[Step, ...] = ()
    answers: tuple[tuple[float, float], ...] = ((0.3, 0.3), (0.3, 0.6))
    """Delay (s) of each answer, and a number from 0 to 1 that decides the place; then nobody answers any more."""

    @classmethod
    def draw(
        cls,
        seed: int,
        seconds: float = SECONDS,
        world: str = '',
        motion: str = '',
        behavior: str = '',
        robots: Sequence[str] = (),
    ) -> Plan:
        """Draw the plan of a seed, in a world, with a motion of the robot and a behavior, or with drawn ones.

        ``robots`` are the namespaces of the robots, where the world is no demonstration.
        """
        draw = random.Random(f'plan {seed}')
        drawn = draw.choice(('navigate', *WORLDS)), draw.choice(('full', *['abstract'] * 9))
        world, motion = world or drawn[0], motion or drawn[1]
        behavior = behavior or draw.choice(_BEHAVIORS.get(world, ('Navigate',)))
        robots = [named(one, '') for one in robots] or (('alpha/', 'beta/') if world == 'night_watch' else ('',))

        def step(acts: Sequence[str], targets: Sequence[str]) -> Step:
            act, target, robot = draw.choice(acts), draw.choice(targets), draw.choice(robots)
            length = min(draw.expovariate(draw.choice((0.25, 1.0, 5.0))), 9.0)
            if act == 'hang' and draw.random() < 0.3:  # until the others give it up
                length = draw.uniform(LONG_SECONDS, 9.0)
            amount = draw.random() if targets is _OPERATORS else length
            if act in _OF_LINKS or act in _OF_COMPUTERS:
                target, robot = 'operator' if act in _OF_LINKS else 'robot', ''
            elif act == 'fail':
                target = draw.choice(_FAILING)
            time, moment = draw.uniform(0.0, seconds), ''
            if draw.random() < 0.5:
                time = draw.choice((0.0, 0.0001, 0.05, 0.5)) * draw.expovariate(1.0)
                moment = draw.choice(_MOMENTS)
                moment += (
                    f' {draw.randint(3, 9) if moment == "goal" else draw.randint(1, 3)}'  # goals 1 and 2 load trees
                )
            return Step(round(time, 6), act, robot + target, round(amount, 3), moment)

        faults = [step(_FAULTS, _PROCESSES) for _ in range(draw.choice((0, 2, 3, 4, 6)))]
        possible = _ACTS if behavior else _ACTS_WITH_PROGRAM
        acts = [step(possible, _OPERATORS) for _ in range(draw.choice((0, 4, 6, 8, 12)))]
        if draw.random() < 0.4:  # what matters most: a STOP during a fault
            acts.append(replace(step(('stop',), _OPERATORS), time=round(draw.expovariate(2.0), 3), moment='fault 1'))
        has_long_hang = any(one.act == 'hang' and one.amount > LONG_SECONDS for one in faults)
        return cls(
            seed=seed,
            world=world,
            motion=motion,
            behavior=behavior,
            autonomy=draw.choice(('LOW', 'HIGH', 'FULL')),
            preemption=draw.choice((0.0, 0.02, 0.1)),
            computing=draw.choice((0.0, 0.0, 0.0001, 0.0005)),
            seconds=seconds,
            settle=7.0 if has_long_hang else draw.choice((1.5, 1.5, 1.5, 7.0)),
            steps=tuple(sorted([*faults, *acts], key=lambda one: one.time)),
            answers=tuple(
                (round(draw.uniform(0.0, draw.choice((0.3, 3.0))), 3), round(draw.random(), 3)) for _ in range(8)
            ),
        )

    def text(self) -> str:
        """Return the plan as YAML."""
        return str(yaml.safe_dump(json.loads(json.dumps(asdict(self))), sort_keys=False, default_flow_style=None))

    @classmethod
    def read(cls, text: str) -> Plan:
        """Return the plan of a YAML text.

        Raises:
            ValueError: it is no plan.
        """
        try:
            found = dict(yaml.safe_load(text))
            steps = tuple(_checked(Step(**one)) for one in found.pop('steps', ()))
            answers = tuple((delay, place) for delay, place in found.pop('answers', cls.answers))
            arguments = tuple((name, value) for name, value in found.pop('arguments', ()))
            plan = cls(**found, steps=steps, answers=answers, arguments=arguments)
            if plan.motion not in ('full', 'abstract'):
                raise ValueError(f'motion {plan.motion!r} is neither full nor abstract')
            return plan
        except (yaml.YAMLError, AttributeError, TypeError, ValueError) as error:
            raise ValueError(f'it is no plan: {one_line(str(error))}') from error


class _Operator:
    """An operator who acts by plan, on what is on display then."""

    def __init__(self, name: str, mirror: Mirror, link: ExecutiveLink) -> None:
        self.mirror, self.commands = mirror, {}  # type: Mirror, dict[str, Any]
        self._link = link
        self._make = CommandBuilder(name)
        self._given: list[Any] = []
        self._goal_poses: Any = None
        self._patience = 6.0
        """Time for which a command is sent again until it is answered, s."""
        self._answered: set[tuple[str, str]] = set()
        self.problem = ''

    def give(self, make: Callable[[CommandBuilder, Any], Any]) -> bool:
        """Send a command, if what is on display allows it; return whether it was sent. :attr:`problem` says why not."""
        try:
            command = make(self._make, self.mirror.view())
        except ConsoleError as error:
            self.problem = str(error)
            return False
        self._given.append(command)
        self.commands[command.id] = self._link.send(command, self._patience)
        return True

    def act(self, act: str, amount: float) -> None:
        """Do what a step of a plan says; nothing if that is not possible now."""
        self._patience = 6.0 if int(1000.0 * amount) % 2 else 0.1
        match act:
            case 'stop' | 'pause':
                self.give(lambda make, view: make.command(view, CommandKind[act.upper()]))
            case 'resume':
                self.give(lambda make, view: make.resume(view))
            case 'claim' | 'release':
                self.give(lambda make, view: make.command(view, CommandKind[f'{act.upper()}_AUTHORITY']))
            case 'autonomy':
                level = _chosen(list(AutonomyLevel), amount)
                self.give(lambda make, view: make.autonomy(view, level))
            case 'start':
                self.start('Navigate', AutonomyLevel.HIGH)
            case 'repeat':
                self.give(lambda make, view: make.repeat(view))
            case 'switch':
                self.give(lambda make, view: make.switch(view, view.snapshot.behavior))
            case 'force':
                self.give(lambda make, view: make.force(view, '', self._outcome(view, amount)))
            case 'goal_pose':
                self._give_goal(_chosen(list(self.mirror.view().places.values()), amount))
            case 'resend' if self._given:  # as a console does that has missed the answer
                self._link._runtime.call(lambda: self._link._publish(_chosen(self._given, amount)))

    def _give_goal(self, place: FramedPose) -> None:
        """Publish a goal, as RViz does. A BT server with the navigators of Nav2 drives there."""
        topic, runtime = self._link._topic(names.GOAL_POSE), self._link._runtime
        if self._goal_poses is None:
            self._goal_poses = runtime.call(lambda: runtime.node.create_publisher(PoseStamped, topic, 10))
        self._goal_poses.publish(stamped(Pose(place.x, place.y, place.yaw), place.frame, Time()))

    def start(self, behavior: str, level: AutonomyLevel, arguments: Sequence[tuple[str, str]] = ()) -> bool:
        """Start a behavior."""
        return self.give(lambda make, view: make.start(view, behavior, arguments, level))

    def answer(self, decision: Decision, place: float) -> None:
        """Answer a question with a place, or decline it; or confirm what a state suggests."""
        view = self.mirror.view()
        self._answered.add((view.snapshot.run_id if view.snapshot else '', decision.id))
        if decision.kind is DecisionKind.INPUT:
            name = _chosen(sorted(view.places) or [''], place)
            if not self.give(lambda make, view: make.answer(view, decision.id, name, unseen=True)):
                self.give(lambda make, view: make.decline(view, decision.id))
        else:
            outcome = decision.outcome or decision.outcomes[0]
            self.give(lambda make, view: make.choose(view, decision, outcome, unseen=True))

    def question(self) -> Decision | None:
        """Return the oldest decision that this operator has not answered."""
        view = self.mirror.view()
        run = view.snapshot.run_id if view.snapshot else ''
        return next((one for one in view.decisions if (run, one.id) not in self._answered), None)

    def refusal(self) -> str:
        """Return why the executive has refused the first command; '' if it has not."""
        tracked = self.mirror.command(next(iter(self.commands), ''))
        return tracked.reason if tracked is not None and tracked.state.name == 'REFUSED' else ''

    def results(self) -> dict[str, int | None]:
        """Return the result of each command, None if it is not known."""
        codes = {'APPLIED': 1, 'REFUSED': 2}
        known = {one: self.mirror.command(one) for one in self.commands}
        return {one: codes.get(tracked.state.name) if tracked else None for one, tracked in known.items()}

    @staticmethod
    def _outcome(view: Any, amount: float) -> str:
        outcomes = view.outcomes(view.active_paths[0]) if view.active_paths else ()
        return str(_chosen(outcomes, amount)) if outcomes else 'done'


def _chosen(choices: Sequence[Any], number: float) -> Any:
    """Return the choice for a number of a plan, from 0 to 1."""
    return choices[min(int(number * len(choices)), len(choices) - 1)]


@dataclass
class Outcome:
    """What has come of a run."""

    violations: list[Violation] = field(default_factory=list)
    seconds: float = 0.0
    processor: float = 0.0
    hash: str = ''

    @property
    def broken(self) -> set[int]:
        """The numbers of the invariants that did not hold."""
        return {one.number for one in self.violations}


@dataclass(frozen=True)
class Job:
    """A run that is wanted: of a plan, of a changed product, with what is kept of it."""

    plan: Plan
    mutation: Mutation | None = None
    keep: Path | None = None


class Stage:
    """A world that is ready, with its operators: the runs of all plans of this world begin here."""

    def __init__(self, world: str, motion: str) -> None:
        gc.disable()  # when it runs depends on what else is in memory
        files = {'journal_directory': '~/files', 'event_log_directory': '~/files'}
        self._scratch = tempfile.TemporaryDirectory()
        programs = [
            replace(one, parameters={**one.parameters, **files}) if one.executable == 'onboard_executive' else one
            for one in named_programs(world, Path(), Path(self._scratch.name), motion)
        ]
        self.world = World(0, programs).__enter__()
        with mock.patch.object(SCHEDULER.current, 'process', SCHEDULER.process('operator 2')):
            self.station = NodeRuntime('operator_2', args=[])
            mirror = Mirror(self.station.steady)
            pilot = _Operator('pilot', mirror, ExecutiveLink(self.station, mirror, 'pilot', self.world._own))
        self.world.run_until(lambda _view: mirror.view().live and mirror.view().behaviors is not None, 30.0)
        self.operators = {
            named(name, 'engineer'): _Operator('engineer', mission.mirror, mission._link)
            for name, mission in self.world.robots.items()
        }
        self.operators[named(self.world.namespace, 'pilot')] = pilot
        gc.collect()
        gc.freeze()

    def fork(self, job: Job) -> Fork:
        """Begin a run in a child."""

        def play(_world: World) -> Outcome:
            resource.setrlimit(resource.RLIMIT_CPU, (_PROCESSOR_SECONDS, _PROCESSOR_SECONDS))
            return Run(self, job).play()

        return self.world.fork(play)


class Run:
    """A run of a plan in this process."""

    def __init__(self, stage: Stage, job: Job) -> None:
        self._plan, self._keep, self._mutation = job.plan, job.keep, job.mutation
        self._world, self._stage, self._operators = stage.world, stage, stage.operators
        self._outcome = Outcome()
        self._mended: list[float] = []
        """When all faults were ended."""
        self._lasting = Counter[str]()
        """Number of faults of a kind, not of processes, that go on."""
        self._story: list[tuple[float, str]] = []
        self._recorded: list[tuple[int, str, Any]] = []
        self._hash = hashlib.sha256()

    def play(self) -> Outcome:
        """Run the plan; the world is at its end then."""
        began, world = os.times(), self._world
        errors = sys.stderr = io.StringIO()
        sys.stdout = io.StringIO()  # of programs
        threading.excepthook = threading.__excepthook__  # which prints
        SCHEDULER.random.seed(self._plan.seed)
        SCHEDULER.shuffles = True
        SCHEDULER.limit = SCHEDULER.after(_SIMULATED_SECONDS)
        SCHEDULER.trace = self._trace
        self._observer = Observer(world, world.home / 'files', self._record, has_program=not self._plan.behavior)
        if self._mutation is not None:
            self._mutation.apply()
        try:
            self._in_world()
        except StuckWorldError as error:
            self._observer.say(9, f'{error}'[:600])
        finally:
            sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
        for death in _DEATH.split(errors.getvalue())[1:]:
            if not death.startswith(f'the task {_PROGRAM}/'):
                self._observer.say(9, death[-1500:])
        ended = os.times()
        self._outcome.processor = ended.user + ended.system - began.user - began.system
        self._outcome.hash = self._hash.hexdigest()[:16]
        self._outcome.violations = self._observer.violations
        self._outcome.seconds = world.now
        return self._outcome

    def _trace(self, task: Task, now: int) -> None:
        """Note a switch of tasks, and let time pass for what the task computed before."""
        self._hash.update(b'%d %d;' % (task.id, now))
        if self._plan.computing:
            SCHEDULER.now += int(SCHEDULER.random.expovariate(1.0 / self._plan.computing) * SECOND)

    def _in_world(self) -> None:
        plan, world = self._plan, self._world
        self._observer.begin([operator.mirror for operator in self._operators.values()])
        SCHEDULER.preemption = plan.preemption
        try:
            self._play_plan()
        except AssertionError as error:
            self._observer.say(10, f'{error}'[:600])
        self._observer.finish([operator.results() for operator in self._operators.values()])
        files = {file.name: file.read_bytes() for file in (world.home / 'files').iterdir()}
        self._stage.station.close()
        for name in world.processes:
            world.terminate(name)
        world.run(3.0)
        codes = {name: process.exit_code for name, process in world.processes.items() if name != _PROGRAM}
        if any(code != 0 for code in codes.values()):  # None: it has not ended
            self._observer.say(9, f'exit codes {codes}')
        ended = [process for process in world.processes.values() if process.exit_code == 0]
        if left := [node.get_fully_qualified_name() for node in DOMAIN.nodes if node.process in ended]:
            self._observer.say(9, f'nodes that were not ended: {", ".join(left)}')
        self._observer.check_log()
        if self._keep is not None:
            self._save(self._keep, files)

    def _play_plan(self) -> None:
        plan, world = self._plan, self._world
        self._say(f'plan {plan.seed}: {plan.behavior or _PROGRAM} at {plan.autonomy}')
        begin = world.now
        faults = [step for step in plan.steps if step.target not in self._operators and not step.moment]
        self._end_at = begin + max([plan.seconds, *(step.time + step.amount for step in faults)])
        for step in plan.steps:
            self._await(step, begin)
        if not plan.behavior:
            world.launch(f'flexbt_demo_behaviors/{_PROGRAM}')
        for name in world.robots:
            engineer = self._operators[named(name, 'engineer')]
            if plan.behavior:
                other = [('home', f'{name}_dock'), ('partner', 'beta' if name == 'alpha' else 'alpha')]
                arguments = other if plan.behavior == 'Night Watch' else plan.arguments
                started = engineer.start(plan.behavior, AutonomyLevel[plan.autonomy], arguments)
                assert started, f'{plan.behavior!r} cannot be started: {engineer.problem}'
            world.at(world.now, lambda engineer=engineer: self._answer(engineer, list(plan.answers)))  # type: ignore[misc]
        world.run(self._end_at + 0.1 - world.now)
        self._mend()
        world.run(plan.settle)
        for name, mission in world.robots.items():
            engineer = self._operators[named(name, 'engineer')]
            refusal = engineer.refusal() if plan.behavior and not plan.steps else ''  # which no fault explains
            assert not refusal, f'{plan.behavior!r} cannot be started: {refusal}'
            self._check_usable(mission, engineer)

    def _await(self, step: Step, begin: float) -> None:
        """Do a step at its time after ``begin``, or after its moment."""
        if step.moment:
            self._observer.awaited[step.moment].append(lambda: self._await(replace(step, moment=''), self._world.now))
        else:
            self._world.at(begin + step.time, lambda: self._happen(step))

    def _happen(self, step: Step) -> None:
        left = self._end_at - self._world.now
        if left < 0.0 or (self._mended and step.target in self._operators):
            return  # its moment was too late, or somebody else has taken over
        step = replace(step, amount=min(step.amount, left))
        self._say(f'{step.act} {step.target} ({step.amount:.3f})')
        if step.target in self._operators:
            self._operators[step.target].act(step.act, step.amount)
            return
        self._observer.passes('fault')
        if step.act in _OF_PROCESSES:
            self._hurt(step)
        elif step.act == 'power':
            names = [name for name, one in self._world.processes.items() if one.is_alive and name != _PROGRAM]
            for name in names:
                self._observer.killed(name)
            self._observer.has_whole_log = False
            self._world.lose_power(*names)
            SCHEDULER.sleep(step.amount / 4.0)
            for name in names:
                self._restart(name)
        else:
            end = self._begin(step)
            self._lasting[step.act] += 1
            SCHEDULER.sleep(step.amount)
            self._lasting[step.act] -= 1
            if not self._lasting[step.act]:  # else another one of its kind goes on
                end()

    def _begin(self, step: Step) -> Callable[[], object]:
        """Begin a fault, and return what ends it."""
        world, amount = self._world, step.amount
        link, (robot, _, action) = world.network.link(), step.target.rpartition('/')
        if 'disk' in step.act:
            self._observer.disk_fails(amount)
        match step.act:
            case 'cut':
                world.network.cut(amount)
            case 'loss' | 'delay':
                setattr(link, step.act, amount / 16.0)
                return lambda: setattr(link, step.act, 0.0)
            case 'rate':
                link.rate = 20.0 + 20.0 * amount
                return lambda: setattr(link, 'rate', 0.0)
            case 'full_disk':
                world.disk.fill(int(100.0 * amount))
                return world.disk.clear
            case 'stuck_disk':
                world.disk.hang()
                return world.disk.go_on
            case 'slow_disk':
                world.disk.delay = amount / 16.0
                return lambda: setattr(world.disk, 'delay', 0.0)
            case 'jump':
                world.jump_clock(20.0 * (amount - 1.0))
            case 'fail' if self._process(named(robot, 'navigation'))[1].is_alive:
                world.robots[robot].fail_goal(action, amount)
        return lambda: None

    def _hurt(self, step: Step) -> None:
        """Kill, terminate or stop a process for a time."""
        name, process = self._process(step.target)
        if not process.works:
            return
        if step.act == 'hang':
            self._observer.hangs(name, step.amount)
            self._world.hold_up(name)
            SCHEDULER.sleep(step.amount)
            SCHEDULER.resume(process)
            self._say(f'{name} goes on')
            return
        self._end(name, self._world.kill if step.act == 'kill' else self._world.terminate)
        SCHEDULER.sleep(step.amount + (2.5 if step.act == 'terminate' else 0.0))
        self._restart(name)

    def _process(self, target: str) -> tuple[str, Any]:
        """Return the process that does the work of one of a plan, and its name."""
        processes = self._world.processes
        name = target if target in processes else body_of(processes, target)
        return name, processes[name]

    def _end(self, name: str, act: Callable[[str], object]) -> None:
        self._observer.killed(name)
        act(name)

    def _restart(self, name: str) -> None:
        if not self._world.processes[name].is_alive:
            self._world.restart(name)
            self._say(f'{name} starts again')

    def _mend(self) -> None:
        """End all faults."""
        self._mended.append(self._world.now)
        for name, process in list(self._world.processes.items()):
            if name == _PROGRAM:
                if process.is_alive:
                    self._end(name, self._world.kill)
                continue
            if process.is_alive and process.held_up is not None:
                SCHEDULER.resume(process)
            self._restart(name)
        self._say('all faults have ended')

    def _answer(self, operator: _Operator, answers: list[tuple[float, float]]) -> None:
        """Answer questions by plan, one after the other."""
        while answers and not self._mended:
            decision = operator.question()
            if decision is None:
                SCHEDULER.sleep(0.1)
                continue
            delay, place = answers.pop(0)
            SCHEDULER.sleep(delay)
            if not self._mended:
                self._say(f'answers {decision.path}')
                operator.answer(decision, place)

    def _check_usable(self, mission: Mission, operator: _Operator) -> None:
        """Start a mission, drive, and stop it: everything must work again.

        Where the behavior Navigate cannot be had, the one of the plan is started.
        """
        if mission is self._world:
            self._operators[named(mission.namespace, 'pilot')].act('release', 0.0)
        mission.run_until(lambda view: bool(view.snapshot and view.snapshot.authority in ('', 'engineer')), 10.0)
        self._end_run(operator)
        is_own = self._plan.world not in WORLDS
        wanted = 'the list of behaviors' if is_own else 'the lists of behaviors and places'
        mission.run_until(lambda view: view.behaviors and (is_own or view.places), 10.0, wanted)
        self._say('a mission that must work')
        view = mission.view
        if view.places and any(one.name == 'Navigate' for one in view.behaviors or ()):
            self._drive(mission)
        else:
            mission.start(self._plan.behavior, **dict(self._plan.arguments))
        mission.stop()
        self._world.run(1.5)
        assert mission.robot.at_rest, 'the robot moves after the last stop'

    def _drive(self, mission: Mission) -> None:
        """Send the robot to the farthest place, and wait until it drives."""
        mission.start('Navigate')
        mission.run_until(mission.asks('/AskGoal'), 30.0, 'a question')
        pose, length = mission.robot.pose, mission.robot.length
        assert pose is not None, 'the robot has no pose'
        mission.answer('/AskGoal', max(mission.view.places, key=lambda place: mission.place(place).distance(pose)))
        mission.run_until(lambda _view: mission.robot.length > length + 0.3, 30.0, 'a drive')

    def _end_run(self, operator: _Operator) -> None:
        """Stop what runs, or abort what was interrupted, until the executive is idle."""
        until = self._world.now + 20.0

        def is_idle() -> bool:
            view = operator.mirror.view()
            return view.live and view.snapshot is not None and view.snapshot.state is ExecutiveState.IDLE

        while not is_idle():
            view = operator.mirror.view()
            state = view.snapshot.state.name if view.snapshot else 'unknown'
            assert self._world.now < until, f'not idle: {state}, link {view.link.value}, {view.active_paths}'
            kind = CommandKind.ABORT_RUN if state == 'INTERRUPTED' else CommandKind.STOP
            operator.give(lambda make, view: make.command(view, kind))  # noqa: B023 - at once
            self._world.run(2.0)

    def _say(self, text: str) -> None:
        self._story.append((round(self._world.now, 3), text))
        if self._keep is not None:
            stamp = self._world.now
            line = ExecutiveLog(severity=ExecutiveLog.WARN, path='/nemesis', text=text)
            line.stamp.sec, line.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
            self._recorded.append((EPOCH + SCHEDULER.now - BOOT, 'executive/log', line))

    def _record(self, name: str, sample: Any) -> None:
        if self._keep is not None and name in TOPICS and name not in ('scan', 'tf'):
            self._recorded.append((EPOCH + SCHEDULER.now - BOOT, name, sample.message()))

    def _save(self, keep: Path, files: dict[str, bytes]) -> None:
        shutil.rmtree(keep, ignore_errors=True)
        keep.mkdir(parents=True)
        (keep / 'plan.yaml').write_text(self._plan.text())
        lines = [(when, f'nemesis: {text}') for when, text in self._story]
        lines += [(one.time, f'VIOLATION {one}') for one in self._observer.violations]
        lines += [((when - BOOT) / SECOND, f'{process} {name}: {text}') for when, process, _, name, text in DOMAIN.log]
        told = '\n'.join(f'{when:9.3f} {text}' for when, text in sorted(lines, key=lambda line: line[0]))
        (keep / 'log.txt').write_text(f'{told}\n')
        for name, data in files.items():
            (keep / name).write_bytes(data)
        write_recording(keep / 'run.mcap', self._recorded)


# ------------------------------------------------------------------------------------------------- runs in processes


def run_all(jobs: Iterable[Job], at_once: int = 1) -> Iterator[tuple[Job, Outcome]]:
    """Run jobs, those of a world after those of another, some at once; yield them as they end.

    A world lives in a child, whose children are the runs. All of them end with this generator.
    """
    worlds: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        worlds.setdefault((job.plan.world, job.plan.motion), []).append(job)
    for (world, motion), those in worlds.items():
        if USES_THREADS:  # which cannot be forked
            yield from ((job, Run(Stage(world, motion), job).play()) for job in those)
            continue
        with tempfile.TemporaryDirectory(prefix='flexbt_nemesis_') as scratch:
            yield from zip(those, _run_world(world, motion, those, at_once, scratch), strict=True)


def _run_world(world: str, motion: str, jobs: Sequence[Job], at_once: int, scratch: str) -> Iterator[Outcome]:
    reader, writer = os.pipe()
    pid = fork_process()
    if pid == 0:
        os.setpgid(0, 0)
        os.close(reader)
        tempfile.tempdir = scratch
        _serve(world, motion, jobs, at_once, writer)
    os.close(writer)
    left = len(jobs)
    try:
        with os.fdopen(reader, 'rb') as stream, suppress(EOFError):
            while left:
                outcome = pickle.load(stream)  # noqa: S301 - from a child of this process
                left -= 1
                yield outcome
        yield from [Outcome([Violation(9, 0.0, f'the world {world} has ended, with motion {motion}')])] * left
    finally:
        os.kill(pid, signal.SIGKILL)
        with suppress(ProcessLookupError):  # it has no children any more
            os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def warm_up() -> None:
    """Load and compile all that a mission needs, in this process."""
    with World(0, named_programs('navigate', Path(), Path(), 'abstract')) as world:
        world.start('Navigate')
        world.answer('/AskGoal', 'kitchen')
        world.run(5.0)
        world.stop()


def _serve(world: str, motion: str, jobs: Sequence[Job], at_once: int, pipe: int) -> None:
    """Run jobs in children of a world, and write what has come of them, in the order of the jobs."""
    try:
        stage = Stage(world, motion)
        waiting, running = deque(jobs), deque[Fork]()
        with os.fdopen(pipe, 'wb') as stream:
            while waiting or running:
                while waiting and len(running) < at_once:
                    running.append(stage.fork(waiting.popleft()))
                try:
                    outcome = running.popleft().result()
                except ForkError as error:
                    outcome = Outcome([Violation(9, 0.0, f'the run has failed: {error}')])
                stream.write(pickle.dumps(outcome))
                stream.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(0)


def run_one(job: Job) -> Outcome:
    """Run a job in a world of its own."""
    return next(run_all([job]))[1]
