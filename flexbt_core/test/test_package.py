# SPDX-License-Identifier: BSD-3-Clause
"""flexbt_core is a package of its own: installed in an empty environment, without ROS, it does what its README says."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

PACKAGE = Path(__file__).resolve().parents[1]
README = (PACKAGE / 'README.md').read_text(encoding='utf-8')


def blocks(language: str) -> list[str]:
    """Return the blocks of the README in a language."""
    return re.findall(rf'^```{language}\n(.*?)^```$', README, re.MULTILINE | re.DOTALL)


def run(*command: str | Path) -> str:
    """Return what a command prints; without anything of this process's environment that leads to other packages."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(('PYTHON', 'PIP_'))}
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope='module')
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the interpreter of an environment in which nothing is but PyYAML, and flexbt_core as pip has installed
    it."""
    directory = tmp_path_factory.mktemp('empty')
    source, wheels, environment = directory / 'source', directory / 'wheels', directory / 'environment'
    # A copy, since the build writes beside the sources.
    shutil.copytree(PACKAGE, source, ignore=shutil.ignore_patterns('test', 'build', '*.egg-info', '__pycache__'))
    pip = [sys.executable, '-m', 'pip', '--quiet', '--disable-pip-version-check']
    run(*pip, 'wheel', '--no-index', '--no-deps', '--no-build-isolation', '--wheel-dir', wheels, source)
    run(sys.executable, '-m', 'venv', '--without-pip', environment)
    interpreter = environment / 'bin' / 'python'
    packages = Path(run(interpreter, '-c', 'import sysconfig; print(sysconfig.get_path("purelib"))').strip())
    for pattern in ('yaml', '_yaml*', '[Pp]y[Yy][Aa][Mm][Ll]-*'):  # with what says that it is installed
        for found in Path(yaml.__file__).parents[1].glob(pattern):
            (packages / found.name).symlink_to(found)
    # No index, so that whatever it required besides PyYAML would be an error.
    run(*pip, '--python', interpreter, 'install', '--no-index', '--no-compile', *wheels.glob('*.whl'))
    return interpreter


@pytest.mark.parametrize(('example', 'printed'), list(zip(blocks('python'), blocks('text'), strict=True)))
def test_each_example_of_the_readme_runs_where_nothing_else_is_installed(
    python: Path, tmp_path: Path, example: str, printed: str
) -> None:
    program = tmp_path / 'example.py'
    program.write_text(
        example + '\nimport sys\n'
        "files = {name: str(getattr(module, '__file__', '')) for name, module in sys.modules.items()}\n"
        "installed = {name.partition('.')[0] for name, file in files.items() if '-packages' in file}\n"
        "assert installed <= {'flexbt_core', 'yaml', '_yaml'}, installed\n",
        encoding='utf-8',
    )
    assert run(python, '-I', program) == printed


def test_what_is_installed_is_described(python: Path) -> None:
    program = (
        'from importlib.metadata import files, metadata, requires\n'
        'about = metadata("flexbt_core")\n'
        'print(about["Requires-Python"], [one for one in requires("flexbt_core") if "extra" not in one])\n'
        'print(about["License"], [one.read_text() for one in files("flexbt_core") if one.name == "LICENSE"])\n'
        'print(about.get_payload())\n'
    )
    first, second, description = run(python, '-I', '-c', program).split('\n', 2)
    assert first == ">=3.11 ['pyyaml']"
    assert second == f'BSD-3-Clause {[(PACKAGE.parent / "LICENSE").read_text(encoding="utf-8")]}'
    assert description.strip() == README.strip()


def test_the_package_itself_imports_nothing(python: Path) -> None:
    program = 'import sys; before = set(sys.modules); import flexbt_core; print(sorted(set(sys.modules) - before))'
    assert run(python, '-I', '-c', program).strip() == "['flexbt_core']"
