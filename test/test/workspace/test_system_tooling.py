# SPDX-License-Identifier: BSD-3-Clause
"""The set-up on machines that lack something: it says so before it begins, and names the remedy."""

import fcntl
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
TIMEOUT_S = 60

sys.path.append(str(ROOT / 'tools'))
from workspace.layout import Layout  # noqa: E402
from workspace.underlay import DISTRIBUTIONS, WHEELS, with_spaces  # noqa: E402

CHOICE = {name: value for name, value in os.environ.items() if name == 'ROS_WHEELS'}
LAYOUT = with_spaces(Layout(ROOT), CHOICE)
IS_BUILT = (LAYOUT.install / 'flexbt_underlay.sh').exists()
PYTHON = Path(sys.base_prefix) / 'bin' / f'python3.{sys.version_info.minor}'


class Machine:
    """A clone that was never set up, on a machine that has the programs of its directory `bin` only."""

    def __init__(self, directory: Path, clone: str) -> None:
        self.clone = directory / clone
        self.bin = directory / 'bin'
        self.bin.mkdir()
        shutil.copytree(ROOT / 'tools', self.clone / 'tools', ignore=shutil.ignore_patterns('__pycache__'))
        for program in ('sh', 'dirname', 'g++', 'make'):
            self.install(program, shutil.which(program) or os.devnull)
        self.install('python3', PYTHON)

    def install(self, name: str, program: str | Path) -> None:
        (self.bin / name).symlink_to(program)

    def install_script(self, name: str, text: str) -> Path:
        file = self.bin / name
        file.write_text(f'#!/bin/sh\n{text}\n', encoding='utf-8')
        file.chmod(0o755)
        return file

    def start(self, command: str, **environment: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.clone / 'tools' / 'workspace.sh', command],
            env={'HOME': str(self.clone), 'PATH': str(self.bin), **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def refusal(self, **environment: str) -> str:
        """Return what the set-up prints when it refuses to begin."""
        process = self.start('setup', **environment)
        text, _ = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 1, text
        assert 'Traceback' not in text
        assert not (self.clone / '.venv').exists()
        return text


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path, 'clone')


def sourced(machine: Machine, distribution: str) -> Path:
    """Return the prefix of an installation of ROS that has nothing but the manifest of rclpy."""
    prefix = machine.clone.parent / distribution
    (prefix / 'share' / 'rclpy').mkdir(parents=True)
    (prefix / 'share' / 'rclpy' / 'package.xml').touch()
    return prefix


def test_no_compiler(machine: Machine) -> None:
    (machine.bin / 'g++').unlink()
    text = machine.refusal()
    assert 'lacks the program g++' in text
    assert 'sudo apt-get install g++' in text


def test_a_python_of_another_version(machine: Machine) -> None:
    fake = machine.install_script('python3.9', 'if [ "$1" = -V ]; then echo Python 3.9.18; else exit 1; fi')
    text = machine.refusal(PYTHON=str(fake))
    assert f'PYTHON={fake} is not a Python 3.11 to 3.12: Python 3.9.18' in text
    assert 'remedy:' in text


def test_another_ros_distribution(machine: Machine) -> None:
    text = machine.refusal(ROS_DISTRO='humble', AMENT_PREFIX_PATH='/opt/ros/humble')
    assert 'ROS_DISTRO=humble is sourced' in text
    assert '/opt/ros/jazzy/setup.bash' in text


def test_wheels_that_there_are_not(machine: Machine) -> None:
    text = machine.refusal(ROS_WHEELS='humble')
    assert 'ROS_WHEELS=humble: there are no wheels of that ROS 2 distribution; known: jazzy, kilted' in text
    assert 'remedy:' in text


