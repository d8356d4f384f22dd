# SPDX-License-Identifier: BSD-3-Clause
"""Building the workspace: only the packages of which something changed that their installation depends on."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, TypedDict

from workspace.errors import CommandError
from workspace.layout import STAMP, Layout, Package, hash_of, read_stamp, remove, write_stamp
from workspace.terminal import run_logged, step
from workspace.underlay import Underlay
from workspace.virtual_environment import VirtualEnvironment

_FORMAT = 3  # of the stamp; a change of it builds everything anew
_PASSING = re.compile(r'\..*|.*~|__pycache__|.*\.egg-info')  # caches, and what editors leave while a file is open


class Fingerprint(TypedDict):
    """The inputs of the installation of a package: the names of its files, and the contents of some."""

    names: str
    contents: str


class Build:
    """The build and install spaces of the workspace on one underlay.

    Packages are installed by symbolic links, so an edited Python module or data file needs no build. What does
    need one: a changed manifest or setup file, a data file added or taken away, and any change to an interface.
    """

    def __init__(
        self, layout: Layout, underlay: Underlay, venv: VirtualEnvironment, environment: Mapping[str, str]
    ) -> None:
        """`environment` is the clean one, see underlay.clean_environment."""
        self._layout = layout
        self._underlay = underlay
        self._venv = venv
        self._environment = environment
        self._stamp = layout.build / STAMP

    def was_done(self) -> bool:
        """Return whether the workspace was built on this underlay before."""
        return read_stamp(self._stamp).get('identity') == self._identity()

    def ensure(self, lock: int, beside: Callable[[int], AbstractContextManager[None]]) -> None:
        """Build what has to be; where there is anything, in the context `beside(lock)`. `lock` is held open by colcon.

        Raises CommandError when a package does not build.
        """
        packages = [*self._layout.packages(), *self._stand_ins()]
        wanted = {package.name: self._fingerprint(package) for package in packages}
        state = read_stamp(self._stamp)
        built: dict[str, Fingerprint] = dict(state.get('packages', {}))
        # A killed compiler may have left half a file with a new date.
        to_remove: set[str] = set(state.get('building', []))
        if not self.was_done():
            self._start_over(bool(state))
            built, to_remove = {}, set()
        # What was made of a file that is gone stays behind, and generated code goes on referring to it.
        to_remove |= {
            name for name, done in built.items() if name not in wanted or done['names'] != wanted[name]['names']
        }
        self._remove(to_remove)
        built = {name: done for name, done in built.items() if name not in to_remove}
        stale = sorted(name for name, value in wanted.items() if built.get(name) != value or not self._installed(name))
        with beside(lock) if stale else nullcontext():
            if stale:
                self._record(built, building=stale)
                try:
                    self._colcon_build(stale, lock)
                except CommandError as error:
                    if not error.was_killed:  # then what it left can be built on
                        self._record(built, building=[])
                    raise
            self._write_underlay_setup()
            self._record({**built, **{name: wanted[name] for name in stale}}, building=[])

    def _stand_ins(self) -> list[Package]:
        """For the interfaces of others that the underlay lacks."""
        if self._underlay.is_wheels:
            return self._layout.stand_ins([self._venv.path])
        prefixes = self._environment.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
        return self._layout.stand_ins(Path(prefix) for prefix in prefixes if prefix)

    def _colcon_build(self, names: list[str], lock: int) -> None:
        count = len(names)
        with step(f'build of {count} package{"s" if count > 1 else ""}') as shown:
            command: list[str | Path] = ['colcon', '--log-base', self._layout.log / 'colcon', 'build']
            command += ['--build-base', self._layout.build, '--install-base', self._layout.install]
            command += ['--base-paths', self._layout.root, *(package.path for package in self._stand_ins())]
            command += ['--event-handlers', 'console_cohesion+']
            if not self._underlay.is_wheels:
                command.append('--symlink-install')
            command += ['--packages-select', *names]
            run_logged(
                self.on_underlay(command),
                self._layout.log / 'setup-build.log',
                shown=shown,
                what='colcon build',
                environment=self._environment_of_build(),
                directory=self._layout.root,
                progress=lambda log: self._progress(log, count),
                remedy='mend what the log names, then run again; after a change of the system, `make clean` first',
                keep_open=[lock],
            )
            shown.outcome = 'built'

    def _environment_of_build(self) -> dict[str, str]:
        """With a job for each core; colcon's own choice waits whenever something else is at work on the machine."""
        jobs = os.cpu_count() or 2
        environment = {'MAKEFLAGS': f'-j{jobs}', 'CMAKE_BUILD_PARALLEL_LEVEL': f'{jobs}', 'PYTHONWARNINGS': 'ignore'}
        if self._underlay.is_wheels:
            environment['CMAKE_GENERATOR'] = 'Ninja'
            environment['PYTHONPATH'] = str(self._layout.interface_tools)  # its sitecustomize.py
        return {**self._environment, **environment}

    def _progress(self, log: Path, count: int) -> str:
        """Return what is built, and what is being built; with how much of it where `make` or `ninja` say so."""
        text = log.read_text(encoding='utf-8', errors='replace')
        done = re.findall(r'^Finished <<< (\S+)', text, re.MULTILINE)
        parts = [f'{len(done)} of {count} packages built']
        for name in re.findall(r'^Starting >>> (\S+)', text, re.MULTILINE):
            if name not in done:
                output = self._layout.log / 'colcon' / 'latest_build' / name / 'stdout.log'
                steps = re.findall(r'^\[ *(\d+%|\d+/\d+)\]', _end_of(output), re.MULTILINE)
                parts.append(f'{name} ({steps[-1]})' if steps else name)
        return ', '.join(parts)

    def on_underlay(self, command: list[str | Path]) -> list[str | Path]:
        """`command` as one that runs with the underlay set up, and without the overlay that is being built."""
        if not self._underlay.is_wheels:
            return command
        setup = f'. {shlex.quote(str(self._venv.local_setup))}; export COLCON_DEFAULTS_FILE="$1"; shift; exec "$@"'
        return ['/bin/sh', '-c', setup, 'sh', self._venv.colcon_defaults, *command]

    def _identity(self) -> dict[str, Any]:
        """Return what everything was built with. When it differs, nothing in the build space is of use."""
        python = self._venv.interpreter() if self._underlay.is_wheels else sys.version
        return {
            'format': _FORMAT,
            'underlay': str(self._underlay.prefix or 'wheels'),
            'python': python,
            'root': str(self._layout.root),
        }

    def _start_over(self, changed: bool) -> None:
        present = [path for path in (self._layout.build, self._layout.install) if path.exists()]
        if not present:
            return
        reason = 'its underlay, place or tools have changed' if changed else 'made by something else'
        print(f'  removing build/ and install/ ({reason})', flush=True)
        for path in present:
            remove(path)

    def _remove(self, names: Iterable[str]) -> None:
        for name in names:
            for space in (self._layout.build, self._layout.install):
                remove(space / name)

    def _installed(self, name: str) -> bool:
        return (self._layout.install / name / 'share' / name / 'package.xml').exists()

    def _record(self, packages: dict[str, Fingerprint], building: list[str]) -> None:
        content = {'identity': self._identity(), 'packages': packages, 'building': building}
        if content != read_stamp(self._stamp):
            write_stamp(self._stamp, content)

    def _fingerprint(self, package: Package) -> Fingerprint:
        files = [
            file
            for file in package.path.rglob('*')
            if file.is_file() and not any(_PASSING.fullmatch(part) for part in file.relative_to(package.path).parts)
        ]
        if package.is_python:
            linked = (package.modules, package.path / 'test')
            files = [file for file in files if not any(place in file.parents for place in linked)]
            decisive = [file for file in files if file.name in ('setup.py', 'setup.cfg', 'package.xml')]
        else:
            decisive = [*files, self._layout.root / 'colcon.meta', *self._layout.interface_tools.glob('*.*')]
        root = self._layout.root
        return {'names': hash_of([], root, names_only=files), 'contents': hash_of(decisive, root)}

    def _write_underlay_setup(self) -> None:
        """Write the file by which tools/env.sh finds the place and the underlay of the build."""
        prefix = self._underlay.prefix or self._venv.path
        setup = self._venv.local_setup if self._underlay.is_wheels else prefix / 'setup.sh'
        text = f'# built in {self._layout.root}\n. {shlex.quote(str(setup))}\n'
        if (prefix / 'lib' / 'libfastdds.so').exists():  # as in flexbt_common/discovery.py
            text += '_flexbt_fastdds=3\n'
        if self._underlay.is_wheels:
            text += f'export COLCON_DEFAULTS_FILE={shlex.quote(str(self._venv.colcon_defaults))}\n'
        file = self._layout.install / 'flexbt_underlay.sh'
        if not file.exists() or file.read_text(encoding='utf-8') != text:
            self._layout.install.mkdir(exist_ok=True)
            file.write_text(text, encoding='utf-8')


def _end_of(file: Path) -> str:
    """Return the last lines of `file`; none when there is no such file yet."""
    try:
        return file.read_text(encoding='utf-8', errors='replace')[-2000:]
    except FileNotFoundError:
        return ''
