# SPDX-License-Identifier: BSD-3-Clause
"""Missions of a whole robot under faults that a seed draws: ``make nemesis SEEDS=100``.

A plan is drawn before the run: what two operators do, which processes are killed or stopped, what happens to the link,
and when. Each plan runs in a process of its own, forked from one that has run a mission already. The invariants of
:mod:`.invariants` are checked meanwhile. A plan that breaks one is shrunk, and kept with all that was recorded.
"""

from __future__ import annotations

import argparse
import faulthandler
import gc
import hashlib
import io
import json
import os
import random
import select
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from .world import World, _acting_as  # isort: skip - it prepares this interpreter

import yaml

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import ConsoleError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import AutonomyLevel, CommandKind, Decision, DecisionKind, ExecutiveState
from flexbt_console.recording.run_file import write_recording
from flexbt_console.recording.topics import TOPICS
from flexbt_msgs.msg import ExecutiveLog

from .graph import DOMAIN
from .invariants import Observer, Violation
from .mutations import MUTATIONS, Mutation
from .programs import robot_programs
from .scheduler import BOOT, EPOCH, SCHEDULER, SECOND, StuckWorldError

SECONDS: Final = 14.0
"""Simulated time in which the steps of a plan happen, s."""

_REAL_SECONDS: Final = 300
"""Real time after which a run is ended, s: something computes without end."""

_SETTLE_SECONDS: Final = 8.0
"""Simulated time from the last fault until the mission must work again, s."""

_PLACES: Final = ('kitchen', 'office', 'store', 'lounge')
_BEHAVIORS: Final = ('Navigate', 'Navigate', 'Navigate Split')
_PROCESSES: Final = ('bt_server', 'navigation', 'onboard_executive', 'stop_guard', 'simulator')
_FAULTS: Final = ('kill', 'kill', 'hang', 'hang', 'terminate', 'cut', 'loss', 'delay', 'rate')
_ACTS: Final = ('stop', 'stop', 'pause', 'resume', 'force', 'start', 'autonomy', 'repeat', 'claim', 'release', 'resend')


@dataclass(frozen=True)
class Step:
    """Something that happens at a time (s, from when the robot is ready): a fault, or what an operator does.

    ``target`` is a process, a link or an operator. ``amount``: how long a fault lasts, s; for an operator's step a
    number from 0 to 1 that decides among what is possible then.
    """

    time: float
    act: str
    target: str
    amount: float


@dataclass(frozen=True)
class Plan:
    """All that happens in a run."""

    seed: int
    behavior: str = 'Navigate'
    autonomy: str = 'HIGH'
    preemption: float = 0.0
    seconds: float = SECONDS
    steps: tuple[Step, ...] = ()
    answers: tuple[tuple[float, str], ...] = ((0.3, 'kitchen'), (0.3, 'office'))
    """Delay (s) and place of each answer, in order; then the operators answer nothing more."""

    @classmethod
    def draw(cls, seed: int, seconds: float = SECONDS) -> Plan:
        """Draw the plan of a seed."""
        draw = random.Random(f'plan {seed}')

        def step(acts: Sequence[str], targets: Sequence[str]) -> Step:
            act = draw.choice(acts)
            is_link = act in ('cut', 'loss', 'delay', 'rate')
            amount = draw.random() if targets is _OPERATORS else min(draw.expovariate(0.5), 8.0)
            target = 'operator' if is_link else draw.choice(targets)
            return Step(round(draw.uniform(0.0, seconds), 3), act, target, round(amount, 3))

        faults = [step(_FAULTS, _PROCESSES) for _ in range(draw.choice((0, 1, 1, 2, 3)))]
        acts = [step(_ACTS, _OPERATORS) for _ in range(draw.choice((0, 1, 2, 3, 5)))]
        return cls(
            seed=seed,
            behavior=draw.choice(_BEHAVIORS),
            autonomy=draw.choice(('LOW', 'HIGH', 'FULL')),
            preemption=draw.choice((0.0, 0.02, 0.1)),
            seconds=seconds,
            steps=tuple(sorted([*faults, *acts], key=lambda one: one.time)),
            answers=tuple((round(draw.uniform(0.0, 1.5), 3), draw.choice(_PLACES)) for _ in range(4)),
        )

    def text(self) -> str:
        """Return the plan as YAML."""
        return str(yaml.safe_dump(json.loads(json.dumps(asdict(self))), sort_keys=False, default_flow_style=None))

    @classmethod
    def read(cls, text: str) -> Plan:
        """Return the plan of a YAML text. Raises what YAML and the constructor raise for others."""
        found = yaml.safe_load(text)
        found['steps'] = tuple(Step(**one) for one in found['steps'])
        found['answers'] = tuple((delay, place) for delay, place in found['answers'])
        return cls(**found)


