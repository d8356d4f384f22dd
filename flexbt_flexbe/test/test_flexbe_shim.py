# SPDX-License-Identifier: BSD-3-Clause
"""The import shim, each time in a process of its own."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from flexbt_flexbe import shim
from flexbt_flexbe.errors import ShimError

USE = """
from flexbe_core import Autonomy, Behavior, EventState, Logger, OperatableStateMachine, StateLogger, set_node
from flexbe_core.core import StateError, StateMachineError, UserDataError
from flexbe_core.core.exceptions import UserDataError as SameError
from flexbe_core.core.user_data import UserData
from flexbe_core.logger import Logger as SameLogger
from flexbe_core.proxy import ProxyActionClient, ProxyPublisher, ProxyServiceCaller, ProxySubscriberCached
from flexbe_core.proxy.proxy_action_client import ProxyActionClient as Same
from flexbe_core.core.ros_state import RosState
from flexbe_core.proxy.qos import QOS_LATCH, QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from flexbe_states.wait_state import WaitState
import flexbt_flexbe
from flexbe_states.user_data_state import UserdataState
assert (EventState, Same, SameLogger) == (flexbt_flexbe.EventState, flexbt_flexbe.ProxyActionClient, Logger)
assert SameError is UserDataError
print('used')
"""
REAL = "WHO = 'real'\n"


def python(code: str, *path: Path) -> subprocess.CompletedProcess[str]:
    """Run code with directories in front of the path."""
    lines = [f'import sys; sys.path[:0] = {[str(one) for one in path]!r}', code]
    return subprocess.run([sys.executable, '-c', '\n'.join(lines)], capture_output=True, text=True, timeout=60)


def test_flexbes_modules_are_not_there_unless_somebody_asks_for_them() -> None:
    assert "No module named 'flexbe_core'" in python('import flexbt_flexbe.shim\nimport flexbe_core').stderr


def test_code_that_imports_flexbe_gets_ours_under_all_names() -> None:
    done = python(f'from flexbt_flexbe import shim\nshim.install()\nshim.install()\n{USE}')
    assert done.stdout == 'used\n', done.stderr


def test_the_directory_can_be_put_on_the_path_of_a_process() -> None:
    directory = subprocess.run(
        [sys.executable, '-m', 'flexbt_flexbe.shim'], capture_output=True, text=True, timeout=60
    ).stdout.strip()
    done = python(USE, Path(directory))
    assert done.stdout == 'used\n', done.stderr


@pytest.fixture
def flexbe(tmp_path: Path) -> Path:
    """Return a directory with another flexbe_core."""
    (tmp_path / 'flexbe_core').mkdir()
    (tmp_path / 'flexbe_core' / '__init__.py').write_text(REAL)
    return tmp_path


def test_an_installed_flexbe_is_never_shadowed_by_accident(flexbe: Path) -> None:
    done = python('from flexbt_flexbe import shim\nshim.install()', flexbe)
    assert f'flexbe_core is installed in {flexbe}' in done.stderr
    assert 'PYTHONPATH' in done.stderr
    done = python(
        'from flexbt_flexbe import shim\n'
        'try: shim.install()\nexcept ImportError: import flexbe_core; print(flexbe_core.WHO)',
        flexbe,
    )
    assert done.stdout == 'real\n'


def test_it_can_be_replaced_on_purpose_but_not_after_it_was_imported(flexbe: Path) -> None:
    done = python(f'from flexbt_flexbe import shim\nshim.install(replace=True)\n{USE}', flexbe)
    assert done.stdout == 'used\n', done.stderr
    done = python('import flexbe_core\nfrom flexbt_flexbe import shim\nshim.install(replace=True)', flexbe)
    assert 'imported already' in done.stderr


def test_the_packages_are_those_that_the_shim_speaks_of() -> None:
    packages = {file.parent.name for file in shim.DIRECTORY.glob('*/__init__.py')}
    assert packages == {*shim.PACKAGES, 'flex_bt_flexbe_states'}


def test_where_nothing_is_tested_its_test_cases_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(shim.DIRECTORY)
    for module in ('flexbe_testing', 'flexbe_testing.py_tester'):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, 'flexbt_testing.flexbe', None)
    with pytest.raises(ShimError, match='install flexbt_testing where tests are run'):
        importlib.import_module('flexbe_testing.py_tester')
