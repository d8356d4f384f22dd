# SPDX-License-Identifier: BSD-3-Clause
"""The check of the order of locks, on programs that would hang some day."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexbt_testing import lock_order

_PROGRAM = """
import threading, time
from flexbt_testing.lock_order import watch_locks
watch_locks()
__name__ = 'flexbt_example'
first = threading.Lock()
second = threading.Lock()
changed = threading.Condition()
"""

_LOG_THAT_ASKS_THE_CLOCK = """
def log(text):
    with first:
        now()

def now():
    log('a bad time')
log('begin')
"""

_BOTH_ORDERS = """
with first:
    with second:
        pass

def other():
    with second, first:
        pass
thread = threading.Thread(target=other)
thread.start()
thread.join()
"""

_OVER_A_THIRD = """
with first, second:
    pass
with second, changed:
    pass
with changed:
    first.acquire()
"""

_WAITS = """
done = threading.Event()
def end_wait():
    while not done._cond._waiters:
        time.sleep(0.001)
    done.set()
threading.Thread(target=end_wait).start()
with first:
    done.wait()
"""

_FINE = """
again = threading.RLock()
with first, second, again, again, changed:
    threading.Thread(target=print).start()
    changed.wait(0.01)
with second:
    first.acquire(timeout=0.01)  # gives up
    first.release()
with first:
    assert second.acquire(blocking=False)
second.release()
with changed:
    threading.Timer(0.01, lambda: [changed.acquire(), changed.notify(), changed.release()]).start()
    changed.wait()
"""


@pytest.mark.parametrize(
    ('program', 'told'),
    [
        (_LOG_THAT_ASKS_THE_CLOCK, ['is taken by a thread that holds it', 'in now', 'in log']),
        (_BOTH_ORDERS, ['in both orders', 'with second:', 'with second, first:']),
        (_OVER_A_THIRD, ['in both orders', 'first.acquire()', 'with first, second:', 'with second, changed:']),
        (_WAITS, ['a thread waits, with no limit', 'done.wait()']),
        (_FINE, []),
    ],
    ids=['a log that asks the clock', 'both orders', 'over a third lock', 'a wait', 'nothing'],
)
def test_what_hangs_some_day_is_reported_with_the_stacks(tmp_path: Path, program: str, told: list[str]) -> None:
    directory = tmp_path / 'problems'
    directory.mkdir()
    file = tmp_path / 'program.py'
    file.write_text(_PROGRAM + program)
    environment = os.environ | {lock_order.DIRECTORY: str(directory)}
    subprocess.run([sys.executable, file], env=environment, timeout=60.0, check=False)
    found = [one.read_text() for one in directory.iterdir()]
    assert len(found) == bool(told)
    for text in told:
        assert text in found[0]


def test_a_test_fails_that_takes_locks_in_both_orders(tmp_path: Path) -> None:
    (tmp_path / 'test_flexbt_example.py').write_text(
        'import threading\n__name__ = "flexbt_example"\n'
        'first = threading.Lock()\nsecond = threading.Lock()\n'
        'def test_one(): first.acquire(), second.acquire(), first.release(), second.release()\n'
        'def test_two(): second.acquire(), first.acquire(), first.release(), second.release()\n'
        'def test_three():\n'
        '    import pytest\n'
        '    assert pytest.main(["-p", "flexbt_testing.pytest_plugin", "--collect-only", __file__]) == 0\n'
    )
    plugins = ['-p', 'flexbt_testing.pytest_plugin', '-p', 'no:cacheprovider']
    words = [sys.executable, '-m', 'pytest', *plugins, str(tmp_path)]
    environment = {name: value for name, value in os.environ.items() if name != 'CI'}  # there pytest says it twice
    done = subprocess.run(
        words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120.0, check=False
    )
    assert '3 passed, 1 error' in done.stdout, done.stdout
    assert 'ERROR at teardown of test_two' in done.stdout
    assert done.stdout.count('is taken while') == 2


@pytest.mark.parametrize(('words', 'examples'), [([], 7), (['--hypothesis-profile=few'], 3)])
def test_the_plugin_leaves_the_number_of_examples_to_a_package(tmp_path: Path, words: list[str], examples: int) -> None:
    (tmp_path / 'conftest.py').write_text(
        'from hypothesis import settings\n'
        "settings.register_profile('own', max_examples=7)\n"
        "settings.register_profile('few', max_examples=3)\n"
        "settings.load_profile('own')\n"
    )
    (tmp_path / 'test_it.py').write_text(
        f'from hypothesis import settings\ndef test_it():\n    assert settings().max_examples == {examples}\n'
    )
    plugins = ['-p', 'flexbt_testing.pytest_plugin', '-p', 'no:cacheprovider']
    ran = subprocess.run(
        [sys.executable, '-m', 'pytest', *plugins, *words, 'test_it.py'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