def test_wheels_that_are_named_come_before_what_is_sourced_and_have_a_place_of_their_own(machine: Machine) -> None:
    (machine.bin / 'g++').unlink()
    text = machine.refusal(ROS_WHEELS='kilted', ROS_DISTRO='jazzy', AMENT_PREFIX_PATH=str(sourced(machine, 'jazzy')))
    assert 'set-up on ROS 2 Kilted from PyPI wheels' in text
    assert not (machine.clone / '.kilted').exists()
    layouts = [with_spaces(Layout(machine.clone), {'ROS_WHEELS': name}) for name in WHEELS]
    assert layouts[0] == Layout(machine.clone)
    for place in ('venv', 'build', 'install', 'log'):
        assert len({getattr(layout, place) for layout in layouts}) == len(WHEELS)
    shell = ['sh', '-c', '. tools/env.sh']
    ended = subprocess.run(
        shell, cwd=machine.clone, env={'PATH': os.defpath, 'ROS_WHEELS': 'kilted'}, capture_output=True, text=True
    )
    assert "run 'make setup ROS_WHEELS=kilted'" in ended.stderr


@pytest.mark.parametrize('distribution', DISTRIBUTIONS)
def test_an_installation_of_ros_without_colcon_and_cmake(machine: Machine, distribution: str) -> None:
    prefix = sourced(machine, distribution)
    text = machine.refusal(ROS_DISTRO=distribution, AMENT_PREFIX_PATH=str(prefix))
    assert f'set-up on ROS 2 {distribution.capitalize()} in {prefix}' in text
    assert 'the program colcon' in text
    [packages] = re.findall('sudo apt-get install (.*)', text)
    assert {'cmake', 'python3-colcon-common-extensions'} <= set(packages.split())


@pytest.mark.parametrize('name', ['a space', 'a:colon', 'a,comma', "it's", 'büro'])
def test_a_path_that_ros_cannot_build_in(tmp_path: Path, name: str) -> None:
    text = Machine(tmp_path, name).refusal()
    assert f'the path of the clone, {tmp_path / name}, contains' in text
    assert 'move the clone' in text


