# SPDX-License-Identifier: BSD-3-Clause
"""What the machine has to bring, looked for before anything is installed."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from workspace.errors import WorkspaceError, write_remedy
from workspace.installer import bundled_pip
from workspace.layout import STAMP, Layout
from workspace.underlay import Underlay

SPACE_OF_WHEELS = 1_000_000_000  # bytes: virtual environment 0.6 GB, the downloads
SPACE_OF_PIP = 300_000_000  # bytes of temporary files, at most 0.15 GB
SPACE_OF_BUILD = 300_000_000  # bytes: 0.1 GB on the wheels; an installation also builds the C++ interfaces
OLDEST_GLIBC = (2, 28)  # the wheels are manylinux_2_28
OLDEST_CMAKE = (3, 22)
FIRST_BAD_CMAKE = (4, 0)  # refuses the cmake_minimum_required of several ament packages

# Import name -> rosdep key and Ubuntu package, of what the packages import besides ROS.
_MODULES = {
    'aiohttp': 'python3-aiohttp',
    'greenlet': 'python3-greenlet',
    'hypothesis': 'python3-hypothesis',
    'msgpack': 'python3-msgpack',
    'numpy': 'python3-numpy',
    'PIL': 'python3-pil',
    'prompt_toolkit': 'python3-prompt-toolkit',
    'pytest': 'python3-pytest',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
    'zmq': 'python3-zmq',
}


@dataclass(frozen=True)
class Missing:
    """Something that is missing, and the command (or sentence) that mends it."""

    what: str
    remedy: str


def check(underlay: Underlay, layout: Layout, environment: Mapping[str, str]) -> None:
    """Raise WorkspaceError that names everything that is missing, with the commands that install it."""
    missing = list(_missing(underlay, layout, environment))
    if not missing:
        return
    packages = sorted({one.remedy for one in missing if ' ' not in one.remedy})
    remedies = [one.remedy for one in missing if ' ' in one.remedy]
    if packages:
        remedies.insert(0, 'sudo apt-get install ' + ' '.join(packages))
    raise WorkspaceError(
        'this machine lacks ' + '; '.join(one.what for one in missing), '\n        '.join(dict.fromkeys(remedies))
    )


def suitable_cmake(environment: Mapping[str, str]) -> bool:
    """Return whether the machine's own CMake is one that can build the interfaces."""
    version = _version_of('cmake', environment)
    return version is not None and OLDEST_CMAKE <= version < FIRST_BAD_CMAKE


def _missing(underlay: Underlay, layout: Layout, environment: Mapping[str, str]) -> Iterator[Missing]:
    path = environment.get('PATH')
    for program, package in (('g++', 'g++'), ('make', 'make')):
        if shutil.which(program, path=path) is None:
            yield Missing(f'the program {program}', package)
    if not os.access(layout.root, os.W_OK | os.X_OK):
        yield Missing(f'the permission to write to {layout.root}', write_remedy(layout.root))
    yield from _missing_space(underlay, layout)
    yield from (
        _missing_for_wheels(underlay.distribution) if underlay.is_wheels else _missing_for_installation(environment)
    )


def _missing_space(underlay: Underlay, layout: Layout) -> Iterator[Missing]:
    wheels = underlay.is_wheels and not (layout.venv / STAMP).exists()
    build = not (layout.build / STAMP).exists()
    needs = [
        (layout.root, SPACE_OF_WHEELS * wheels + SPACE_OF_BUILD * build, 'free disk space, or clone to another disk')
    ]
    if wheels:
        place = Path(tempfile.gettempdir())
        needs.append((place, SPACE_OF_PIP, f'free space in {place}, or set TMPDIR to a directory on another disk'))
    for directory, needed, remedy in needs:
        free = shutil.disk_usage(directory).free
        if free < needed:
            yield Missing(
                f'disk space: {free / 1e9:.1f} GB are free in {directory}, {needed / 1e9:.1f} GB are needed', remedy
            )


def _missing_for_wheels(distribution: str) -> Iterator[Missing]:
    machine, (libc, libc_version) = platform.machine(), platform.libc_ver()
    own_ros = f'install ROS 2 {distribution} and source its setup.bash; then the wheels are not needed'
    if sys.platform != 'linux' or machine != 'x86_64':
        yield Missing(f'ROS 2 wheels: there are none for {sys.platform} on {machine} (only Linux on x86_64)', own_ros)
    elif libc != 'glibc' or _numbers(libc_version) < OLDEST_GLIBC:
        yield Missing(
            f'glibc 2.28 or later, for the ROS 2 wheels (found {libc or "another libc"} {libc_version})', own_ros
        )
    minor = f'python3.{sys.version_info.minor}'
    if bundled_pip() is None or importlib.util.find_spec('venv') is None:
        yield Missing(f"Python's venv and ensurepip modules (for {sys.executable})", f'{minor}-venv')
    if not (Path(sysconfig.get_path('include')) / 'Python.h').exists():
        yield Missing(f'the header files of Python (for {sys.executable})', f'{minor}-dev')


def _missing_for_installation(environment: Mapping[str, str]) -> Iterator[Missing]:
    if not suitable_cmake(environment):
        yield Missing('CMake from 3.22 to 3.x', 'cmake')
    if shutil.which('colcon', path=environment.get('PATH')) is None:
        yield Missing('the program colcon', 'python3-colcon-common-extensions')
    python = shutil.which('python3', path=environment.get('PATH')) or 'python3'
    look = 'import importlib.util, sys\nfor m in sys.argv[1:]:\n  if importlib.util.find_spec(m) is None: print(m)'
    found = subprocess.run([python, '-c', look, *_MODULES], env=dict(environment), capture_output=True, text=True)
    for name in found.stdout.split():
        yield Missing(f'the Python module {name} (for {python})', _MODULES[name])


def _version_of(program: str, environment: Mapping[str, str]) -> tuple[int, ...] | None:
    file = shutil.which(program, path=environment.get('PATH'))
    if file is None:
        return None
    try:
        answer = subprocess.run([file, '--version'], env=dict(environment), capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return None
    match = re.search(r'\d+(\.\d+)+', answer.stdout)
    return _numbers(match[0]) if match and answer.returncode == 0 else None


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r'\d+', version)[:2])
