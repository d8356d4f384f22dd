# SPDX-License-Identifier: BSD-3-Clause
"""`make test`: lint, the tests of every package, a verdict that names what failed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree  # of files that our own pytest runs wrote
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from workspace.layout import Package
from workspace.lint import all_checks, failing_checks
from workspace.terminal import stop_group
from workspace.workspace import Workspace

DEADLINE = 2700.0  # seconds for all tests, of which some may hang; a slow, busy machine needs half of it
LANES = 2 * (os.cpu_count() or 2)  # packages that are tested side by side: more make each slower, and all no faster
LONGEST = (
    'flexbt_system_tests',
    'flexbt_console',
    'flexbt_studio',
    'flexbt_onboard',
    'flexbt_common',
    'flexbt_server',
    'flexbt_navigation',
    'flexbt_bringup',
    'flexbt_testing',
    'flexbt_formal',
    'flexbt_core',
    'flexbt_sim',
)
"""The packages whose tests take longest, in the order in which they begin: first those that mostly wait (for processes,
deadlines, other nodes), last those that only compute, so that the processors are busy up to the end."""
SPREAD = LONGEST[:3]  # take far longer than all others, and mostly wait: a worker of pytest for each processor
MOST_UNSTEADY = 8
"""Maximum number of failed tests that get a second try, one package at a time: on a busy machine even a generous
deadline may pass, but not those of many tests. One that passes then is told as UNSTEADY, with its first failure."""
LONGEST_SILENCE = 600.0
"""Seconds without a test that ends, after which the tests of a package begin anew, once: one hangs, perhaps in the
middleware. That is told as UNSTEADY, and the log has the stack of each thread."""
SKIPPED_IN_CI = {
    'clone of ros-navigation/navigation2': 'the sources of Nav2 are not a dependency',
    'empty parameter set for (branch)': 'the same, for each branch of Nav2',
    'empty parameter set for (tree)': 'the same, for each tree of Nav2',
    'Nav2 is not at hand': 'the same',
    'trees of Nav2 are not at hand': 'the same',
    "Nav2's map is not beside": 'the same',
    'nav2_simple_commander is not installed': 'there is no wheel of it',
    "'flexbe_msgs": 'there is no wheel of it',
    'BehaviorTree.CPP is not installed': 'there is no wheel of the library with its headers',
    'data of BTPG is not here': 'the data of the peer are not a dependency',
    'examples of flexbe_synthesis are not at hand': 'the data of the peer are not a dependency',
    'FLEXBT_ACCELERATION=0': 'a variant without what the test is about',
    'no network namespaces here': 'they need privileges',
    'only root can mount': 'it needs privileges',
}
"""Parts of the reasons for which a test may be skipped in continuous integration (the environment variable CI), and why
they are accepted. Any other skipped test is a failure there: something is not installed."""
_POLL_SECONDS = 0.1
_MESSAGE_WIDTH = 160


@dataclass(frozen=True)
class Variant:
    """Tests of one package that run once more, in another environment: those in its directories or files `tests`.

    `without`: files there whose tests have nothing to do with it; `options` are further arguments of pytest.
    """

    package: str
    tests: tuple[str, ...]
    environment: Mapping[str, str]
    without: tuple[str, ...] = ()
    options: tuple[str, ...] = ()

    def __str__(self) -> str:
        return ' '.join(f'{name}={value}' for name, value in self.environment.items())


ONE_PROCESS = {'PYTEST_PLUGINS': 'flexbt_testing.one_process.plugin'}
LARGE_PAGES = {'PYTHONMALLOC': 'malloc', 'GLIBC_TUNABLES': 'glibc.malloc.hugetlb=1'}
"""With pages of 2 MB worlds run 1.2 times as fast on a virtual machine, and up to 1.9 times on a busy one."""
HAS_ONE_PROCESS = (os.environ.get('ROS_WHEELS') or os.environ.get('ROS_DISTRO') or 'jazzy') in ('jazzy', 'kilted')
"""Whether flexbt_testing.one_process knows the rclpy of this distribution."""
IS_SIMULATED = HAS_ONE_PROCESS and not os.environ.get('DDS')
IN_ONE_PROCESS = (
    dict.fromkeys(
        (
            'flexbt_bringup',
            'flexbt_common',
            'flexbt_flexbe',
            'flexbt_navigation',
            'flexbt_onboard',
            'flexbt_server',
            'flexbt_sim',
            'flexbt_states',
        ),
        ONE_PROCESS,
    )
    if IS_SIMULATED
    else {}
)
"""Packages whose tests run in one process, on a simulated clock; with `make test DDS=1` they run on the middleware, as
their tests with the mark `dds` always do. Of other packages, tests with the mark `one_process` run in one process."""
VARIANTS = (
    Variant(
        'flexbt_core',
        ('test/behavior_tree',),
        {'FLEXBT_ACCELERATION': '0'},
        without=(
            'engine/test_bt_faulty_leaves.py',
            'engine/test_bt_manual_clock.py',
            'engine/test_bt_status_observer.py',
            'engine/test_bt_tick_callbacks.py',
            'model/*.py',
            'xml/*.py',
        ),
    ),
    *(
        [Variant('flexbt_testing', ('test/one_process', 'test/conformance_middleware'), ONE_PROCESS)]
        if HAS_ONE_PROCESS
        else []
    ),
)


@dataclass
class Tally:
    """The numbers of checks that passed and were skipped, and what failed, or passed in a second try only (one line
    each)."""

    passed: int = 0
    skipped: int = 0
    failures: list[str] = field(default_factory=list)
    unsteady: list[str] = field(default_factory=list)

    def summary(self) -> str:
        second = f', {len(self.unsteady)} of them in a second try' if self.unsteady else ''
        return f'{self.passed} passed{second}, {len(self.failures)} failed, {self.skipped} skipped'


def run(workspace: Workspace) -> int:
    """Run everything; gives the exit code. The last line printed is the summary."""
    packages = {package.name: package for package in workspace.layout.packages() if package.test_modules()}
    runs = _runs_of(workspace, packages.values())
    runs += [_Run(workspace, packages[variant.package], variant) for variant in VARIANTS]
    runs.sort(key=lambda run: run.rank)
    deadline = time.monotonic() + DEADLINE
    failed_checks = _finish(runs, deadline, lambda: failing_checks(workspace, alone=False))
    _try_again(runs, deadline)
    tally = Tally(passed=len(all_checks(workspace)) - len(failed_checks))
    tally.failures += [f'FAILED lint: {name}' for name in failed_checks]
    _show_results(workspace)
    for one in runs:
        one.count(tally)

    for line in (*tally.unsteady, *tally.failures):
        print(line)
    print(tally.summary(), flush=True)
    return 1 if tally.failures else 0


def _runs_of(workspace: Workspace, packages: Collection[Package]) -> list[_Run]:
    """Return the runs that together run each test of the packages once."""
    runs = []
    for package in packages:
        is_in_one_process = package.name in IN_ONE_PROCESS
        real = _with_mark(package, 'dds') if is_in_one_process else ()
        simulated = _with_mark(package, 'one_process') if IS_SIMULATED and not is_in_one_process else ()
        runs.append(_Run(workspace, package, options=('-m', 'not one_process') if simulated else ()))
        if real:
            runs.append(_Run(workspace, package, Variant(package.name, real, {'DDS': '1'}, options=('-m', 'dds'))))
        if simulated:
            variant = Variant(package.name, simulated, ONE_PROCESS, options=('-m', 'one_process'))
            runs.append(_Run(workspace, package, variant))
    return runs


def _with_mark(package: Package, mark: str) -> tuple[str, ...]:
    """Return the files with tests that have a mark."""
    modules = package.test_modules()
    return tuple(
        str(file.relative_to(package.path)) for file in modules if f'mark.{mark}' in file.read_text(encoding='utf-8')
    )


def _finish(runs: list[_Run], deadline: float, lint: Callable[[], list[str]]) -> list[str]:
    """Let the runs come to their end, `LANES` at a time; what has not by the deadline (monotonic) is stopped.

    The first of them go on while `lint` is at work, which mostly needs one processor; gives what that found.
    """
    waiting, running = deque(runs[LANES:]), runs[:LANES]
    for one in runs:
        one.forget()
    try:
        for one in running:
            one.start()
        failed_checks = lint()
        while waiting or running:
            running = [one for one in running if not one.ended()]
            for one in running:
                one.begin_anew_if_silent()
            if (waiting or running) and time.monotonic() > deadline:
                print(f'the tests did not end within {DEADLINE:.0f} s: stopping them', flush=True)
                break
            while waiting and len(running) < LANES:
                running.append(waiting.popleft())
                running[-1].start()
            time.sleep(_POLL_SECONDS)
    finally:
        for one in running:
            one.stop()
    return failed_checks


def _try_again(runs: list[_Run], deadline: float) -> None:
    """Give the tests that failed, if they are few, a second try: one package at a time, with the machine to itself."""
    failed = [(one, one.failed()) for one in runs]
    if sum(number for _, number in failed) > MOST_UNSTEADY:
        return
    for one, number in failed:
        if number and time.monotonic() < deadline:
            one.start(again=True)
            try:
                while not one.ended() and time.monotonic() < deadline:
                    time.sleep(_POLL_SECONDS)
            finally:
                one.stop()


class _Run:
    """The tests of one package. How each ended is in the result file; that they all did, in pytest's exit code."""

    def __init__(
        self, workspace: Workspace, package: Package, variant: Variant | None = None, options: tuple[str, ...] = ()
    ) -> None:
        build = workspace.layout.build
        self._workspace = workspace
        self._package = package
        self._variant = variant
        self._options = options
        self._results = build / 'variants' / str(variant) if variant else build  # below which colcon looks for results
        self._process: subprocess.Popen[bytes] | None = None
        self._start = 0.0  # monotonic
        self._was_stopped = False
        self._hung = ''

    def __str__(self) -> str:
        return f'{self._package.name} once more with {self._variant}' if self._variant else self._package.name

    @property
    def is_spread(self) -> bool:
        return self._package.name in SPREAD and self._variant is None

    @property
    def rank(self) -> int:
        """Its place in the order in which the runs begin."""
        return LONGEST.index(self._package.name) if self._package.name in LONGEST else len(LONGEST)

    def forget(self) -> None:
        """Remove the results of an earlier one."""
        for file in (self._result_file, self._second_file):
            file.unlink(missing_ok=True)

    def start(self, again: bool = False) -> None:
        """As `colcon test` starts it, without colcon, which takes longer than the tests of many a package.

        `again`: only the tests that failed.
        """
        workspace, variant = self._workspace, self._variant
        results = self._second_file if again else self._result_file
        command: list[str | Path] = ['python3', '-m', 'pytest', '--tb=short', f'--junit-xml={results}']
        command += [f'--junit-prefix={self._package.name}', '-o', f'cache_dir={results.with_name(".pytest_cache")}']
        command += ['-o', f'faulthandler_timeout={LONGEST_SILENCE / 2}']
        if again:
            command += ['--last-failed', '--last-failed-no-failures', 'none']
        elif self.is_spread:
            command += _in_parallel(workspace)
        command += [*variant.tests, *(f'--ignore-glob=*/{file}' for file in variant.without)] if variant else ['test']
        command += variant.options if variant else self._options
        further = variant.environment if variant else IN_ONE_PROCESS.get(self._package.name, {})
        environment = {**workspace.environment, **further, **(LARGE_PAGES if further is ONE_PROCESS else {})}
        environment.pop('PYTHONDONTWRITEBYTECODE', None)  # or each pytest would rewrite the plug-ins that it loads anew
        self._log.parent.mkdir(parents=True, exist_ok=True)
        self._start = time.monotonic()
        with self._log.open('ab' if again or self._hung else 'wb') as output:
            self._process = subprocess.Popen(
                [str(word) for word in workspace.inside(command)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=self._package.path,
                start_new_session=True,
            )
        print(f'tests of {self}: {"those that failed, once more" if again else "begun"}', flush=True)

    def failed(self) -> int:
        """Return how many of its tests failed; 0 if it did not end as pytest does after the last test."""
        own = Tally()
        _count(self._result_file, self._package.name, '', own)
        return 0 if self._bad_ending(own) else len(own.failures)

    def ended(self) -> bool:
        """Return whether it has; when it is seen for the first time, that is told."""
        if self._process is None or self._process.returncode is not None:
            return self._process is not None
        if self._process.poll() is None:
            return False
        print(f'tests of {self}: ended after {time.monotonic() - self._start:.0f} s', flush=True)
        return True

    def begin_anew_if_silent(self) -> None:
        """Begin anew, once, when no test has ended for `LONGEST_SILENCE`."""
        if self._process is None or self._hung or time.time() < self._log.stat().st_mtime + LONGEST_SILENCE:
            return
        silence = f'{self}: no test ended within {LONGEST_SILENCE:.0f} s'
        self._hung = f'UNSTEADY {silence}, and it began anew; see {self._log}'
        print(f'tests of {silence}', flush=True)
        stop_group(self._process)
        self.forget()
        self.start()

    def stop(self) -> None:
        """End what still runs of it."""
        if self._process is not None and not self.ended():
            self._was_stopped = True
            stop_group(self._process)

    def count(self, tally: Tally) -> None:
        """Add the results to the tally, and an end that leaves open what other tests there are."""
        label = f' [{self._variant}]' if self._variant else ''
        own = Tally()
        _count(self._result_file, self._package.name, label, own, _passed(self._second_file))
        if ending := self._bad_ending(own):
            own.failures.append(f'FAILED {self._package.name}{label}: pytest {ending}, see {self._log}')
        tally.passed += own.passed
        tally.skipped += own.skipped
        tally.failures += own.failures
        tally.unsteady += [*own.unsteady, *([self._hung] if self._hung else [])]

    def _bad_ending(self, results: Tally) -> str:
        """Return how pytest ended, unless the results say so, too: 1 is that of failures, 5 that of nothing but
        skipped."""
        if self._process is None:
            return 'did not begin'
        if self._was_stopped:
            return 'was stopped'
        code = self._process.returncode
        if code == 0 or (code == 1 and results.failures) or (code == 5 and results.skipped and not results.passed):
            return ''
        return f'was killed by signal {-code}' if code < 0 else f'ended with exit code {code}'

    @property
    def _result_file(self) -> Path:
        return self._results / self._package.name / 'pytest.xml'

    @property
    def _second_file(self) -> Path:
        return self._result_file.with_name('pytest-second-try.xml')

    @property
    def _log(self) -> Path:
        return self._workspace.layout.log / f'test-{str(self).replace(" ", "-")}.log'


def _in_parallel(workspace: Workspace) -> list[str]:
    """Options for a worker of pytest for each processor.

    Without pytest-xdist, which no key of a manifest asks for, there is one worker.
    """
    found = subprocess.run(
        [str(word) for word in workspace.inside(['python3', '-c', 'import xdist'])],
        env=workspace.environment,
        cwd=workspace.layout.root,
        stderr=subprocess.DEVNULL,
    )
    if found.returncode != 0:
        return []
    return ['--numprocesses', str(os.cpu_count() or 2), '--dist', 'worksteal']


def _show_results(workspace: Workspace) -> None:
    command = ['colcon', 'test-result', '--verbose', '--test-result-base', str(workspace.layout.build)]
    sys.stdout.flush()
    subprocess.run(
        [str(word) for word in workspace.inside(command)], env=workspace.environment, cwd=workspace.layout.root
    )


def _count(file: Path, package: str, label: str, tally: Tally, passed_later: Collection[str] = ()) -> None:
    """Add the results in a JUnit file to the tally. A file that is missing or damaged is a failure of the package.

    The `label` tells the names of tests that run more than once apart. Tests in `passed_later` passed in a second try.
    """
    try:
        cases = _cases(file)
    except (OSError, ElementTree.ParseError) as error:
        tally.failures.append(f'FAILED {package}{label}: no result of its tests ({error})')
        return
    for name, problem, skipped in cases:
        if problem is not None:
            told = f'{name}{label}: {" ".join(problem.get("message", "").split())[:_MESSAGE_WIDTH]}'
            if name in passed_later:
                tally.passed += 1
                tally.unsteady.append(f'UNSTEADY {told}')
            else:
                tally.failures.append(f'FAILED {told}')
        elif skipped is None:
            tally.passed += 1
        elif 'CI' not in os.environ or any(part in _reason(skipped) for part in SKIPPED_IN_CI):
            tally.skipped += 1
        else:
            tally.failures.append(f'FAILED {name}{label}: skipped in continuous integration: {_reason(skipped)}')


def _passed(file: Path) -> set[str]:
    """Return the names of the tests that passed, by a JUnit file; none if it is missing or damaged."""
    try:
        return {name for name, problem, skipped in _cases(file) if problem is None and skipped is None}
    except (OSError, ElementTree.ParseError):
        return set()


def _cases(file: Path) -> list[tuple[str, ElementTree.Element | None, ElementTree.Element | None]]:
    """Return each test in a JUnit file: its name, its failure or error, and its element `skipped`."""
    return [
        (
            f'{case.get("classname")}.{case.get("name")}',
            next((found for found in case if found.tag in ('failure', 'error')), None),
            case.find('skipped'),
        )
        for case in ElementTree.parse(file).iter('testcase')  # noqa: S314
    ]


def _reason(skipped: ElementTree.Element) -> str:
    """Return why a test was skipped: the message, or the text for a whole module."""
    message = skipped.get('message', '')
    return str(skipped.text if message == 'collection skipped' else message)
