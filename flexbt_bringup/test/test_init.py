# SPDX-License-Identifier: BSD-3-Clause
"""The package that ``flexbt init`` writes builds, and its own tests pass."""

from __future__ import annotations

import configparser
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from flexbt_bringup.package_template import UnwritableError, write_package

NAME = 'quarry_missions'


@pytest.fixture(scope='module')
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write and build the package as its README says; return the workspace."""
    root = tmp_path_factory.mktemp('workspace')
    ran = run(root, ['flexbt', 'init', NAME, '--directory', 'src'])
    assert ran.returncode == 0, ran.stderr
    built = run(root, ['colcon', 'build', '--symlink-install'])
    assert built.returncode == 0, built.stdout + built.stderr
    return root


def run(directory: Path, command: list[str], script: str = '') -> subprocess.CompletedProcess[str]:
    words = ['bash', '-c', f'. {script} && exec "$@"', 'bash', *command] if script else command
    home = os.environ | {'HOME': str(directory)}
    return subprocess.run(words, cwd=directory, capture_output=True, text=True, check=False, timeout=300, env=home)


@pytest.mark.dds('the tests of the package are a process, as a user starts it')
def test_its_tests_pass_without_executables_on_the_path(workspace: Path) -> None:
    python = ['env', 'PATH=/usr/bin:/bin', sys.executable]  # as with ROS, where they are run by `ros2 run`
    tests = run(workspace, [*python, '-m', 'pytest', '-q', f'src/{NAME}/test'], 'install/local_setup.sh')
    assert tests.returncode == 0, tests.stdout + tests.stderr
    assert '8 passed' in tests.stdout


def test_its_files_are_what_their_readers_expect(workspace: Path) -> None:
    package = workspace / 'src' / NAME
    unit = configparser.ConfigParser(strict=False, interpolation=None, comment_prefixes=('#',))
    unit.optionxform = str  # type: ignore[assignment,method-assign]  # keys are case-sensitive
    deploy = package / 'deploy'
    unit.read(deploy / 'flexbt@.service')
    assert unit['Service']['Restart'] == 'always'
    # Home directories are read-only for the unit: what goes below ~ by default needs a home that is not.
    assert unit['Service']['Environment'] == f'HOME=/var/lib/{unit["Service"]["StateDirectory"]}'
    services = yaml.safe_load((deploy / 'compose.yaml').read_text())['services']
    assert set(services) == {'bt_server', 'onboard_executive', 'stop_guard', 'black_box'}
    for name, service in services.items():
        context = (deploy / service['build']['context']).resolve()
        assert (context / service['build']['dockerfile']).read_text() == (deploy / 'Dockerfile').read_text()
        assert context == workspace, name  # the Dockerfile copies src
        assert service['command'].endswith('robot.yaml'), name
    assert run(workspace, ['world_tool', 'check', str(package / 'world.yaml')]).returncode == 0
    files = [file for file in package.rglob('*') if file.is_file() and '__pycache__' not in file.parts]
    left = [file for file in files if '@NAME@' in file.read_text()]
    assert left == []
    compile((package / 'launch' / 'robot.launch.py').read_text(), 'robot.launch.py', 'exec')


@pytest.mark.parametrize(('name', 'reason'), [
    ('My-Robot', 'is not the name of a package'),
    ('', 'is not the name of a package'),
    ('MyRobot', "such as 'my_robot'"),
    ('2nd-floor', "such as 'nd_floor'"),
    ('class', 'is a name of Python itself'),
    ('json', 'is a name of Python itself'),
    ('yaml', 'a Python module yaml is installed already'),
    ('flexbt_core', 'is installed already'),
    ('taken', 'taken exists; choose another name'),
])  # fmt: skip
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / 'taken').mkdir()
    with pytest.raises(UnwritableError, match=reason):
        write_package(name, tmp_path)