_OPERATORS: Final = ('engineer', 'engineer', 'pilot')


class _Operator:
    """An operator who acts by plan, on what is on display then."""

    def __init__(self, name: str, mirror: Mirror, link: ExecutiveLink) -> None:
        self.mirror, self.commands = mirror, {}  # type: Mirror, dict[str, Any]
        self._link = link
        self._make = CommandBuilder(name)
        self._last: Any = None
        self.answered: set[tuple[str, str]] = set()

    def give(self, make: Callable[[CommandBuilder, Any], Any]) -> bool:
        """Send a command, if what is on display allows it; return whether it was sent."""
        try:
            command = make(self._make, self.mirror.view())
        except ConsoleError:
            return False
        self._last = command
        self.commands[command.id] = self._link.send(command, 6.0)
        return True

    def act(self, act: str, amount: float) -> None:
        """Do what a step of a plan says; nothing if that is not possible now."""
        match act:
            case 'stop' | 'pause':
                self.give(lambda make, view: make.command(view, CommandKind[act.upper()]))
            case 'resume':
                self.give(lambda make, view: make.resume(view))
            case 'claim' | 'release':
                self.give(lambda make, view: make.command(view, CommandKind[f'{act.upper()}_AUTHORITY']))
            case 'autonomy':
                level = list(AutonomyLevel)[int(amount * 4)]
                self.give(lambda make, view: make.autonomy(view, level))
            case 'start':
                self.start('Navigate', AutonomyLevel.HIGH)
            case 'repeat':
                self.give(lambda make, view: make.repeat(view))
            case 'force':
                self.give(lambda make, view: make.force(view, '', self._outcome(view, amount)))
            case 'resend' if self._last is not None:  # as a console does that has missed the answer
                self._link._runtime.call(lambda: self._link._publish(self._last))

    def start(self, behavior: str, level: AutonomyLevel) -> bool:
        """Start a behavior."""
        return self.give(lambda make, view: make.start(view, behavior, (), level))

    def answer(self, decision: Decision, place: str) -> None:
        """Answer a question with a place, or confirm what a state suggests."""
        snapshot = self.mirror.view().snapshot
        self.answered.add((snapshot.run_id if snapshot else '', decision.id))
        if decision.kind is DecisionKind.INPUT:
            self.give(lambda make, view: make.answer(view, decision.id, place, unseen=True))
        else:
            outcome = decision.outcome or decision.outcomes[0]
            self.give(lambda make, view: make.choose(view, decision, outcome, unseen=True))

    def question(self) -> Decision | None:
        """Return the oldest decision that this operator has not answered."""
        view = self.mirror.view()
        run = view.snapshot.run_id if view.snapshot else ''
        return next((one for one in view.decisions if (run, one.id) not in self.answered), None)

    def results(self) -> dict[str, int | None]:
        """Return the result of each command, None if it is not known."""
        codes = {'APPLIED': 1, 'REFUSED': 2}
        known = {one: self.mirror.command(one) for one in self.commands}
        return {one: codes.get(tracked.state.name) if tracked else None for one, tracked in known.items()}

    @staticmethod
    def _outcome(view: Any, amount: float) -> str:
        outcomes = view.outcomes(view.active_paths[0]) if view.active_paths else ()
        return str(outcomes[int(amount * len(outcomes))]) if outcomes else 'done'


@dataclass
class Outcome:
    """What has come of a run."""

    violations: list[Violation] = field(default_factory=list)
    seconds: float = 0.0
    processor: float = 0.0
    hash: str = ''
    story: list[tuple[float, str]] = field(default_factory=list)

    @property
    def broken(self) -> set[int]:
        """The numbers of the invariants that did not hold."""
        return {one.number for one in self.violations}


