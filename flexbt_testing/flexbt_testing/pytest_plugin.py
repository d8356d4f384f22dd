# SPDX-License-Identifier: BSD-3-Clause
"""A pytest plugin: every test run has its own ROS domain, messages that check their fields, and the time it needs; a
test in which locks are taken in orders that may meet fails (:mod:`flexbt_testing.lock_order`).

The workspace's pyproject.toml loads it (``-p flexbt_testing.pytest_plugin``). Test runs can then go on at the same
time, and beside a robot, without meeting.
"""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

import pytest

from . import lock_order

_OUTER_DIRECTORY: Final = pytest.StashKey[str]()


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Before any message is imported: setting a field to a value of a wrong type is an error, not a crash later. Before
    any lock is made: they are watched.

    No garbage is collected until the tests run: what they import stays.
    """
    os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
    lock_order.watch_locks()
    gc.disable()


def pytest_configure() -> None:
    """How examples of hypothesis are drawn.

    They are the same in each run, so that a test that fails was broken by a change, and few; with FLEXBT_FUZZ
    (`make fuzz`) they are new ones, and more. One may take long on a busy machine; what has to be fast says so by
    itself.
    """
    from hypothesis import settings

    is_fuzzing = 'FLEXBT_FUZZ' in os.environ
    settings.register_profile(
        'flexbt', deadline=None, derandomize=not is_fuzzing, max_examples=200 if is_fuzzing else 50
    )
    settings.load_profile('flexbt')


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Spare the garbage collector what has been imported: it stays to the end.

    The end of a collection of tests would be too late: the process that distributes them to others collects none.
    """
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Fail a test in which the order of locks has turned out to be wrong, when all that it has made is closed."""
    yield
    problems = list(lock_order.take_problems())
    if problems:
        pytest.fail('\n\n'.join(problems), pytrace=False)


def entities_of(node: Any) -> Counter[type]:
    """Return what there is on a node, by kind; to be called on its executor thread."""
    kinds = (node.publishers, node.subscriptions, node.clients, node.services, node.timers, node.guards)
    return Counter(type(entity) for kind in (*kinds, node.waitables) for entity in kind)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Make a directory for what processes find out about their locks."""
    session.stash[_OUTER_DIRECTORY] = os.environ.get(lock_order.DIRECTORY, '')
    os.environ[lock_order.DIRECTORY] = tempfile.mkdtemp(prefix='flexbt_locks_')


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Nobody looks there any more; a session within another one leaves that its own."""
    shutil.rmtree(os.environ.pop(lock_order.DIRECTORY), ignore_errors=True)
    if session.stash[_OUTER_DIRECTORY]:
        os.environ[lock_order.DIRECTORY] = session.stash[_OUTER_DIRECTORY]


@pytest.fixture(scope='session', autouse=True)
def ros_domain() -> Iterator[int]:
    """Yield the ROS domain of this run, in the environment of this process and of those that it starts."""
    from domain_coordinator import domain_id

    from flexbt_common import discovery

    settings = ('ROS_DOMAIN_ID', discovery.RANGE, discovery.PROFILE)
    before = {name: os.environ.get(name) for name in settings}
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        discovery.only_this_computer()
        yield domain
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
