# SPDX-License-Identifier: BSD-3-Clause
"""The wheels underlay: a virtual environment of pinned packages, laid out so that colcon takes it for a ROS prefix."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

from workspace.errors import CommandError
from workspace.installer import Installer
from workspace.layout import STAMP, Layout, hash_of, read_stamp, remove, write_stamp
from workspace.prerequisites import suitable_cmake
from workspace.terminal import Step, last_line, run_logged, step

_CMAKE_REQUIREMENTS = 'requirements-cmake.txt'
_UV_REQUIREMENT = 'requirements-uv.txt'
_BASE_PYTHON = Path(getattr(sys, '_base_executable', None) or sys.executable)  # workspace.sh has looked for it

# Sourced by colcon's scripts as the set-up of a prefix, and by tools/env.sh. POSIX sh, bash and zsh.
_LOCAL_SETUP = """\
# Written by the set-up of the workspace: the ROS 2 wheels in this virtual environment as a ROS prefix.
_flexbt_prefix={prefix}
_flexbt_prepend() {{
  eval "_flexbt_value=\\${{$1-}}"
  case ":$_flexbt_value:" in
    *":$2:"*) ;;
    *) eval "export $1=\\"\\$2\\${{_flexbt_value:+:\\$_flexbt_value}}\\"" ;;
  esac
}}
_flexbt_prepend AMENT_PREFIX_PATH "$_flexbt_prefix"
_flexbt_prepend CMAKE_PREFIX_PATH "$_flexbt_prefix"
for _flexbt_value_of_loop in "$_flexbt_prefix"/lib/python3.*/site-packages/ros_*.libs; do
  _flexbt_prepend LD_LIBRARY_PATH "$_flexbt_value_of_loop"