class _Run:
    """A run of a plan in this process."""

    def __init__(self, plan: Plan, keep: Path | None = None) -> None:
        self._plan = plan
        self._keep = keep
        self._outcome = Outcome()
        self._is_mended = False
        self._recorded: list[tuple[int, str, Any]] = []
        self._hash = hashlib.sha256()

    def play(self) -> Outcome:
        began = os.times()
        gc.disable()  # when it runs depends on what else is in memory
        errors = sys.stderr = io.StringIO()
        home = Path(tempfile.mkdtemp(prefix='flexbt_nemesis_'))
        SCHEDULER.limit = None
        programs = robot_programs(executive={'journal_directory': str(home), 'event_log_directory': str(home)})
        self._world = world = World(self._plan.seed, programs, writable=[home])
        SCHEDULER.limit = SCHEDULER.after(250.0)
        SCHEDULER.trace = lambda task, now: self._hash.update(b'%d %d;' % (task.id, now))
        self._observer = Observer(world, home, self._record)
        try:
            self._in_world()
        except StuckWorldError as error:
            self._observer.say(9, f'{error}'[:600])
        finally:
            sys.stderr = sys.__stderr__
        if 'has died' in errors.getvalue():
            self._observer.say(9, errors.getvalue()[-1500:])
        ended = os.times()
        self._outcome.processor = ended.user + ended.system - began.user - began.system
        self._outcome.hash = self._hash.hexdigest()[:16]
        self._outcome.violations = self._observer.violations
        if self._keep is not None:
            self._save(home, errors.getvalue())
        shutil.rmtree(home, ignore_errors=True)
        return self._outcome

    def _in_world(self) -> None:
        plan, world = self._plan, self._world
        with world:
            engineer = _Operator('engineer', world.mirror, world._link)
            with _acting_as(SCHEDULER.process('operator 2')):
                station = NodeRuntime('operator_2', args=[])
                mirror = Mirror(station.steady)
                pilot = _Operator('pilot', mirror, ExecutiveLink(station, mirror, 'pilot'))
            world.run_until(lambda _view: mirror.view().live and mirror.view().behaviors is not None, 30.0)
            self._operators = {'engineer': engineer, 'pilot': pilot}
            self._observer.begin([world.mirror, mirror])
            SCHEDULER.preemption = plan.preemption
            try:
                self._play_plan(engineer)
            except AssertionError as error:
                self._observer.say(10, f'{error}'[:600])
            self._observer.finish({**engineer.results(), **pilot.results()})
            self._observer.end()
            station.close()
        codes = {name: process.exit_code for name, process in world.processes.items()}
        if any(codes.values()):
            self._observer.say(9, f'exit codes {codes}')
        ended = [process for process in world.processes.values() if process.exit_code == 0]
        if left := [node.get_fully_qualified_name() for node in DOMAIN.nodes if node.process in ended]:
            self._observer.say(9, f'nodes that were not ended: {", ".join(left)}')
        self._outcome.seconds = world.now

    def _play_plan(self, engineer: _Operator) -> None:
        plan, world, operators = self._plan, self._world, self._operators
        self._say(f'plan {plan.seed}: {plan.behavior} at {plan.autonomy}')
        begin = world.now
        for step in plan.steps:
            world.at(begin + step.time, lambda step=step: self._happen(step))  # type: ignore[misc]
        engineer.start(plan.behavior, AutonomyLevel[plan.autonomy])
        world.at(world.now, lambda: self._answer(engineer, list(plan.answers)))
        last = max((step.time + step.amount for step in plan.steps if step.target not in operators), default=0.0)
        world.run(max(plan.seconds, last) + 0.1)
        self._mend()
        world.run(_SETTLE_SECONDS)
        self._check_usable(engineer)

    def _happen(self, step: Step) -> None:
        world, process = self._world, self._world.processes.get(step.target)
        self._say(f'{step.act} {step.target} ({step.amount:.3f})')
        if step.target in self._operators:
            self._operators[step.target].act(step.act, step.amount)
        elif step.act == 'cut':
            self._world.network.cut(step.amount)
        elif step.act in ('loss', 'delay', 'rate'):
            value = {'loss': step.amount / 16.0, 'delay': step.amount / 16.0, 'rate': 20.0 + 20.0 * step.amount}
            setattr(self._world.network.link(), step.act, value[step.act])
            SCHEDULER.sleep(step.amount)
            setattr(self._world.network.link(), step.act, 0.0)
        elif process is None or not process.is_alive or process.held_up is not None:
            return
        elif step.act == 'hang':
            self._observer.hangs(step.target, step.amount)
            world.hold_up(step.target)
            SCHEDULER.sleep(step.amount)
            SCHEDULER.resume(process)
            self._say(f'{step.target} goes on')
        else:
            self._observer.killed(step.target)
            if step.act == 'kill':
                world.kill(step.target)
            else:
                world.terminate(step.target)
                SCHEDULER.sleep(2.5)
            SCHEDULER.sleep(step.amount / 2.0)
            self._restart(step.target)

    def _restart(self, name: str) -> None:
        if not self._world.processes[name].is_alive:
            self._world.restart(name)
            self._say(f'{name} starts again')

    def _mend(self) -> None:
        """End all faults."""
        self._is_mended = True
        for name, process in list(self._world.processes.items()):
            if process.is_alive and process.held_up is not None:
                SCHEDULER.resume(process)
            self._restart(name)
        self._say('all faults have ended')

    def _has_mended(self) -> bool:
        return self._is_mended

    def _answer(self, operator: _Operator, answers: list[tuple[float, str]]) -> None:
        """Answer questions by plan, one after the other."""
        while answers and not self._has_mended():
            decision = operator.question()
            if decision is None:
                SCHEDULER.sleep(0.1)
                continue
            delay, place = answers.pop(0)
            SCHEDULER.sleep(delay)
            if not self._has_mended():
                self._say(f'answers {decision.path}: {place}')
                operator.answer(decision, place)

    def _check_usable(self, operator: _Operator) -> None:
        """Start a mission, drive, and stop it: everything must work again."""
        world = self._world
        self._operators['pilot'].act('release', 0.0)
        world.run_until(lambda view: bool(view.snapshot and view.snapshot.authority in ('', 'engineer')), 10.0)
        self._end_run(operator)
        self._say('a mission that must work')
        assert operator.start('Navigate', AutonomyLevel.HIGH), 'a behavior cannot be started'
        world.run_until(lambda _view: operator.question() is not None, 30.0)
        decision = operator.question()
        length = world.robot.length
        assert decision is not None
        pose = world.robot.pose
        assert pose is not None
        far = max(_PLACES, key=lambda place: world.place(place).distance(pose))
        operator.answer(decision, far)
        world.run_until(lambda _view: world.robot.length > length + 0.3, 30.0)
        self._end_run(operator)
        world.run(1.5)
        assert world.robot.at_rest, 'the robot moves after the last stop'

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
        self._outcome.story.append((round(self._world.now, 3), text))
        if self._keep is not None:
            stamp = self._world.now
            line = ExecutiveLog(severity=ExecutiveLog.WARN, path='/nemesis', text=text)
            line.stamp.sec, line.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
            self._recorded.append((EPOCH + SCHEDULER.now - BOOT, 'executive/log', line))

    def _record(self, name: str, sample: Any) -> None:
        if self._keep is not None and name in TOPICS and name not in ('scan', 'tf'):
            self._recorded.append((EPOCH + SCHEDULER.now - BOOT, name, sample.message()))

    def _save(self, home: Path, errors: str) -> None:
        assert self._keep is not None
        shutil.rmtree(self._keep, ignore_errors=True)
        self._keep.mkdir(parents=True)
        (self._keep / 'plan.yaml').write_text(self._plan.text())
        lines = [(when, f'nemesis: {text}') for when, text in self._outcome.story]
        lines += [(one.time, f'VIOLATION {one}') for one in self._outcome.violations]
        lines += [((when - BOOT) / SECOND, f'{process} {name}: {text}') for when, process, _, name, text in DOMAIN.log]
        told = '\n'.join(f'{when:9.3f} {text}' for when, text in sorted(lines, key=lambda line: line[0]))
        (self._keep / 'log.txt').write_text(f'{told}\n{errors}')
        for file in home.rglob('*'):
            if file.is_file():
                shutil.copy(file, self._keep / file.name)
        write_recording(self._keep / 'run.mcap', self._recorded)