def test_two_at_a_time_wait_for_each_other(machine: Machine) -> None:
    lock = os.open(machine.clone, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = machine.start('clean')
        assert process.stdout is not None
        assert 'waiting for it' in process.stdout.readline()
        assert process.poll() is None
    finally:
        os.close(lock)
    process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 0


@pytest.mark.skipif(not IS_BUILT, reason='built by colcon alone')
@pytest.mark.parametrize('shell', ['bash', 'dash', 'zsh'])
def test_the_environment_in_a_strict_shell(shell: str, tmp_path: Path) -> None:
    """Sourced from elsewhere, twice, under `set -eu`; a plain sh has to be told where the workspace is."""
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f'{shell} is not installed')
    source = '. "$0/tools/env.sh"'
    script = f'{source}; before=$PATH; {source}; test "$before" = "$PATH"; set -o | grep nounset; command -v bt_server'
    environment = {'HOME': str(tmp_path), 'PATH': os.defpath, **CHOICE}
    if shell == 'dash':
        environment['FLEXBT_ROOT'] = str(ROOT)
    ended = subprocess.run(
        [program, '-euc', script, ROOT],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    assert ended.returncode == 0, ended.stderr
    nounset, executable = ended.stdout.splitlines()
    assert nounset.split()[-1] == 'on'
    assert executable == f'{LAYOUT.install}/flexbt_server/lib/flexbt_server/bt_server'


@pytest.mark.skipif(not IS_BUILT, reason='built by colcon alone')
@pytest.mark.parametrize('shell', ['bash', 'dash', 'zsh'])
def test_a_copy_of_a_built_workspace_has_to_be_built(shell: str, machine: Machine) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f'{shell} is not installed')
    install = machine.clone / LAYOUT.install.relative_to(ROOT)
    install.mkdir(parents=True)
    for name in ('local_setup.sh', 'flexbt_underlay.sh'):
        shutil.copy(LAYOUT.install / name, install)
    ended = subprocess.run(
        [program, '-c', '. tools/env.sh'],
        cwd=machine.clone,
        env={'PATH': os.defpath, **CHOICE},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 1
    assert ended.stderr.startswith(
        f"error: this is a copy of {ROOT.resolve()}, or was moved from there: run 'make setup"
    )


@pytest.mark.skipif(not IS_BUILT, reason='built by colcon alone')
@pytest.mark.skipif(os.geteuid() != 0, reason='only root can mount')
def test_logs_of_ros_have_a_place_where_neither_workspace_nor_home_can_be_written(tmp_path: Path) -> None:
    script = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && . "$0/tools/env.sh" && echo "$ROS_LOG_DIR"'
    ended = subprocess.run(
        ['unshare', '--mount', 'bash', '-c', script, ROOT],
        cwd=tmp_path,
        env={'HOME': '/nowhere', 'PATH': os.defpath, 'TMPDIR': str(tmp_path), **CHOICE},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    assert ended.stdout == f'{tmp_path}/flexbt-0/log\n', ended.stderr


STATES_CMAKE = """cmake_minimum_required(VERSION 3.5)
project(some_flexbe_states)
find_package(ament_cmake REQUIRED)
find_package(ament_cmake_python REQUIRED)
find_package(rclcpp REQUIRED)
find_package(rclpy REQUIRED)
ament_python_install_package(${PROJECT_NAME})
ament_package()
"""
STATES_PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>some_flexbe_states</name><version>1.0.0</version><description>States</description>
  <maintainer email="somebody@example.org">Somebody</maintainer><license>BSD</license>
  <buildtool_depend>ament_cmake</buildtool_depend><buildtool_depend>ament_cmake_python</buildtool_depend>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


@pytest.mark.skipif(not IS_BUILT, reason='built by colcon alone')
def test_a_package_for_flexbe_that_asks_for_rclcpp_is_built_on_the_wheels(tmp_path: Path) -> None:
    source = tmp_path / 'src' / 'some_flexbe_states'
    (source / 'some_flexbe_states').mkdir(parents=True)
    (source / 'some_flexbe_states' / '__init__.py').touch()
    (source / 'CMakeLists.txt').write_text(STATES_CMAKE)
    (source / 'package.xml').write_text(STATES_PACKAGE)
    ended = subprocess.run(
        ['bash', '-c', '. "$0/tools/env.sh" && colcon build', ROOT],
        cwd=tmp_path,
        env={'HOME': str(tmp_path), 'PATH': os.defpath, **CHOICE},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert (tmp_path / 'install' / 'some_flexbe_states' / 'share' / 'some_flexbe_states' / 'package.xml').exists()


@pytest.mark.parametrize(
    ('line', 'is_refused'),
    [
        ('import random', True),
        ('from random import choice', True),
        ('from datetime import datetime; datetime.now()', True),
        ('import uuid; uuid.uuid1()', True),
        ('import os; os.fork()', True),
        ('from os import getpid', True),
        ('import subprocess', True),
        ('import threading, time, uuid; time.sleep(1); threading.Thread(); uuid.uuid4()', False),
        ('from datetime import UTC, datetime; datetime.fromtimestamp(0, UTC)', False),
    ],
)
def test_lint_refuses_what_a_world_in_one_process_cannot_replace(line: str, is_refused: bool) -> None:
    for package in ('flexbt_core', 'flexbt_navigation', 'flexbt_onboard', 'flexbt_states'):
        command = ['ruff', 'check', '--select', 'TID251', '--stdin-filename', f'{package}/{package}/new.py', '-']
        ran = subprocess.run(command, cwd=ROOT, input=line, capture_output=True, text=True)
        assert ('A world in one process' in ran.stdout) == is_refused, ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ('words', 'given'),
    [
        (['studio', "PROJECT=/a folder/Jörg's"], "/a folder/Jörg's"),
        (['studio'], 'flexbt_demo_behaviors'),
        (['nemesis', 'WORLD=/a folder/w.yaml'], '/a folder/w.yaml'),
    ],
)
def test_make_passes_a_path_on_as_one_word(tmp_path: Path, words: list[str], given: str) -> None:
    shutil.copy(ROOT / 'Makefile', tmp_path)
    (tmp_path / 'tools').mkdir()
    (tmp_path / 'tools' / 'workspace.sh').write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n', encoding='utf-8')
    (tmp_path / 'tools' / 'workspace.sh').chmod(0o755)
    made = subprocess.run(['make', *words], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert given in made.stdout.splitlines()
