# SPDX-License-Identifier: BSD-3-Clause
"""`make lint`: ruff, mypy in strict mode, the contracts of the architecture, shellcheck."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from workspace.errors import CommandError, WorkspaceError
from workspace.terminal import report, run_logged, step
from workspace.workspace import Workspace


@dataclass(frozen=True)
class Check:
    """A checker: its name, and the command line."""

    name: str
    command: list[str | Path] = field(default_factory=list)


def run(workspace: Workspace) -> int:
    """Run all checkers; gives the exit code."""
    failed = failing_checks(workspace)
    print(f'lint: failed: {", ".join(failed)}' if failed else 'lint: passed')
    return 1 if failed else 0


def failing_checks(workspace: Workspace, *, alone: bool = True) -> list[str]:
    """Run all checkers, reports what they find, gives the names of those that found something.

    `alone`: whether nothing else is written to the terminal meanwhile.

    Raises WorkspaceError when a checker is not installed.
    """
    checks = all_checks(workspace)
    _require({str(check.command[0]) for check in checks}, workspace)
    failed = []
    for check in checks:
        try:
            with step(check.name, alone=alone) as shown:
                shown.outcome = 'passed'
                run_logged(
                    workspace.inside(check.command),
                    workspace.layout.log / f'lint-{check.name.replace(" ", "-")}.log',
                    shown=shown,
                    what=check.name,
                    environment={
                        **workspace.environment,
                        'MYPYPATH': os.pathsep.join(map(str, _mypy_roots(workspace))),
                        'PYTHONPATH': _first_on_path(workspace.layout.tools, workspace),  # a contract type of ours
                    },
                    directory=workspace.layout.root,
                )
        except CommandError as error:
            failed.append(check.name)
            report(error)
    return failed


def all_checks(workspace: Workspace) -> list[Check]:
    """Return the checkers and what they are run on."""
    layout = workspace.layout
    scripts = [*sorted(layout.tools.glob('*.sh')), layout.root / '.ci' / 'run']
    return [
        Check('ruff check', ['ruff', 'check', '.']),
        Check('ruff format', ['ruff', 'format', '--check', '.']),
        Check('mypy', ['mypy', *_typed_files(workspace)]),
        Check('import-linter', ['lint-imports', '--no-cache']),
        Check('shellcheck', ['shellcheck', *scripts]),
    ]


def _typed_files(workspace: Workspace) -> list[Path]:
    """Return what mypy checks: the modules of all packages, the tooling, benchmarks, and the tests.

    Not setup.py and conftest.py, of which there are several of the same module name.
    """
    layout = workspace.layout
    files = [
        layout.tools / 'workspace',
        *sorted(layout.interface_tools.glob('*.py')),
        *sorted(layout.benchmarks.rglob('*.py')),
    ]
    for package in layout.packages():
        if package.is_python:
            files.append(package.modules)
            files += [file for file in sorted((package.path / 'test').rglob('*.py')) if file.name != 'conftest.py']
    return files


def _mypy_roots(workspace: Workspace) -> list[Path]:
    layout = workspace.layout
    packages = [package for package in layout.packages() if package.is_python]
    tests = {file.parent for package in packages for file in (package.path / 'test').rglob('*.py')}
    return [
        layout.tools,
        *sorted({file.parent for file in layout.benchmarks.glob('*/*.py')}),
        *(package.path for package in packages),
        *sorted(tests),
    ]


def _first_on_path(directory: Path, workspace: Workspace) -> str:
    return os.pathsep.join(filter(None, [str(directory), workspace.environment.get('PYTHONPATH')]))


def _require(programs: set[str], workspace: Workspace) -> None:
    """With an installed ROS the checkers are the user's to install."""
    path = os.pathsep.join(filter(None, [str(workspace.venv.path / 'bin'), workspace.environment.get('PATH')]))
    missing = sorted(program for program in programs if shutil.which(program, path=path) is None)
    if missing:
        raise WorkspaceError(
            f'not installed: {", ".join(missing)}',
            f'pip install --requirement {workspace.layout.tools / "requirements-dev.txt"}'
            '   (in a virtual environment with --system-site-packages, activated after ROS is sourced)',
        )