# ----------------------------------------------------------------------------------------- runs in forked processes


@dataclass(frozen=True)
class Job:
    """A run that is wanted: of a plan, of a changed product, with what is kept of it."""

    plan: Plan
    mutation: Mutation | None = None
    keep: Path | None = None


def _child(job: Job, pipe: int) -> None:
    faulthandler.dump_traceback_later(_REAL_SECONDS, exit=True, file=2)
    try:
        if job.mutation is not None:
            job.mutation.apply()
        outcome = _Run(job.plan, job.keep).play()
    except BaseException as error:
        outcome = Outcome([Violation(9, 0.0, f'the run has ended by {error!r}')])
    data = asdict(outcome)
    with os.fdopen(pipe, 'w') as stream:
        json.dump(data, stream)
    os._exit(0)


def run_all(jobs: Iterable[Job], at_once: int = 1) -> Iterator[tuple[Job, Outcome]]:
    """Run jobs in forked processes, some at once; yield them as they end."""
    waiting, running = iter(jobs), {}  # type: Iterator[Job], dict[int, tuple[Job, int, list[bytes]]]
    while True:
        while len(running) < at_once and (job := next(waiting, None)) is not None:
            reader, writer = os.pipe()
            vars(threading)['_active'][SCHEDULER.current.id] = vars(threading)['_main_thread']  # it looks there
            pid = os.fork()
            if pid == 0:
                _child(job, writer)
            os.close(writer)
            running[reader] = (job, pid, [])
        if not running:
            return
        for reader in select.select(list(running), [], [])[0]:
            job, pid, parts = running[reader]
            data = os.read(reader, 65536)
            parts.append(data)
            if not data:
                os.close(reader)
                os.waitpid(pid, 0)
                del running[reader]
                yield job, _outcome(b''.join(parts))


