# SPDX-License-Identifier: BSD-3-Clause
"""Change the product at random places and report the changes that no test notices (mutation testing).

``make mutants AREA=nodes MINUTES=20`` first runs the area's tests once, for half of the time at most, to find which of
them reach which line; this is kept until a file changes. Then it tries changes that mutmut makes, drawn by ``SEED``,
until the time is up. It prints each change that was not noticed as a diff, and the share that was. The exit code is 1
when that is less than 95 %.

Tests of a package that ``make test`` runs in one process run so here, too, without those that need the middleware.

A change counts as noticed if a test fails, or if the tests use far more processor time than before. If they only take
long, which may be because the machine is busy, the change counts for neither side. Neither does a change that mypy
refuses, such as None for a string: ``make lint`` finds it. The share with these as noticed is printed, too.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, NamedTuple

from workspace.side_packages import environment_with
from workspace.test_run import IN_ONE_PROCESS

ROOT: Final = Path(__file__).resolve().parents[1]
REQUIREMENTS: Final = ROOT / 'tools' / 'requirements-mutants.txt'
PACKAGES: Final = ROOT / '.venv' / 'mutants'
OUTPUT: Final = ROOT / 'out' / 'mutants'
GOAL: Final = 0.95
"""The share of changes that tests have to notice."""
WORKERS: Final = 2
CPU_SECONDS: Final = 15.0
CPU_TIMES: Final = 5.0
"""Processor time that tests may use: this long, and this many times as long as without the change."""
WALL_SECONDS: Final = 600.0
"""Time after which tests are given up."""


PYTEST: Final = ('-q', '-p', 'no:cacheprovider', '--rootdir', '.')


class Area(NamedTuple):
    """Files of a package that are changed, and the tests of this and of other packages that have to notice it."""

    package: str
    files: tuple[str, ...]
    tests: tuple[str, ...]


_ENGINES: Final = ('behavior_tree', 'state_machine')
_TESTS_OF_ENGINES: Final = (
    *(f'flexbt_core/test/{engine}' for engine in _ENGINES),
    'flexbt_core/test/monitors',
    'flexbt_server/test/nav2/test_nav2_node_types.py',
    'flexbt_server/test/nav2/test_nav2_path_and_goal_leaves.py',
    'flexbt_tools/test/trees/test_bt_tool_reachability.py',
)
AREAS: Final = {
    'model': Area('flexbt_core', tuple(f'{engine}/model' for engine in _ENGINES), _TESTS_OF_ENGINES),
    'engine': Area('flexbt_core', tuple(f'{engine}/engine' for engine in _ENGINES), _TESTS_OF_ENGINES),
    'nodes': Area('flexbt_core', ('behavior_tree/nodes',), _TESTS_OF_ENGINES),
    'commands': Area(
        'flexbt_onboard',
        ('commands',),
        (
            'flexbt_onboard/test/commands',
            'flexbt_onboard/test/mission_queue',
            'flexbt_onboard/test/persistence/test_executive_durable.py',
            'flexbt_onboard/test/persistence/test_executive_event_log.py',
            'flexbt_states/test/test_states_operator_input.py',
        ),
    ),
    'stop': Area(
        'flexbt_onboard',
        ('runs/stop_enforcer.py', 'runs/motion_stop.py'),
        ('flexbt_onboard/test/runs', 'flexbt_onboard/test/node'),
    ),
}


class Mutant(NamedTuple):
    """A file with a change, and the lines that differ."""

    file: Path
    before: str
    after: str

    @property
    def diff(self) -> str:
        lines = difflib.unified_diff(
            self.before.splitlines(), self.after.splitlines(), str(self.file), 'changed', lineterm='', n=2
        )
        return '\n'.join(lines)

    @property
    def lines(self) -> set[int]:
        """Numbers of the lines that differ, from 1 on."""
        matcher = difflib.SequenceMatcher(None, self.before.splitlines(), self.after.splitlines(), autojunk=False)
        changed = [(first, last) for tag, first, last, _, _ in matcher.get_opcodes() if tag != 'equal']
        return {number + 1 for first, last in changed for number in range(first, max(last, first + 1))}


class Reach(NamedTuple):
    """The tests that reach each line of each file, and the processor time of each test, s."""

    tests: dict[str, dict[int, list[str]]]
    seconds: dict[str, float]

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests that reach a change, the quickest first."""
        lines = self.tests.get(str(mutant.file), {})
        found: set[str] = set()
        for line in mutant.lines:
            # Of a statement of several lines, only some may be known: not those with a part of a text.
            statement, is_head = _statement(mutant.before, line)
            known = [lines[one] for one in statement if one in lines]
            if known and not any(known):  # run by an import alone, as the head of a function is
                later = [tests for other, tests in sorted(lines.items()) if other > line and tests]
                known = later[:1] if is_head else list(lines.values())
            found.update(*known)
        return sorted(found, key=self.seconds.__getitem__)


