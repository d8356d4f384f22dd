# SPDX-License-Identifier: BSD-3-Clause
"""Synthesis of behaviors for the library, one search at a time, each in a separate process."""

from __future__ import annotations

import contextlib
import json
import math
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from importlib.metadata import entry_points
from typing import Any, Final

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.values.text import one_line
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary, machine_entry
from flexbt_onboard.behaviors.machine_store import MACHINE_LENGTH, MachineStore, check_name
from flexbt_onboard.errors import BehaviorError, CommandRefusedError, OnboardError
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.reporter import Reporter

SEARCH_GROUP: Final = 'flexbt.synthesis'
"""Entry point group of the module that runs a search as a separate program: see flexbt_formal.requests.search."""

DEFAULT_SECONDS: Final = 60.0
MOST_SECONDS: Final = 3600.0


class SynthesisVerdict(Enum):
    """The verdict at the end of a search. The search process uses the same values."""

    MADE = 'made'
    UNREALIZABLE = 'unrealizable'
    WRONG = 'wrong'
    CANCELED = 'canceled'
    FAULT = 'fault'


@dataclass(frozen=True)
class SynthesisAnswer:
    """The answer to a request. ``message`` is the reason if there was no machine.

    ``states`` are the fields of FlexBE's StateInstantiation.
    """

    verdict: SynthesisVerdict
    message: str = ''
    behavior: str = ''
    machine: str = ''
    notes: Sequence[str] = ()
    explanation: Sequence[str] = ()
    states: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class SearchRequest:
    """A request for a synthesis; see SynthesizeBehavior.

    Without ``is_kept``, the machine does not become a behavior of the library, and ``name`` only appears in messages.
    """

    system: str = ''
    capabilities: str = ''
    specification: str = ''
    goals: Sequence[str] = ()
    initial_conditions: Sequence[str] = ()
    outcomes: Sequence[str] = ()
    liveness: str = 'fair'
    retries: int | None = None
    name: str = ''
    seconds: float = 0.0
    by: str = ''
    is_kept: bool = True


@dataclass(frozen=True)
class SearchSettings:
    """The settings of searches: directories of capability files, and the memory limit of a search in bytes."""

    directories: Sequence[str] = ()
    memory: int = 4_000_000_000


@dataclass(eq=False)
class RunningSearch:
    """A running search. ``on_progress`` and ``on_end`` are called on the executor thread, the latter once."""

    request: SearchRequest
    on_progress: Callable[[str, float], None]
    on_end: Callable[[SynthesisAnswer], None]
    began: float
    name: str = ''
    process: SearchProcess | None = field(default=None)
    why_canceled: str = 'it was canceled'

    def cancel(self, why: str = '') -> None:
        """Cancel the search. The answer contains ``why``."""
        self.why_canceled = why or self.why_canceled
        if self.process is not None:
            self.process.cancel()


