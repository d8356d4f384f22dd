# SPDX-License-Identifier: BSD-3-Clause
"""A pytest plugin: a separate ROS domain for each test run, strict message fields, and checks of lock order.

A test fails if it acquires locks in orders that may deadlock (:mod:`flexbt_testing.lock_order`).

The workspace's pyproject.toml loads the plugin (``-p flexbt_testing.pytest_plugin``). Test runs can then run in
parallel, and next to a robot, without interfering.
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

from flexbt_common.executables import skip_message_generator

from . import lock_order

_OUTER_DIRECTORY: Final = pytest.StashKey[str]()


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Set up field checks and the lock watch before anything is imported.

    With field checks, setting a message field to a value of the wrong type is an error, not a later crash. They must be
    set before any message is imported, and locks must be watched before any is created.

    Garbage collection is off until the tests run, because what they import stays. A collection in an import can leave
    the module locked for ever before Python 3.12 (CPython's issue 91351), and the first message of a test would import
    much.
    """
    os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
    skip_message_generator()
    lock_order.watch_locks()
    gc.disable()
    _set_examples()


def _set_examples() -> None:
    """Set how hypothesis draws examples, unless a conftest or the option ``--hypothesis-profile`` sets it later.

    By default the examples are the same in each run, and few, so that a failing test was broken by a change. With
    FLEXBT_FUZZ (`make fuzz`) they are new, and more. One example may take long on a busy machine; tests of speed check
    the time themselves.
    """
    from hypothesis import settings

    is_fuzzing = 'FLEXBT_FUZZ' in os.environ
    settings.register_profile(
        'flexbt', deadline=None, derandomize=not is_fuzzing, max_examples=200 if is_fuzzing else 50
    )
    settings.load_profile('flexbt')


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marks of the middleware."""
    for mark in (
        'dds(reason): needs the real middleware, processes or streams, so it never runs in one process',
        'one_process: runs in one process, though other tests of its package need the middleware or processes',
    ):
        config.addinivalue_line('markers', mark)


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Exclude the imported objects from garbage collection, which stay until the end, and collect less often: many
    tests make large objects that soon end without it.

    The end of the test collection would be too late: the process that distributes the tests to others does not collect
    tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Fail a test with lock problems, after everything it has made is closed."""
    yield
    problems = list(lock_order.take_problems())
    if problems:
        pytest.fail('\n\n'.join(problems), pytrace=False)


def entities_of(node: Any) -> Counter[type]:
    """Return the number of entities on a node, by kind. Call it on the node's executor thread."""
    kinds = (node.publishers, node.subscriptions, node.clients, node.services, node.timers, node.guards)
    return Counter(type(entity) for kind in (*kinds, node.waitables) for entity in kind)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Create the directory in which processes report lock problems."""
    session.stash[_OUTER_DIRECTORY] = os.environ.get(lock_order.DIRECTORY, '')
    os.environ[lock_order.DIRECTORY] = tempfile.mkdtemp(prefix='flexbt_locks_')


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Remove the directory. Restore that of an outer session, if there was one."""
    shutil.rmtree(os.environ.pop(lock_order.DIRECTORY), ignore_errors=True)
    if session.stash[_OUTER_DIRECTORY]:
        os.environ[lock_order.DIRECTORY] = session.stash[_OUTER_DIRECTORY]


@pytest.fixture(scope='session', autouse=True)
def ros_domain() -> Iterator[int]:
    """Yield the ROS domain of this run, set in the environment of this process and its children."""
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
