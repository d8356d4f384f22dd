# SPDX-License-Identifier: BSD-3-Clause
"""One simulated clock, one seed, one task at a time.

A task stands for a thread: a greenlet, or with ``FLEXBT_ONE_PROCESS=threads`` a real thread that waits for a baton. It
runs until it blocks; then the next ready task runs, in the order of readiness, or in one drawn by the seed. When no
task is ready, the clock jumps to the next alarm: nobody ever waits. The same seed gives the same schedule with both.

Each switch takes :data:`STEP` of simulated time, so that a loop of two tasks does not stop the clock. A dead task is
kept to the end, since collecting a suspended greenlet would run its ``finally`` blocks.
"""

from __future__ import annotations

import _thread
import heapq
import itertools
import os
import random
import sys
import traceback
from asyncio.events import _get_running_loop, _set_running_loop
from collections import deque
from collections.abc import Callable
from math import ceil
from typing import Any, Final, TextIO

SECOND: Final = 1_000_000_000
STEP: Final = 1_000
"""Simulated time of a switch, ns."""

EPOCH: Final = 1_700_000_000 * SECOND
BOOT: Final = 1_000 * SECOND
"""Wall time and steady time at which a world begins, ns."""

MOST_SWITCHES: Final = 200_000
"""Number of switches within a millisecond of simulated time after which the tasks count as looping. STEP would allow a
thousand, except where tasks wake each other at once."""

MOST_LOOKS: Final = 1_000
"""Number of looks at the clock or at a lock after which a task that never waits is made to, for 1 ms: it may poll."""

COLLECTION: Final = 20_000
"""Number of switches after which :attr:`Scheduler.collector` is woken: about a minute of a robot that drives."""

USES_THREADS: Final = os.environ.get('FLEXBT_ONE_PROCESS') == 'threads'


class StuckWorldError(Exception):
    """Nothing in the world can happen any more, or it has passed its time limit."""


class Process:
    """A process of the world: a name, a number, and a life. ``began`` is its start on the steady clock, ns."""

    def __init__(self, name: str, pid: int, began: int) -> None:
        self.name = name
        self.pid = pid
        self.began = began
        self.is_alive = True
        self.exit_code: int | None = None
        self.arguments: list[str] = []
        self.contexts: list[Any] = []
        self.at_exit: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]] = []
        """Functions, with arguments, that are called when its main function has ended, the last one first."""
        self.kept_files: list[Callable[[], object]] = []
        """Functions that are called as it ends: they close files that others could not open, and the like."""
        self.held_up: list[Task] | None = None  # the ready tasks of a stopped process
        self.watchers: list[Callable[[bool], object]] = []
        """Functions that are told when it stops or ends (False), and when it goes on (True)."""
        self.signal: Callable[[], object] | None = None
        """Function that ends the process as SIGTERM does; None before it is set up."""
        self.pausing: list[Task] = []
        """Tasks that wait for a signal."""
        self.log: TextIO | None = None
        """File for what it prints and logs; None for the streams of the test."""

    def __repr__(self) -> str:
        return f'{self.name} ({self.pid})'

    @property
    def works(self) -> bool:
        """True if it has not ended, and is not stopped."""
        return self.is_alive and self.held_up is None


class Task:
    """A thread of a process of the world."""

    def __init__(self, number: int, name: str, process: Process) -> None:
        self.id = number
        self.name = name
        self.process = process
        self.is_done = False
        self.is_ready = False
        self.is_woken = True
        self.waits_for: object = ''
        self.answer: Any = None
        self.error: BaseException | None = None
        """What its present or next wait raises."""
        self.thread: Any = None
        self.joining: list[Task] = []
        self.baton: Any = None

    def __repr__(self) -> str:
        return f'{self.process.name}/{self.name}'