class Synthesizer:
    """A synthesizer of behaviors. Used on the executor thread."""

    def __init__(
        self,
        runtime: Runtime,
        library: BehaviorLibrary,
        store: MachineStore,
        report: Reporter,
        in_use: Callable[[], set[str]],
        link: ConsoleLink,
        settings: SearchSettings,
    ) -> None:
        """``in_use`` returns the names of the behaviors that run, were interrupted, or are in the mission queue. Their
        machines are neither replaced nor removed: an operator has seen what is started."""
        self._runtime = runtime
        self._library = library
        self._store = store
        self._report = report
        self._in_use = in_use
        self._link = link
        self._settings = settings
        self._search: RunningSearch | None = None
        runtime.on_close(self._close)
        self._restore()

    def _restore(self) -> None:
        """Add the stored behaviors of earlier processes to the library."""
        problems: list[str] = []
        try:
            entries, problems = self._store.entries()
            for entry in entries:
                try:
                    self._library.add(entry)
                except BehaviorError as error:
                    problems.append(f'synthesized behavior {entry.name!r}: {error}')
        except OSError as error:
            problems.append(f'the synthesized behaviors cannot be read: {error}')
        for problem in problems:
            self._report.log(ExecutiveLog.WARN, problem)

    def begin(
        self,
        request: SearchRequest,
        on_progress: Callable[[str, float], None],
        on_end: Callable[[SynthesisAnswer], None],
    ) -> RunningSearch:
        """Begin a search.

        Raises:
            CommandRefusedError: the search cannot begin; the text has the reason.
        """
        if self._search is not None:
            raise CommandRefusedError(
                f'another synthesis is under way, of {self._search.name!r}{_by(self._search.request)}; cancel it '
                '(synthesize --cancel), or wait for its end'
            )
        if bool(request.system) == bool(request.capabilities):
            raise CommandRefusedError('say either which system it is, or give the text of its capabilities')
        if not (math.isfinite(request.seconds) and 0.0 <= request.seconds <= MOST_SECONDS):
            raise CommandRefusedError(f'time_limit has to be 0 to {MOST_SECONDS:g} s, not {request.seconds:g}')
        name = request.name or request.system.rpartition('/')[2].partition('.')[0] or 'Synthesized'
        if request.is_kept:
            self._check_name(name)
        seconds = request.seconds or DEFAULT_SECONDS
        search = RunningSearch(request, on_progress, on_end, self._runtime.steady.now(), name)
        asked = {
            **asdict(request),
            **asdict(self._settings),
            'name': name,
            'seconds': seconds,
            'with_states': not request.is_kept,
        }
        search.process = SearchProcess(
            _installed_command(),
            asked,
            seconds,
            lambda message: self._runtime.post(lambda: self._tell(search, message)),
            lambda answer, why: self._finish(search, answer, why),
        )
        self._search = search
        what = one_line(', '.join(request.goals) or 'what its specification says', 200)
        self._report.log(ExecutiveLog.INFO, f'synthesis of {name!r} for {what}{_by(request)}')
        return search

    def _check_name(self, name: str) -> None:
        try:
            check_name(name)
            self._library.check_free(name)
        except OnboardError as error:
            raise CommandRefusedError(str(error)) from error
        if name in self._in_use():
            raise CommandRefusedError(
                f'behavior {name!r} runs, was interrupted, or is in the mission queue: give another name'
            )

    def _close(self) -> None:
        search = self._search
        if search is not None:
            search.cancel()

    def _tell(self, search: RunningSearch, message: SearchMessage) -> None:
        if self._search is search:
            search.on_progress(one_line(str(message.get('doing', '')), 200), self._runtime.steady.now() - search.began)

    # -- the end -----------------------------------------------------------------------------------------------------

    def _finish(self, search: RunningSearch, message: SearchMessage | None, why: str) -> None:
        """Store the machine. Runs on the thread of the search, so that a slow disk delays nothing else."""
        gone: list[str] = []
        problem = ''
        try:
            answer = _answer(message, why, search)
            if answer.verdict is SynthesisVerdict.MADE and search.request.is_kept:
                in_use = self._runtime.call(lambda: self._add(search.name, answer.machine))
                gone = self._store.keep(search.name, answer.machine, in_use)
        except OnboardError as error:
            answer = SynthesisAnswer(SynthesisVerdict.WRONG, str(error))
        except (OSError, RuntimeError) as error:
            problem = f'behavior {search.name!r} will not outlast the executive: {error}'
        except Exception as error:  # otherwise no other search could begin
            answer = SynthesisAnswer(SynthesisVerdict.FAULT, f'fault of the search: {error!r}')
        self._runtime.post(lambda: self._end(search, answer, gone, problem))

    def _add(self, name: str, machine: str) -> set[str]:
        """Add the behavior to the library, and return the names of the behaviors in use.

        This happens before it is stored, so that an operator who starts it now starts the machine that is stored.

        Raises:
            OnboardError: a behavior of this name was started or queued meanwhile, or is installed.
        """
        in_use = self._in_use()
        if name in in_use:
            raise CommandRefusedError(f'behavior {name!r} was started meanwhile, or queued: give another name')
        self._library.add(machine_entry(name, machine))
        return in_use

    def _end(self, search: RunningSearch, answer: SynthesisAnswer, gone: Sequence[str], problem: str) -> None:
        self._search = None
        if answer.verdict is SynthesisVerdict.MADE and search.request.is_kept:
            for name in gone:
                self._library.remove(name)
            self._link.publish(self._library.to_message())
        if problem:
            self._report.log(ExecutiveLog.WARN, problem)
        self._report.log(*_said(search.name, answer))
        self._report.event(
            'synthesis',
            name=search.name,
            goals=list(search.request.goals),
            operator=search.request.by,
            outcome=answer.verdict.value,
            message=answer.message,
            seconds=round(self._runtime.steady.now() - search.began, 3),
        )
        search.on_end(answer)


