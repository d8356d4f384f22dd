# SPDX-License-Identifier: BSD-3-Clause
"""A pytest plugin: tests run in one process, on a simulated clock (``-p flexbt_testing.one_process.plugin``).

Nodes that a test makes are of a world that lasts for the whole run. The fixture ``world`` makes one of its own, with
the processes of a robot; the mark ``seeds(N)`` repeats a test with N seeds. A failing one tells its seed.
"""

from __future__ import annotations

import faulthandler
import importlib
import os
import signal
from collections.abc import Generator, Iterator
from typing import Any, Final

import pytest

from flexbt_testing import lock_order

from .product import install
from .scheduler import BOOT, SCHEDULER, SECOND

install()
importlib.reload(lock_order)  # it watches the locks of the world

_REAL_SECONDS: Final = float(os.environ.get('FLEXBT_ONE_PROCESS_SECONDS', '60'))
"""Real time after which a test that never blocks is ended, with its stack, s."""

_SIMULATED_SECONDS: Final = 3600.0
"""Simulated time after which a test counts as stuck, s."""


class TooLongError(Exception):
    """A test has computed for too long without letting the clock go on."""


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marks."""
    config.addinivalue_line('markers', 'seeds(count): repeat a test of the fixture `world` with this many seeds')
    config.addinivalue_line('markers', 'dds(reason): the test needs the real middleware, processes or time')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests that have to run on the real middleware."""
    for item in items:
        mark = item.get_closest_marker('dds')
        if mark is not None:
            item.add_marker(pytest.mark.skip(f'on DDS only: {mark.args[0]}'))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat tests of the fixture ``world``."""
    if 'world' in metafunc.fixturenames:
        mark = metafunc.definition.get_closest_marker('seeds')
        given = os.environ.get('FLEXBT_SEED')
        seeds = [int(given)] if given else range(mark.args[0] if mark else 1)
        metafunc.parametrize('world', seeds, indirect=True)


@pytest.fixture
def world(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Yield a :class:`flexbt_testing.one_process.world.World` with a robot that is ready."""
    from .world import World

    with World(request.param) as made:
        yield made


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Limit the simulated and the real time of a test."""

    def end(*_: object) -> None:
        faulthandler.dump_traceback(all_threads=False)
        raise TooLongError(
            f'{SCHEDULER.current} computes for {_REAL_SECONDS:g} s at {(SCHEDULER.now - BOOT) / SECOND:.3f} s'
        )

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, _REAL_SECONDS)
    SCHEDULER.limit = SCHEDULER.after(_SIMULATED_SECONDS)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Tell the seed of a failed test of a world."""
    report = yield
    made = getattr(item, 'funcargs', {}).get('world')
    if report.failed and made is not None:
        report.sections.append(('world', f'again with FLEXBT_SEED={made.seed}; states: {made.states}'))
    return report