def _statement(text: str, line: int) -> tuple[range, bool]:
    """Return the lines of the innermost statement at a line, without those of its body, and whether it has one."""
    found = range(line, line + 1), False
    for node in ast.walk(ast.parse(text)):  # the outer ones first
        if isinstance(node, ast.stmt):
            body = getattr(node, 'body', None)
            end = body[0].lineno if body else (node.end_lineno or node.lineno) + 1
            if node.lineno <= line < end:
                found = range(node.lineno, end), body is not None
    return found


# -- the tests that reach a line -------------------------------------------------------------------------------------


def reach(area: Area, folders: set[str], copy: Path, deadline: float) -> Reach:
    """Run the tests of an area once under coverage, those in ``folders`` first. Files of tests that are not run in time
    reach nothing."""
    places = [copy / name for name in area.tests]
    files = [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob('test_*.py')))]
    files.sort(key=lambda file: file.parent.name not in folders)
    with ThreadPoolExecutor(WORKERS) as pool:
        parts = list(pool.map(lambda file: _reach_of(area, copy, file, deadline), files))
    tests: dict[str, dict[int, list[str]]] = defaultdict(lambda: defaultdict(list))
    for part in parts:
        for name, lines in part.tests.items():
            for line, reaching in lines.items():
                tests[name][line] += reaching
    left_out = sum(not part.seconds for part in parts)
    seconds = {test: time for part in parts for test, time in part.seconds.items()}
    print(f'{len(seconds)} tests of {len(files)} files were run; {left_out} files were not, or had no test', flush=True)
    return Reach(tests, seconds)


def _reach_of(area: Area, copy: Path, file: Path, deadline: float) -> Reach:
    left = deadline - time.monotonic()
    if left <= 0.0:
        return Reach({}, {})
    output = copy / f'{file.stem}.reach'
    words = [
        sys.executable,
        __file__,
        '--measure',
        str(output),
        *(str(Path(area.package, area.package, name)) for name in area.files),
    ]
    environment = _environment(copy, area.package)
    try:
        subprocess.run(
            [*words, *PYTEST, str(file)],
            cwd=copy,
            env=environment,
            capture_output=True,
            check=False,
            timeout=left,
        )
        tests, seconds = json.loads(output.read_text(encoding='utf-8'))
    except (subprocess.TimeoutExpired, OSError):
        return Reach({}, {})
    return Reach({name: {int(line): found for line, found in lines.items()} for name, lines in tests.items()}, seconds)


def _environment(copy: Path, package: str) -> dict[str, str]:
    """Return the environment for tests of a package that is imported from a copy."""
    path = f'{copy / package}{os.pathsep}{os.environ["PYTHONPATH"]}'
    return os.environ | IN_ONE_PROCESS.get(package, {}) | {'PYTHONPATH': path}


class Measuring:
    """A plug-in of pytest that notes which tests succeed, and their processor time, and has coverage note their names
    for each line."""

    def __init__(self, coverage: Any) -> None:
        self.seconds: Counter[str] = Counter()
        self.failed: set[str] = set()
        self._coverage = coverage

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._coverage.switch_context(_function(nodeid))
        self.seconds[_function(nodeid)] -= _processor_time()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.seconds[_function(nodeid)] += _processor_time()

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed.add(_function(report.nodeid))