def _answer(message: SearchMessage | None, why: str, search: RunningSearch) -> SynthesisAnswer:
    if message is None:
        return (
            SynthesisAnswer(SynthesisVerdict.FAULT, why)
            if why
            else SynthesisAnswer(SynthesisVerdict.CANCELED, search.why_canceled)
        )
    machine = str(message.get('machine', ''))
    if len(machine) > MACHINE_LENGTH:
        return SynthesisAnswer(
            SynthesisVerdict.WRONG, f'the machine has {len(machine)} characters; at most {MACHINE_LENGTH} are taken'
        )
    return SynthesisAnswer(
        SynthesisVerdict(message['code']),
        str(message.get('message', '')),
        search.name if machine else '',
        machine,
        [str(note) for note in message.get('notes', ())],
        [str(line) for line in message.get('explanation', ())],
        message.get('states', ()),
    )


def _said(name: str, answer: SynthesisAnswer) -> tuple[int, str]:
    if answer.verdict is SynthesisVerdict.MADE:
        return ExecutiveLog.INFO, f'synthesis of {name!r}: there is a machine'
    severity = ExecutiveLog.ERROR if answer.verdict is SynthesisVerdict.FAULT else ExecutiveLog.INFO
    return severity, one_line(f'synthesis of {name!r}: {answer.message}', 500)


def _by(request: SearchRequest) -> str:
    return one_line(f', by operator {request.by}', 200) if request.by else ''


def _installed_command() -> Sequence[str]:
    """Return the command line of the search program. Raise CommandRefusedError if none is installed."""
    points = sorted(entry_points(group=SEARCH_GROUP), key=lambda point: point.name)
    if not points:
        raise CommandRefusedError('nothing is installed that synthesizes: install the package flexbt_formal here')
    return [sys.executable, '-m', points[0].module]


# A search runs in a separate process, so that its use of time and memory does not affect the executive.
#
# The process reads the request as a line of JSON. It writes its progress, and finally its answer, as lines of JSON. It
# ends when its standard input closes, so that it does not outlive the executive.

_LINE: Final = 16_000_000
"""Maximum bytes of a line that the process writes."""

_GRACE: Final = 5.0
"""Seconds that a process may take beyond its time limit. It checks the limit itself, but only now and then."""

SearchMessage = Mapping[str, Any]


class SearchProcess:
    """A process that runs a search.

    It calls the callbacks on a separate thread: ``on_progress`` with each line before the answer, and ``on_end``
    exactly once. ``on_end`` gets the answer, or None and the reason ('' if the search was canceled).
    """

    def __init__(
        self,
        command: Sequence[str],
        request: Mapping[str, Any],
        seconds: float,
        on_progress: Callable[[SearchMessage], None],
        on_end: Callable[[SearchMessage | None, str], None],
    ) -> None:
        """``seconds`` of wall time limit the search, not counting the start of the process."""
        self._command = command
        self._request = request
        self._seconds = seconds
        self._on_progress = on_progress
        self._on_end = on_end
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_canceled = False
        self._is_late = False
        self._thread = threading.Thread(target=self._run, name='synthesis', daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Cancel the search. From any thread."""
        with self._lock:
            self._is_canceled = True
            self._kill()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()

    def _run(self) -> None:
        answer: SearchMessage | None = None
        why = ''
        try:
            answer, why = self._searched()
        except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: no thread is left for the timer
            why = f'the search cannot be run: {error}'
        except Exception as error:
            why = f'fault of the search: {error!r}'
        if self._is_canceled:
            answer, why = None, ''
        self._on_end(answer, why)

    def _searched(self) -> tuple[SearchMessage | None, str]:
        # Without the lock, since starting a process can take long, and the executor thread may cancel meanwhile.
        process = subprocess.Popen(  # noqa: S603 - the command is that of an installed package
            [*self._command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        with self._lock:
            self._process = process
            if self._is_canceled:
                self._kill()
        limit = threading.Timer(self._seconds + _GRACE, self._too_late)
        answer: SearchMessage | None = None
        try:
            limit.start()
            with contextlib.suppress(BrokenPipeError), process:
                assert process.stdin is not None and process.stdout is not None
                process.stdin.write(json.dumps(self._request).encode() + b'\n')
                process.stdin.flush()
                while answer is None and (line := process.stdout.readline(_LINE)):
                    told = json.loads(line)
                    if 'code' in told:
                        answer = told
                    else:
                        self._on_progress(told)
                self._kill()  # the answer is complete
        finally:
            limit.cancel()
            self._kill()
        return answer, '' if answer is not None else self._end_of(process.wait())

    def _too_late(self) -> None:
        self._is_late = True
        self._kill()

    def _end_of(self, code: int) -> str:
        if self._is_late:
            return f'no answer within {self._seconds:g} s; give it more time, or ask for less'
        how = f'was ended by {signal.Signals(-code).name}' if code < 0 else f'ended with exit code {code}'
        return f'the search {how} without an answer; was there too little memory? The log of the executive may say more'