done
_flexbt_prepend LD_LIBRARY_PATH "$_flexbt_prefix/lib"
_flexbt_prepend PATH "$_flexbt_prefix/bin"
# The library path is complete: the wheels need not start every Python a second time to set it.
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
export ROS_DISTRO={distribution} ROS_VERSION=2 ROS_PYTHON_VERSION=3 RMW_IMPLEMENTATION=rmw_fastrtps_cpp
unset _flexbt_prefix _flexbt_value _flexbt_value_of_loop
unset -f _flexbt_prepend
"""


class VirtualEnvironment:
    """The virtual environment of the workspace. `ensure` makes it, completes it, or leaves it as it is."""

    def __init__(self, layout: Layout, distribution: str, environment: Mapping[str, str]) -> None:
        """`environment` is the clean one, see underlay.clean_environment."""
        self._layout = layout
        self._distribution = distribution
        self._locks = ['lock.txt', f'lock-{distribution}.txt']
        self._environment = environment
        self.path = layout.venv
        self.python = self.path / 'bin' / 'python'
        self._stamp = self.path / STAMP

    @property
    def local_setup(self) -> Path:
        return self.path / 'local_setup.sh'

    @property
    def colcon_defaults(self) -> Path:
        return self.path / 'colcon-defaults.yaml'

    def is_current(self) -> bool:
        """Return whether there is nothing to do. Reads a few small files only."""
        return self._has_chosen_python() and read_stamp(self._stamp) == self._wanted()

    def ensure(self, lock: int) -> None:
        """Make the environment, or installs what changed. `lock` is held open by the commands.

        Raises CommandError when Python fails, or uv and pip.
        """
        if self.is_current():
            return
        if not self._usable():
            with step('virtual environment') as shown:
                self._create(shown, lock)
        self._install(lock)
        self._write_setup_files()
        write_stamp(self._stamp, self._wanted())

    def interpreter(self) -> str:
        """Return the interpreter and its version, as the identity of what is built with it."""
        home = read_stamp(self._stamp).get('interpreter', '')
        return str(home)

    def _wanted(self) -> dict[str, str]:
        return {
            'requirements': hash_of(self._requirement_files(), self._layout.tools),
            'cmake': 'own' if self._brings_cmake() else 'of the machine',
            'prefix': str(self.path),
            'interpreter': str(self.python.resolve()),
            'setup': hash_of([Path(__file__)], Path(__file__).parent),
        }

    def _brings_cmake(self) -> bool:
        return (self.path / 'bin' / 'cmake').exists() or not suitable_cmake(self._environment)

    def _requirement_files(self) -> list[Path]:
        return [self._layout.tools / name for name in (*self._locks, _CMAKE_REQUIREMENTS, _UV_REQUIREMENT)]

    def _usable(self) -> bool:
        """Return whether what is there can be completed: of the right Python, and at this place."""
        if not self._stamp.exists() or not self._has_chosen_python():
            return False
        look = 'import sys; print(sys.prefix); sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))'
        try:
            answer = subprocess.run([self.python, '-E', '-c', look], capture_output=True, text=True, timeout=60)
        except (OSError, subprocess.TimeoutExpired):
            return False
        colcon = self.path / 'bin' / 'colcon'
        moved = colcon.exists() and str(self.path).encode() not in colcon.read_bytes()[:500]
        return answer.returncode == 0 and answer.stdout.strip() == str(self.path) and not moved

    def _has_chosen_python(self) -> bool:
        """Return whether its interpreter exists, and is the one that PYTHON names where that is set."""
        chosen = self._environment.get('PYTHON')
        return self.python.exists() and (not chosen or self.python.resolve() == _BASE_PYTHON.resolve())

    def _create(self, shown: Step, lock: int) -> None:
        remove(self.path)
        command: list[str | Path] = [_BASE_PYTHON, '-E', '-m', 'venv', '--without-pip', self.path]
        self._run(command, 'setup-venv.log', 'making the virtual environment', shown, lock=lock)
        shown.outcome = f'made with Python {sys.version_info.major}.{sys.version_info.minor}.{sys.version_info.micro}'

    def _install(self, lock: int) -> None:
        names = [*self._locks, *((_CMAKE_REQUIREMENTS,) if self._brings_cmake() else ())]
        tools = self._layout.tools
        before, installed_before = read_stamp(self._stamp), self._installed()
        self._stamp.unlink(missing_ok=True)
        installer = Installer(self.python, self._environment, partial(self._run, lock=lock))
        try:
            installer.install([tools / name for name in names], tools / _UV_REQUIREMENT)
        except CommandError as error:
            if before and not error.was_killed and self._installed() == installed_before:
                write_stamp(self._stamp, before)  # what was here can still be used
            raise

    def _installed(self) -> set[str]:
        """Return the names and versions of what is installed."""
        return {path.name for path in self.path.glob('lib/python3.*/site-packages/*.dist-info')}

    def _run(
        self,
        command: Sequence[str | Path],
        log: str,
        what: str,
        shown: Step,
        *,
        lock: int,
        remedy: str = '',
        progress: Callable[[Path], str] = last_line,
        variables: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        run_logged(
            command,
            self._layout.log / log,
            shown=shown,
            what=what,
            environment={**self._environment, **variables},
            directory=self._layout.root,
            progress=progress,
            remedy=remedy,
            keep_open=[lock],
        )

    def _write_setup_files(self) -> None:
        """Write the files by which colcon chains the environment into install/setup.*, and the defaults of colcon."""
        text = _LOCAL_SETUP.format(prefix=shlex.quote(str(self.path)), distribution=self._distribution)
        for shell in ('sh', 'bash', 'zsh'):
            (self.path / f'local_setup.{shell}').write_text(text, encoding='utf-8')
            (self.path / f'setup.{shell}').write_text(f'. {shlex.quote(str(self.local_setup))}\n', encoding='utf-8')
        # JSON strings are YAML strings.
        arguments = [
            f'-DCMAKE_PROJECT_INCLUDE={self._layout.interface_tools / "wheels.cmake"}',
            f'-DPython3_EXECUTABLE={self.python}',
            '-DBUILD_TESTING=OFF',
        ]
        quoted = ', '.join('"' + argument.replace('\\', '\\\\').replace('"', '\\"') + '"' for argument in arguments)
        self.colcon_defaults.write_text(
            f'build:\n  symlink-install: true\n  cmake-args: [{quoted}]\ntest:\n  return-code-on-test-failure: true\n',
            encoding='utf-8',
        )