def _processor_time() -> float:
    """Return the processor time of this process, s. In a simulated world, ``time.process_time`` stands still."""
    used = os.times()
    return used.user + used.system


def _function(test: str) -> str:
    """Return the name of a test without its parameters."""
    return test.partition('[')[0]


def measure(output: Path, names: list[str], words: list[str]) -> None:
    """Run tests of this directory under coverage, and write which of them reach the lines of the files."""
    import pytest
    from coverage import Coverage

    patterns = [name if name.endswith('.py') else f'{name}/*' for name in names]
    files = [str(Path.cwd() / pattern) for pattern in patterns]
    coverage = Coverage(data_file=None, concurrency=['thread', 'greenlet'], include=files)
    measuring = Measuring(coverage)
    coverage.start()
    pytest.main(words, plugins=[measuring])
    coverage.stop()
    data = coverage.get_data()
    passed = {test: spent for test, spent in measuring.seconds.items() if test not in measuring.failed}
    tests = {
        str(Path(file).relative_to(Path.cwd())): {
            line: [test for test in reaching if test in passed]
            for line, reaching in data.contexts_by_lineno(file).items()
        }
        for file in data.measured_files()
    }
    output.write_text(json.dumps([tests, passed]), encoding='utf-8')


# -- the changes -----------------------------------------------------------------------------------------------------


def mutants(area: Area, copy: Path, seed: int) -> Iterator[Mutant]:
    """Yield the changes of the files of an area, in an order by ``seed``."""
    os.chdir(copy / area.package)  # mutmut reads its settings there
    from libcst import FunctionDef
    from mutmut.mutation.file_mutation import create_mutations

    found = []
    for name in area.files:
        path = copy / area.package / area.package / name
        for file in sorted(path.rglob('*.py')) if path.is_dir() else [path]:
            before = file.read_text(encoding='utf-8')
            module, mutations, _, _ = create_mutations(str(file), before)
            for one in mutations:
                function = one.contained_by_top_level_function
                # What is done when a module is imported is done before any test.
                if isinstance(function, FunctionDef) and function.name.value != '__init_subclass__':
                    found.append((file.relative_to(copy), before, module, one))
    print(f'{len(found)} changes', flush=True)
    random.Random(seed).shuffle(found)
    for file, before, module, one in found:
        after = module.deep_replace(one.original_node, one.mutated_node).code
        if after != before:
            yield Mutant(file, before, after)


def try_out(mutant: Mutant, tests: list[str], seconds: float, package: str, own: Path) -> str:
    """Return ``noticed``, ``not noticed``, ``not reached``, ``undecided`` or ``refused`` by mypy."""
    changed = own / mutant.file
    changed.write_text(mutant.after, encoding='utf-8')
    try:
        if not is_typed(own, package, mutant.file):
            return 'refused'
        return _tested(tests, seconds, package, own) if tests else 'not reached'
    finally:
        changed.write_text(mutant.before, encoding='utf-8')


def is_typed(own: Path, package: str, *files: Path) -> bool:
    """Return whether mypy accepts files of the copy ``own``."""
    places = [own / package, *sorted(file.parent for file in ROOT.glob('*/setup.py'))]
    mypy = [sys.executable, '-m', 'mypy', '--config-file', str(ROOT / 'pyproject.toml'), *map(str, files)]
    environment = os.environ | {'MYPYPATH': os.pathsep.join(map(str, places))}
    return subprocess.run(mypy, cwd=own, env=environment, stdout=subprocess.DEVNULL, check=False).returncode == 0