class _GreenletBaton:
    """Control of a task that is a greenlet.

    A greenlet begins at the depth of recursion of the one that switches to it first. So one starts all of them:
    otherwise tasks that start each other would reach Python's limit.
    """

    starter: Any = None

    def __init__(self, body: Callable[[], None] | None) -> None:
        from greenlet import getcurrent, greenlet

        self.greenlet = greenlet(body) if body else getcurrent()
        if self.starter is None:
            _GreenletBaton.starter = greenlet(_start)

    def take(self, _from: _GreenletBaton | None) -> None:
        if self.greenlet:  # it has begun
            self.greenlet.switch()
        else:
            self.starter.switch(self.greenlet)

    @property
    def frame(self) -> Any:
        return self.greenlet.gr_frame


def _start(first: Any) -> None:
    while True:
        first = first.switch()


class _ThreadBaton:
    """Control of a task that is a thread of the operating system. Only the thread whose lock is free runs."""

    def __init__(self, body: Callable[[], None] | None) -> None:
        self._body = body
        self.free = _thread.allocate_lock()
        self.free.acquire()
        self._ident = 0 if body else _thread.get_ident()

    def take(self, before: _ThreadBaton | None) -> None:
        if self._body is not None and not self._ident:
            self._ident = _thread.start_new_thread(self._body, ())
        else:
            self.free.release()
        if before is not None:
            before.free.acquire()

    @property
    def frame(self) -> Any:
        return _real_frames().get(self._ident)


_real_frames: Final = sys._current_frames
_Baton: Final = _ThreadBaton if USES_THREADS else _GreenletBaton


class Alarm:
    """A function to be called at a time; :meth:`cancel` prevents that."""

    __slots__ = ('fn',)

    def __init__(self, fn: Callable[[], object]) -> None:
        self.fn: Callable[[], object] | None = fn

    def cancel(self) -> None:
        self.fn = None


