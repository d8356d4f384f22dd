# SPDX-License-Identifier: BSD-3-Clause
"""`make test`: lint, the tests of every package, a verdict that names what failed."""

from __future__ import annotations

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree  # of files that our own pytest runs wrote
from dataclasses import dataclass, field
from pathlib import Path

from .layout import Package
from .lint import all_checks, failing_checks
from .terminal import stop_group
from .workspace import Workspace

DEADLINE = 2700.0  # seconds for the tests of all packages, of which some may hang; a slow, busy machine needs half of it
_MESSAGE_WIDTH = 160


@dataclass
class Tally:
    """How many checks passed and were skipped, and what failed (one line each)."""

    passed: int = 0
    skipped: int = 0
    failures: list[str] = field(default_factory=list)

    def summary(self) -> str:
        return f'{self.passed} passed, {len(self.failures)} failed, {self.skipped} skipped'


def run(workspace: Workspace) -> int:
    """Runs everything; gives the exit code. The last line printed is the summary."""
    failed_checks = failing_checks(workspace)
    tally = Tally(passed=len(all_checks(workspace)) - len(failed_checks))
    tally.failures += [f'FAILED lint: {name}' for name in failed_checks]

    packages = [package for package in workspace.layout.packages() if package.test_modules()]
    for package in packages:
        _result_file(workspace, package).unlink(missing_ok=True)
    _colcon_test(workspace, packages)
    _show_results(workspace)
    for package in packages:
        _count(_result_file(workspace, package), package.name, tally)

    for failure in tally.failures:
        print(failure)
    print(tally.summary(), flush=True)
    return 1 if tally.failures else 0


def _colcon_test(workspace: Workspace, packages: list[Package]) -> None:
    """Runs the tests of one package after another. How they ended is in the result files, not in colcon's exit code."""
    command: list[str | Path] = ['colcon', '--log-base', workspace.layout.log / 'colcon', 'test']
    command += ['--base-paths', workspace.layout.root, '--return-code-on-test-failure']
    command += ['--executor', 'sequential']
    command += ['--packages-select', *(package.name for package in packages)]
    command += _in_parallel(workspace)
    process = subprocess.Popen(
        [str(word) for word in workspace.inside(command)],
        stdin=subprocess.DEVNULL,
        stderr=subprocess.STDOUT,
        env=workspace.environment,
        cwd=workspace.layout.root,
        start_new_session=True,
    )
    try:
        process.wait(timeout=DEADLINE)
    except subprocess.TimeoutExpired:
        print(f'the tests did not end within {DEADLINE:.0f} s: stopping them', flush=True)
    finally:
        if process.returncode is None:
            stop_group(process)


def _in_parallel(workspace: Workspace) -> list[str]:
    """Options for a worker of pytest for each processor, so that none is idle whatever the packages are like.

    Without pytest-xdist, which no key of a manifest asks for, there is one worker.
    """
    look = subprocess.run(
        [str(word) for word in workspace.inside(['python3', '-c', 'import xdist'])],
        env=workspace.environment,
        cwd=workspace.layout.root,
        stderr=subprocess.DEVNULL,
    )
    if look.returncode != 0:
        return []
    return ['--pytest-args', '--numprocesses', str(os.cpu_count() or 2), '--dist', 'worksteal']


def _show_results(workspace: Workspace) -> None:
    command = ['colcon', 'test-result', '--verbose', '--test-result-base', str(workspace.layout.build)]
    sys.stdout.flush()
    subprocess.run(
        [str(word) for word in workspace.inside(command)], env=workspace.environment, cwd=workspace.layout.root
    )


def _result_file(workspace: Workspace, package: Package) -> Path:
    return workspace.layout.build / package.name / 'pytest.xml'


def _count(file: Path, package: str, tally: Tally) -> None:
    """Adds the results in a JUnit file to the tally. A file that is missing or damaged is a failure of the package."""
    try:
        cases = list(ElementTree.parse(file).iter('testcase'))  # noqa: S314
    except (OSError, ElementTree.ParseError) as error:
        tally.failures.append(f'FAILED {package}: no result of its tests ({error})')
        return
    for case in cases:
        problem = next((found for found in case if found.tag in ('failure', 'error')), None)
        if problem is not None:
            name = f'{case.get("classname", package)}.{case.get("name", "?")}'
            message = ' '.join(problem.get('message', '').split())[:_MESSAGE_WIDTH]
            tally.failures.append(f'FAILED {name}: {message}')
        elif case.find('skipped') is not None:
            tally.skipped += 1
        else:
            tally.passed += 1