def _tested(tests: list[str], seconds: float, package: str, own: Path) -> str:
    limit = int(CPU_SECONDS + CPU_TIMES * seconds)
    limited = ['sh', '-c', 'ulimit -t "$0" && exec "$@"', str(limit)]
    process = subprocess.Popen(
        [*limited, sys.executable, '-m', 'pytest', '-x', *PYTEST, *tests],
        cwd=own,
        env=_environment(own, package),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        code = process.wait(WALL_SECONDS)
    except subprocess.TimeoutExpired:
        return 'undecided'
    finally:
        if process.poll() is None:
            os.killpg(process.pid, 9)
            process.wait()
    return 'not noticed' if code == 0 else 'noticed'


# -- the command -----------------------------------------------------------------------------------------------------


def prepared(area: Area, deadline: float) -> tuple[Path, Reach]:
    """Return a copy of the package, and the tests that reach its lines: those of all areas with the same tests."""
    name = '_'.join([area.package, *(Path(test).stem for test in area.tests)])
    copy = OUTPUT / name
    packages = sorted({area.package, *(Path(test).parts[0] for test in area.tests)})
    sources = sorted(file for package in packages for file in (ROOT / package).rglob('*.py'))
    stamp = hashlib.sha256(b''.join(file.read_bytes() for file in sources)).hexdigest()
    kept = OUTPUT / f'{name}.json'
    if kept.exists():
        known, tests, seconds = json.loads(kept.read_text(encoding='utf-8'))
        if known == stamp:
            by_line = {file: {int(line): found for line, found in lines.items()} for file, lines in tests.items()}
            return copy, Reach(by_line, seconds)
    shutil.rmtree(copy, ignore_errors=True)
    for package in packages:
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns('__pycache__'))
    alike = [one for one in AREAS.values() if (one.package, one.tests) == (area.package, area.tests)]
    files = tuple(file for one in alike for file in one.files)
    reached = reach(area._replace(files=files), {Path(file).name for file in area.files}, copy, deadline)
    kept.write_text(json.dumps([stamp, *reached]), encoding='utf-8')
    return copy, reached


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument('--area', choices=AREAS, default='nodes')
    parser.add_argument('--minutes', type=float, default=20.0)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--measure', nargs='+', help=argparse.SUPPRESS)  # of a process of :func:`reach`
    options, words = parser.parse_known_args()
    if options.measure:
        measure(Path(options.measure[0]), options.measure[1:], words)
        return 0
    if words:
        parser.error(f'unknown: {" ".join(words)}')
    os.nice(19)
    os.environ |= environment_with(REQUIREMENTS, PACKAGES)
    sys.path.insert(1, str(PACKAGES))
    area = AREAS[options.area]
    begin = time.monotonic()
    deadline = begin + 60.0 * options.minutes
    copy, reached = prepared(area, begin + 30.0 * options.minutes)
    workers = [OUTPUT / f'worker_{number}' for number in range(WORKERS)]
    for own in workers:
        shutil.rmtree(own, ignore_errors=True)
        shutil.copytree(copy, own, ignore=shutil.ignore_patterns('__pycache__'))
        if not is_typed(own, area.package, *(Path(area.package, area.package, name) for name in area.files)):
            sys.exit(f'mypy refuses {area.package} without a change; see make lint')
    results: Counter[str] = Counter()
    made = mutants(area, copy, options.seed)
    lock = threading.Lock()

    def work(own: Path) -> None:
        while time.monotonic() < deadline:
            with lock:
                mutant = next(made, None)
            if mutant is None:
                return
            tests = reached.of(mutant)
            result = try_out(mutant, tests, sum(map(reached.seconds.__getitem__, tests)), area.package, own)
            results[result] += 1
            if result not in ('noticed', 'refused'):
                print(f'{result}: {len(tests)} tests\n{mutant.diff}\n', flush=True)

    with ThreadPoolExecutor(WORKERS) as pool:
        list(pool.map(work, workers))
    missed = results['not noticed'] + results['not reached']
    noticed, refused = results['noticed'], results['refused']
    share, with_refused = (found / max(1, found + missed) for found in (noticed, noticed + refused))
    print(f'{options.area}, seed {options.seed}: {share:.1%} noticed ({with_refused:.1%} with mypy); {dict(results)}')
    return 0 if share >= GOAL else 1


if __name__ == '__main__':
    sys.exit(main())