def _outcome(data: bytes) -> Outcome:
    if not data:
        return Outcome([Violation(9, 0.0, f'the run has not ended within {_REAL_SECONDS} s of real time, or crashed')])
    found = json.loads(data)
    found['violations'] = [Violation(**one) for one in found['violations']]
    return Outcome(**found)


def run_one(job: Job) -> Outcome:
    """Run a job in a forked process."""
    return next(run_all([job]))[1]


def shrink(plan: Plan, broken: set[int], say: Callable[[str], object], most: int = 40) -> Plan:
    """Return a smaller plan that breaks one of the same invariants: fewer steps, shorter ones, nothing drawn."""
    tried: dict[Plan, bool] = {}

    def still(candidate: Plan) -> bool:
        if candidate not in tried:
            if len(tried) >= most:
                return False
            tried[candidate] = bool(run_one(Job(candidate)).broken & broken)
            say(f'  {len(candidate.steps)} steps, {candidate.seconds:g} s: {"still" if tried[candidate] else "not"}')
        return tried[candidate]

    size = len(plan.steps)
    while size:
        begin = 0
        while begin < len(plan.steps):
            fewer = replace(plan, steps=plan.steps[:begin] + plan.steps[begin + size :])
            plan, begin = (fewer, begin) if still(fewer) else (plan, begin + size)
        size //= 2
    for simpler in ({'preemption': 0.0}, {'answers': plan.answers[:1]}, {'behavior': 'Navigate'}, {'autonomy': 'HIGH'}):
        candidate = replace(plan, **simpler)
        plan = candidate if candidate != plan and still(candidate) else plan
    for index, step in enumerate(plan.steps):
        if step.target not in _OPERATORS:
            short = replace(step, amount=round(step.amount / 2.0, 3))
            candidate = replace(plan, steps=(*plan.steps[:index], short, *plan.steps[index + 1 :]))
            plan = candidate if still(candidate) else plan
    last = max((step.time + 3.0 for step in plan.steps), default=5.0)
    candidate = replace(plan, seconds=min(plan.seconds, last))
    return candidate if candidate != plan and still(candidate) else plan


