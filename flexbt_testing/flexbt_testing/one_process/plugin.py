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

from . import product
from .scheduler import BOOT, SCHEDULER, SECOND

product.install()
from . import launching  # noqa: E402 - in the world

launching.install()
importlib.reload(lock_order)  # it watches the locks of the world

_PROCESSOR_SECONDS: Final = float(os.environ.get('FLEXBT_ONE_PROCESS_SECONDS', '60'))
"""Processor time without a switch of tasks after which a test is ended, with its stack, s."""

_SIMULATED_SECONDS: Final = 3600.0
"""Simulated time after which a test counts as stuck, s, unless its mark ``world`` has another limit."""


_WORLD: Final = pytest.StashKey[Any]()
_TOLD: Final = pytest.StashKey[list[tuple[str, str]]]()
"""Titles and texts of what is told at the end."""


class TooLongError(Exception):
    """A test has computed for too long without letting the clock go on."""


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Leave out a plugin that would wait for a socket in a thread of the world."""
    early_config.pluginmanager.unregister(name='rerunfailures')


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of coverage."""
    about = 'tell which transitions, outcomes and tree nodes the tests of the fixture `world` have taken'
    group = parser.getgroup('flexbt')
    group.addoption('--mission-coverage', action='store_true', help=about)
    about = (
        'run each test of the fixture `world` a second time from SECONDS of its world on, with a change that is a '
        'method of the world, such as "12.5 choose /Drive canceled", and tell the first difference'
    )
    group.addoption(
        '--live',
        metavar='"SECONDS ARGUMENTS"',
        help='run a test of the fixture `world` until this time of its world; then in real time, with a console, to '
        'which the arguments are given, such as "12.5 prompt" or "12.5 web"',
    )
    group.addoption('--what-if', metavar='"SECONDS METHOD ARGUMENTS"', help=about)


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marks."""
    if getattr(config.option, 'numprocesses', None):
        raise pytest.UsageError('tests in a world do not run with -n, which needs real threads; start several pytest')
    seed = os.environ.get('FLEXBT_SEED')
    if seed and not seed.lstrip('-').isdecimal():
        raise pytest.UsageError(f'FLEXBT_SEED={seed}: expected a whole number')
    for mark in (
        "world(name='', motion='full', limit=3600, **options): what the fixture `world` has: a demonstration, a world "
        'file or a function of programs; `motion` is full or abstract, `limit` the simulated time at most, s',
        'seeds(count): repeat a test of the fixture `world` with this many seeds',
    ):
        config.addinivalue_line('markers', mark)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests that have to run on the real middleware."""
    real = [item for item in items if item.get_closest_marker('dds')]
    config.hook.pytest_deselected(items=real)
    items[:] = [item for item in items if item not in real]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat tests of the fixture ``world``."""
    found = metafunc._arg2fixturedefs.get('world')
    if found and found[-1].func.__module__ == __name__:  # and not a fixture of that name of the test's own
        mark = metafunc.definition.get_closest_marker('seeds')
        given = os.environ.get('FLEXBT_SEED')
        seeds = [int(given)] if given else range(_count_seeds(*mark.args, **mark.kwargs) if mark else 1)
        metafunc.parametrize('world', seeds, indirect=True)


def _count_seeds(count: Any = None) -> int:
    if not isinstance(count, int) or count < 1:
        pytest.fail(f'the mark seeds({"" if count is None else repr(count)}) needs a number of seeds from 1', False)
    return count


def _read_mark(
    name: str = '', motion: str = 'full', limit: float = _SIMULATED_SECONDS, **options: Any
) -> tuple[str, float, dict[str, Any]]:
    return name, limit, {'motion': motion, **options}


@pytest.fixture
def world(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a :class:`flexbt_testing.one_process.world.World` with a robot that is ready; see the mark ``world``."""
    from .programs import named_programs
    from .world import World

    mark = request.node.get_closest_marker('world')
    scratch = tmp_path_factory.mktemp('world')
    name, limit, options = _read_mark(*mark.args, **mark.kwargs) if mark else _read_mark()
    programs = named_programs(name, request.path.parent, scratch, **options)
    made = World(getattr(request, 'param', 0), programs, writable=[tmp_path_factory.getbasetemp()])
    SCHEDULER.limit = SCHEDULER.after(limit)
    request.node.stash[_WORLD] = made
    with made:
        yield made


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Limit the simulated and the processor time of a test, which Ctrl-C ends, whatever task runs."""
    switches = -1

    def end(*_: object) -> None:
        nonlocal switches
        if switches != SCHEDULER.switches:
            switches = SCHEDULER.switches
            return
        faulthandler.dump_traceback(all_threads=False)
        error = TooLongError(
            f'{SCHEDULER.current} computes for {_PROCESSOR_SECONDS:g} s at {(SCHEDULER.now - BOOT) / SECOND:.3f} s'
        )
        if SCHEDULER.current is not SCHEDULER.main:
            SCHEDULER.throw(error)
        raise error

    def interrupt(*_: object) -> None:
        if SCHEDULER.current is SCHEDULER.main or SCHEDULER.main.error is not None:
            raise KeyboardInterrupt
        SCHEDULER.throw(KeyboardInterrupt())

    before = signal.signal(signal.SIGPROF, end)
    before_interrupt = signal.signal(signal.SIGINT, interrupt)
    signal.setitimer(signal.ITIMER_PROF, _PROCESSOR_SECONDS, _PROCESSOR_SECONDS)
    SCHEDULER.limit = SCHEDULER.after(_SIMULATED_SECONDS)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
        signal.signal(signal.SIGINT, before_interrupt)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, Any, Any]:
    """Run what follows a change in a child, too, and compare."""
    from .forks import Fork, Leaf
    from .what_if import compare, read_change

    made, change = pyfuncitem.stash.get(_WORLD, None), pyfuncitem.config.getoption('--what-if')
    live = pyfuncitem.config.getoption('--live')
    if made is not None and live is not None:
        return (yield from _live(pyfuncitem, made, live))
    if made is None or change is None:
        return (yield)
    try:
        time, act = read_change(change, made)
    except ValueError as error:
        pytest.exit(f'--what-if {error}', returncode=pytest.ExitCode.USAGE_ERROR)
    branch = made.branch_at(time, lambda _world: act())
    failed: BaseException | None = None
    try:
        return (yield)
    except BaseException as error:
        failed = error
        raise
    finally:
        branch.alarm.cancel()
        course = made.course_since(branch.first, failed)
        if isinstance(branch.side, Leaf):
            branch.side.end(lambda: (course, branch.is_over))
        told = f'the test has ended at {made.now:.2f} s, before {time:g} s'
        if isinstance(branch.side, Fork):
            changed, is_over = branch.side.result()
            unmade = f'the test has ended at {changed.end:.2f} s, and the change was not made: it still waits'
            found = compare(course, changed)
            told = str(found) if is_over or found.difference else unmade  # its effect may have ended the test
        _tell(pyfuncitem, f'what if {change}', told)


def _tell(item: pytest.Item, title: str, told: str) -> None:
    item.config.stash.setdefault(_TOLD, []).append((title, f'{item.name}: {told}'))


def _live(item: pytest.Function, made: Any, text: str) -> Generator[None, Any, Any]:
    from .live import TakenOver, take_over, take_over_at

    try:
        alarm, words = take_over_at(text)
    except ValueError as error:
        pytest.exit(f'--live {text!r}: {error}', returncode=pytest.ExitCode.USAGE_ERROR)
    try:
        result = yield
        _tell(item, f'live {text}', f'the test has ended at {made.now:.2f} s already')
        return result
    except TakenOver:
        capture: Any = item.config.pluginmanager.getplugin('capturemanager')
        capture.suspend_global_capture(in_=True)
        try:
            take_over(made, words)
        finally:
            capture.resume_global_capture()
        return True
    finally:
        alarm.cancel()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Tell what the robots of a failed test did, and how to repeat it."""
    report = yield
    made = item.stash.get(_WORLD, None)
    if report.failed and made is not None:
        given = item.config.invocation_params
        plugins = [f'-p {word}' for word in given.args if str(word).startswith('flexbt_testing.')]
        environment = [
            f'{name}={os.environ[name]}' for name in ('PYTEST_PLUGINS', 'FLEXBT_ACCELERATION') if name in os.environ
        ]
        test = os.path.relpath(item.path, given.dir) + '::' + item.nodeid.partition('::')[2]
        again = ' '.join([*environment, f'FLEXBT_SEED={made.seed}', 'python3 -m pytest', *plugins, f"'{test}'"])
        report.sections.append(('world', f'{made.report()}\nagain: {again}'))
    return report


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print comparisons, and the coverage of missions."""
    for title, told in config.stash.get(_TOLD, []):
        terminalreporter.section(title)
        terminalreporter.write_line(told)
    if config.getoption('--mission-coverage'):
        from .coverage import COVERAGE

        terminalreporter.section('mission coverage')
        for line in COVERAGE.lines():
            terminalreporter.write_line(line)