class Scheduler:
    """The clock, the tasks and the random numbers of a world."""

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin a new world: seed 0 keeps the order of readiness, any other one draws the order.

        The calling thread is its first task. Tasks of the world before are never continued: its processes are dead, and
        what still refers to their locks and queues wakes nobody.
        """
        for process in getattr(self, 'processes', {}).values():
            self.abandon(process)
        self.seed = seed
        self.now = BOOT
        self.jumped = 0
        """Time by which the system clock has jumped, ns."""
        self.random = random.Random(seed)
        self.shuffles = seed != 0
        self.preemption = 0.0
        """Probability of a switch where a lock is acquired or an event is set."""
        self.limit: int | None = None
        """Time at which the world counts as stuck, ns."""
        self.trace: Callable[[Task, int], object] | None = None
        self.collector: Task | None = None
        """Task that collects garbage. Python itself would do it at times that depend on what else is in memory."""
        self.pace: Callable[[int], bool] | None = None
        """Function that waits before the clock jumps to a time, ns; False: something else has come, look again."""
        self.switches = 0
        self.looks = 0
        self.tasks: list[Task] = []
        self.processes: dict[int, Process] = {}
        self._abandoned = getattr(self, '_abandoned', [])
        self._ready: deque[Task] = deque()
        self._alarms: list[tuple[int, int, Alarm]] = []
        self._numbers = itertools.count()
        self._ids = itertools.count(700_000_001)
        self._pids = itertools.count(4001)
        self._objects = itertools.count(1)
        self._still = (BOOT, 0)
        self.main = self.current = Task(next(self._ids), 'MainThread', self.process('world'))
        self.main.baton = _Baton(None)

    def process(self, name: str) -> Process:
        """Return a new process."""
        made = Process(name, next(self._pids), self.now)
        self.processes[made.pid] = made
        return made

    # -- tasks

    def spawn(self, fn: Callable[[], object], name: str, process: Process | None = None) -> Task:
        """Start a task that calls ``fn``, in the process of the caller by default."""
        task = Task(next(self._ids), name, process or self.current.process)

        def body() -> None:
            try:
                fn()
            except BaseException:
                sys.stderr.write(f'the task {task} has died:\n{traceback.format_exc()}')
            task.is_done = True
            self.tasks.remove(task)
            for waiting in task.joining:
                self.wake(waiting)
            self._give_away(None)

        task.baton = _Baton(body)
        self.tasks.append(task)
        self.make_ready(task)
        return task

    def make_ready(self, task: Task) -> None:
        """Let a task run when it is its turn."""
        if not task.is_ready and not task.is_done:
            task.is_ready = True
            self._ready.append(task)

    def wake(self, task: Task, answer: Any = None) -> bool:
        """End the wait of a blocked task with this answer. Return False if it is woken already, done, or dead."""
        if task.is_woken or task.is_done or not task.process.is_alive:
            return False
        task.is_woken = True
        task.answer = answer
        self.make_ready(task)
        return True

    def block(self, why: object, until: int | None = None) -> Any:
        """Wait for :meth:`wake` and return its answer; None at the time ``until`` of the steady clock, ns."""
        task = self.current
        task.is_woken, task.answer, task.waits_for = False, None, why
        alarm = None if until is None else self.call_at(until, lambda: self.wake(task))
        try:
            self._give_away(task)
        finally:
            if alarm is not None:
                alarm.cancel()
        return task.answer

    def throw(self, error: BaseException, task: Task | None = None) -> None:
        """Raise an error, the first of several, in a task, by default the test, where it waits or will wait next."""
        task = task or self.main
        task.error = task.error or error
        self.wake(task)

    def yield_turn(self) -> None:
        """Let the other ready tasks run."""
        if self._ready:
            self.current.is_woken = True
            self.make_ready(self.current)
            self._give_away(self.current)

    def maybe_yield(self) -> None:
        """Let other tasks run, with the probability :attr:`preemption`."""
        if self.preemption and self.random.random() < self.preemption:
            self.yield_turn()

    def look(self) -> None:
        """Count a look of the task at the clock, or at a lock that it does not wait for, or a wait of no time."""
        self.looks += 1
        if self.looks > MOST_LOOKS:
            self.looks = 0  # an alarm may look at the clock meanwhile
            self.block('what it polls for', self.now + SECOND // 1000)

    def number_of(self, one: Any) -> int:
        """Return the number of an object, a new one for one that has none: a hash that is the same in each run."""
        found = vars(one)
        if '_number_in_world' not in found:
            found['_number_in_world'] = next(self._objects)
        return int(found['_number_in_world'])

    def pick(self, count: int) -> int:
        """Return the index of one of several candidates: the first one, or one that the seed draws."""
        return self.random.randrange(count) if self.shuffles and count > 1 else 0

    def abandon(self, process: Process) -> None:
        """Never run the tasks of a process again."""
        if process.is_alive:
            process.is_alive = False
            self._tell(process, False)
        dead = [task for task in self.tasks if task.process is process and task is not self.current]
        self._abandoned += dead
        self.tasks = [task for task in self.tasks if task not in dead]

    def hold_up(self, process: Process) -> None:
        """Run no task of a process until :meth:`resume`."""
        if process.held_up is None:
            process.held_up = []
            self._tell(process, False)

    def resume(self, process: Process) -> None:
        """Let a stopped process continue."""
        held_up, process.held_up = process.held_up, None
        if held_up is not None:
            self._tell(process, True)
        for task in held_up or ():
            self.make_ready(task)

    def _tell(self, process: Process, runs: bool) -> None:
        for watcher in tuple(process.watchers):
            watcher(runs)

    def frames(self) -> dict[int, Any]:
        """Return the innermost frame of each suspended task, by its identifier, as ``sys._current_frames`` does."""
        found = {task.id: task.baton.frame for task in [*self.tasks, self.main] if task is not self.current}
        found[self.current.id] = sys._getframe(1)
        return {ident: frame for ident, frame in found.items() if frame is not None}

    def _give_away(self, task: Task | None) -> None:
        """Let the next task run; return when it is the turn of ``task`` again, never for None."""
        following = self._next()
        if following is not task:
            self.current = following
            self.switches += 1
            self.looks = 0
            self.now += STEP
            if self.collector is not None and not self.switches % COLLECTION:
                self.wake(self.collector)
            if self.trace is not None:
                self.trace(following, self.now)
            loop = _get_running_loop()  # of asyncio: that of a thread, so here that of a task
            if loop is not None:
                _set_running_loop(None)
            following.baton.take(None if task is None else task.baton)
            if loop is not None:
                _set_running_loop(loop)
        if task is not None and task.error is not None:
            error, task.error = task.error, None
            raise error

    def _next(self) -> Task:
        ready = self._ready
        while True:
            while self._alarms and self._alarms[0][0] <= self.now:
                self._sound()
            while ready:
                index = self.pick(len(ready))
                task = ready[index]
                del ready[index]
                task.is_ready = False
                if task.process.held_up is not None:
                    task.process.held_up.append(task)
                    continue
                if task.process.is_alive:
                    self._check_progress()
                    return task
                self._abandoned.append(task)
            self._advance()

    def _advance(self) -> None:
        """Jump to the next alarm. Without one, or beyond the limit, the first task gets the error."""
        while self._alarms and self._alarms[0][2].fn is None:
            heapq.heappop(self._alarms)
        if not self._alarms:
            lines = (f'  {task}: {task.waits_for}' for task in [*self.tasks, self.main])
            self.throw(StuckWorldError('nothing can happen any more; the tasks wait for:\n' + '\n'.join(lines)))
        elif self.limit is not None and self._alarms[0][0] > self.limit:
            self.limit = None
            text = f'the world has passed its limit, {(self.now - BOOT) / SECOND:.3f} s after its begin'
            self.throw(StuckWorldError(f'{text}; a longer mission needs another one: @pytest.mark.world(limit=7200)'))
        elif self.pace is None or self.pace(self._alarms[0][0]):
            self.now = max(self.now, self._alarms[0][0])
            self._sound()

    def _sound(self) -> None:
        fn = heapq.heappop(self._alarms)[2].fn
        if fn is not None:
            preemption, self.preemption = self.preemption, 0.0  # an alarm is of no task, which could wait
            try:
                fn()
            finally:
                self.preemption = preemption

    def _check_progress(self) -> None:
        since, switches = self._still
        if self.now - since > SECOND // 1000:
            self._still = (self.now, self.switches)
        elif self.switches - switches > MOST_SWITCHES:
            self._still = (self.now, self.switches)
            self.throw(
                StuckWorldError(f'{MOST_SWITCHES} switches within a millisecond: {self.current} and others loop')
            )

    # -- time

    @property
    def wall(self) -> int:
        """Wall time, ns since the epoch."""
        return EPOCH - BOOT + self.now + self.jumped

    def call_at(self, when: int, fn: Callable[[], object]) -> Alarm:
        """Call ``fn`` at a time of the steady clock, ns, between two tasks; it must not block."""
        alarm = Alarm(fn)
        heapq.heappush(self._alarms, (when, next(self._numbers), alarm))
        return alarm

    def after(self, seconds: float) -> int:
        """Return the time in this many seconds, ns, rounded up: a wait never ends early."""
        return self.now + max(0, ceil(min(seconds, 1e9) * SECOND))

    def sleep(self, seconds: float) -> None:
        """Block the task for this many seconds."""
        if seconds < 0.0:
            raise ValueError('sleep length must be non-negative')
        if seconds < STEP / SECOND:
            self.look()
        self.block('sleep', self.after(seconds))


SCHEDULER: Final = Scheduler()
"""The scheduler of this interpreter, which has one world at a time."""