def warm_up() -> None:
    """Load and compile all that a mission needs, in this process."""
    with World() as world:
        world.start('Navigate')
        world.answer('/AskGoal', 'kitchen')
        world.run(5.0)
        world.stop()
    gc.collect()
    gc.freeze()


def _again(seed: int, seconds: float) -> str:
    """Return the hash of the run of a seed in another interpreter, with another hash of strings."""
    words = [sys.executable, '-m', __spec__.name, '--seed', str(seed), '--seconds', str(seconds), '--hash']
    environment = {**os.environ, 'PYTHONHASHSEED': str(seed + 1)}
    return subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout.split()[-1]


def hunt(seeds: range, seconds: float, jobs: int, out: Path, say: Callable[[str], object], shrinks: bool) -> int:
    """Run the plans of seeds, shrink and keep those that break an invariant; return how many do."""
    bad, simulated, processor, began = [], 0.0, 0.0, os.times().elapsed
    for job, outcome in run_all((Job(Plan.draw(seed, seconds)) for seed in seeds), jobs):
        seed = job.plan.seed
        simulated, processor = simulated + outcome.seconds, processor + outcome.processor
        told = f'{seed:6}  {outcome.seconds:5.1f} s in {outcome.processor:5.2f} s  {outcome.hash}'
        say('\n    '.join([told, *map(str, outcome.violations)]))
        if outcome.violations:
            bad.append((job.plan, outcome.broken))
        if seed % 100 == 0 and outcome.hash != (other := _again(seed, seconds)):
            say(f'    12: with another PYTHONHASHSEED the hash is {other}')
            bad.append((job.plan, set()))
    for plan, broken in bad:
        small = plan if not shrinks else shrink(plan, broken, say)
        directory = out / str(plan.seed)
        run_one(Job(small, keep=directory))
        say(f'{plan.seed}: {directory}, {len(small.steps)} steps:\n{small.text()}')
    say(
        f'{len(seeds)} seeds, {len(bad)} with violations; {simulated:.0f} s simulated in '
        f'{processor:.0f} s of processor, {os.times().elapsed - began:.0f} s of real time'
    )
    return len(bad)


_PROVOCATIONS: Final[dict[str, tuple[tuple[float, str, str, float], ...]]] = {
    'stop': ((5.0, 'stop', 'engineer', 0.0),),
    'force': ((4.0, 'force', 'engineer', 0.9),),
    'pause': ((4.0, 'pause', 'engineer', 0.0), (8.0, 'resume', 'engineer', 0.0)),
    'refused': ((2.0, 'start', 'pilot', 0.0), (3.0, 'resume', 'pilot', 0.0)),
    'authority': (
        (2.0, 'claim', 'engineer', 0.0),
        (3.0, 'claim', 'pilot', 0.0),
        (3.5, 'autonomy', 'pilot', 0.9),
        (4.0, 'force', 'pilot', 0.9),
        (7.0, 'release', 'engineer', 0.0),
    ),
    'resend': ((3.0, 'force', 'engineer', 0.9), (4.0, 'resend', 'engineer', 0.0), (5.0, 'resend', 'engineer', 0.0)),
    'resend_crash': (
        (3.0, 'stop', 'engineer', 0.0),
        (4.0, 'kill', 'onboard_executive', 1.0),
        (5.5, 'resend', 'engineer', 0.0),
    ),
    'kill_bt': ((4.0, 'kill', 'bt_server', 4.0),),
    'kill_navigation': ((4.0, 'kill', 'navigation', 8.0),),
    'kill_executive': ((4.0, 'kill', 'onboard_executive', 4.0),),
    'crash_after_stop': ((4.0, 'stop', 'engineer', 0.0), (6.0, 'kill', 'onboard_executive', 1.0)),
    'hang_bt': ((4.0, 'hang', 'bt_server', 3.5), (4.02, 'stop', 'engineer', 0.0)),
    'hang_navigation': ((4.0, 'hang', 'navigation', 3.0), (4.02, 'stop', 'engineer', 0.0)),
    'hang_executive': ((4.0, 'hang', 'onboard_executive', 3.5), (4.02, 'stop', 'engineer', 0.0)),
    'long_hang': ((3.0, 'hang', 'onboard_executive', 8.0),),
    'cut': ((3.0, 'cut', 'operator', 6.0), (3.2, 'kill', 'onboard_executive', 1.0)),
    'delay': (
        (1.0, 'delay', 'operator', 7.0),
        (2.5, 'force', 'engineer', 0.9),
        (4.0, 'kill', 'onboard_executive', 1.0),
    ),
    'preempted': ((3.0, 'force', 'engineer', 0.9), (5.0, 'stop', 'engineer', 0.0)),
}
"""Plans that provoke mutations: time, act, target and amount of their steps."""


