# SPDX-License-Identifier: BSD-3-Clause
"""The workspace on its underlay: set up once, then a place to run programs in."""

from __future__ import annotations

import compileall
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from workspace.build import Build
from workspace.errors import CommandError, WorkspaceError
from workspace.layout import Layout
from workspace.terminal import finish_logged, run_logged, start_logged, step, stop_group
from workspace.underlay import clean_environment, detect
from workspace.virtual_environment import VirtualEnvironment

# ament's and colcon's scripts quote neither of these everywhere; a colon separates the entries of path lists, a comma
# the options of the linker; CMake reads the lists of files that rosidl writes as ASCII.
_UNUSABLE_IN_A_PATH = re.compile(r'[\s:;,\'"$`\\*?\[\](){}<>|&!#]|[^\x00-\x7f]')

# The packages whose loops numba compiles, and what they import.
_OF_LOOPS = ('flexbt_core', 'flexbt_sim', 'flexbt_navigation')


class Workspace:
    """The workspace, on the underlay that `environment` asks for.

    Raises WorkspaceError when another ROS distribution is sourced, or the path of the clone cannot work.
    """

    def __init__(self, layout: Layout, environment: Mapping[str, str]) -> None:
        bad = _UNUSABLE_IN_A_PATH.search(str(layout.root))
        if bad:
            raise WorkspaceError(
                f'the path of the clone, {layout.root}, contains {bad[0]!r}, which the ROS build tools do not support',
                'move the clone to a path of letters (a to z), digits, and the characters . _ - + @ =',
            )
        self.layout = layout
        self.underlay = detect(environment, layout)
        self.clean_environment = clean_environment(environment, self.underlay, layout)
        self.venv = VirtualEnvironment(layout, self.underlay.distribution, self.clean_environment)
        self._build = Build(layout, self.underlay, self.venv, self.clean_environment)

    def is_installed(self) -> bool:
        """Return whether the tools are there, and everything was built once (which may be out of date)."""
        return self._build.was_done() and (not self.underlay.is_wheels or self.venv.is_current())

    def ensure(self, lock: int) -> None:
        """Installs and builds what is missing; `lock` is a descriptor that the commands keep open."""
        if self.underlay.is_wheels:
            self.venv.ensure(lock)
        self._build.ensure(lock, beside=self._compiled_loops)
        self._compile_modules()
        self._get_text_editor(lock)

    @contextmanager
    def _compiled_loops(self, lock: int) -> Iterator[None]:
        """Compile the loops of numba beside the build: otherwise each process of the first start does it for itself.

        It needs nothing of what is built, and a processor that the build of the interfaces leaves idle.
        """
        log = self.layout.log / 'setup-loops.log'
        sources = [*(self.layout.root / name for name in _OF_LOOPS), self.clean_environment.get('PYTHONPATH', '')]
        process = start_logged(
            self._build.on_underlay(['python3', '-m', 'flexbt_navigation.preparation']),
            log,
            environment={**self.clean_environment, 'PYTHONPATH': os.pathsep.join(map(str, filter(None, sources)))},
            directory=self.layout.root,
            keep_open=[lock],
        )
        try:
            yield
        except BaseException:
            stop_group(process)
            raise
        with step('compilation of loops by numba') as shown:
            finish_logged(process, log, shown=shown, what='compilation of loops')

    def _compile_modules(self) -> None:
        """Those that changed, where Python is told not to: otherwise each start of a program would compile them all."""
        if self.clean_environment.get('PYTHONDONTWRITEBYTECODE'):
            for package in self.layout.packages():
                if package.is_python:
                    compileall.compile_dir(package.modules, quiet=2)

    def _get_text_editor(self, lock: int) -> None:
        """Get the text editor of the studio where npm is. Without it, or without a network, the studio has a plain one.

        `studio --get-editor` does it, here with axe-core, which tests use, and leaves the lock file there when it has
        succeeded.
        """
        own = self.layout.root / 'flexbt_studio' / 'flexbt_studio' / 'page' / 'package-lock.json'
        there = self.layout.venv / 'share' / 'flexbt_studio' / 'package-lock.json'
        has_npm = shutil.which('npm', path=self.clean_environment.get('PATH')) is not None
        if not (self.underlay.is_wheels and has_npm) or (there.exists() and there.read_bytes() == own.read_bytes()):
            return
        log = self.layout.log / 'setup-editor.log'
        with step('text editor of the studio') as shown:
            try:
                run_logged(
                    self.inside(['studio', '--get-editor']),
                    log,
                    shown=shown,
                    what='getting the text editor',
                    environment={**self.environment, 'NPM_CONFIG_INCLUDE': 'dev'},
                    directory=self.layout.root,
                    keep_open=[lock],
                )
            except CommandError as error:
                if error.was_killed:
                    raise
                shown.outcome = f'not to be had, the studio has a plain one (see {log})'

    def inside(self, command: Sequence[str | Path]) -> list[str | Path]:
        """`command` as one that runs with everything of the workspace set up."""
        return ['/bin/sh', '-c', '. "$FLEXBT_ROOT/tools/env.sh" && exec "$@"', 'sh', *command]

    @property
    def environment(self) -> dict[str, str]:
        """The environment for commands made by `inside`."""
        return {**self.clean_environment, 'FLEXBT_ROOT': str(self.layout.root)}

    def become(self, command: Sequence[str | Path]) -> NoReturn:
        """Replace this process by `command`."""
        os.chdir(self.layout.root)
        words = [str(word) for word in self.inside(command)]
        os.execve(words[0], words, self.environment)