def provocation(name: str) -> Plan:
    """Return one of :data:`_PROVOCATIONS`."""
    steps = tuple(Step(*step) for step in _PROVOCATIONS[name])
    plan = Plan(1 + list(_PROVOCATIONS).index(name), preemption=0.02, seconds=9.0, steps=steps)
    return replace(plan, preemption=0.2) if name == 'preempted' else plan


def judge(jobs: int, say: Callable[[str], object], only: str = '') -> int:
    """Run mutations of the product, and print which invariants find them; return how many none finds.

    First all plans run with the unchanged product, which must break no invariant.
    """
    for job, outcome in run_all((Job(provocation(name)) for name in _PROVOCATIONS), jobs):
        if outcome.violations:
            say(f'unchanged, plan {list(_PROVOCATIONS)[job.plan.seed - 1]}: {", ".join(map(str, outcome.violations))}')
    mutations = [one for one in MUTATIONS if only in one.name]
    wanted = [Job(provocation(plan), mutation) for mutation in mutations for plan in mutation.plans.split()]
    found: dict[Mutation, list[set[int]]] = {}
    for job, outcome in run_all(wanted, jobs):
        assert job.mutation is not None
        of_mutation = found.setdefault(job.mutation, [])
        of_mutation.append(outcome.broken)
        if len(of_mutation) == len(job.mutation.plans.split()):
            numbers = sorted(set().union(*of_mutation))
            hits = f'{sum(map(bool, of_mutation))} of {len(of_mutation)} plans'
            say(f'{job.mutation.name:48} {", ".join(map(str, numbers)) or "not found":14} {hits}')
    missed = sum(not any(those) for those in found.values())
    say(f'{len(found)} mutations, {missed} not found')
    return missed


def main() -> int:
    """Run what the command line asks for. Return the exit code."""
    parser = argparse.ArgumentParser(prog='nemesis', description=(__doc__ or '').split('\n\n')[0])
    parser.add_argument('--seeds', type=int, default=0, help='number of seeds to run, from --seed on')
    parser.add_argument('--seed', type=int, default=0, help='the first seed, or the only one')
    parser.add_argument('--seconds', type=float, default=SECONDS, help='simulated time of the faults, s')
    parser.add_argument('--jobs', type=int, default=2, help='runs at once')
    parser.add_argument('--plan', type=Path, help='run this plan, such as out/nemesis/7/plan.yaml, instead of a seed')
    parser.add_argument('--mutants', nargs='?', const='', help='run mutations of the product, those with this text')
    parser.add_argument('--hash', action='store_true', help='print nothing but the hash of the run')
    parser.add_argument('--as-drawn', action='store_true', help='do not shrink the plans that break an invariant')
    parser.add_argument('--out', type=Path, default=Path('out/nemesis'), help='directory of what is kept')
    given = parser.parse_args()
    warm_up()

    def say(text: str) -> None:
        print(text, flush=True)

    seeds = range(given.seed, given.seed + (given.seeds or 1))
    if given.mutants is not None:
        return min(judge(given.jobs, say, given.mutants), 1)
    if given.seeds:
        return min(hunt(seeds, given.seconds, given.jobs, given.out, say, not given.as_drawn), 1)
    plan = Plan.read(given.plan.read_text()) if given.plan else Plan.draw(given.seed, given.seconds)
    outcome = run_one(Job(plan, keep=None if given.hash else given.out / str(plan.seed)))
    if not given.hash:
        say(plan.text())
        for when, text in outcome.story:
            say(f'{when:9.3f} {text}')
        for violation in outcome.violations:
            say(f'VIOLATION {violation}')
    say(outcome.hash)
    return int(bool(outcome.violations))


if __name__ == '__main__':
    sys.exit(main())
