# SPDX-License-Identifier: BSD-3-Clause
"""The same tests of rclpy on DDS and on the substitute of `one_process`, which has to do the same.

Plain pytest runs them on DDS; ``-p flexbt_testing.world`` on the substitute. ``make test`` does both. A condition is
awaited for :data:`SECONDS`, which a busy computer may need; what must not arrive is followed by something that must.
"""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from flexbt_common import discovery

SECONDS = 60.0


class Ros:
    """Nodes of a test, in contexts of their own unless said otherwise, which spin in a thread."""

    _numbers = itertools.count(1)

    def __init__(self) -> None:
        self._contexts: list[Context] = []
        self._nodes: list[Any] = []
        self._executors: list[SingleThreadedExecutor] = []
        self._threads: list[threading.Thread] = []
        self.topic = f'topic_{next(self._numbers)}'
        """A name that no other test has."""

    def context(self, args: list[str] | None = None) -> Context:
        """Return a new context."""
        context = Context()
        context.init(args or [])
        self._contexts.append(context)
        return context

    def node(self, name: str, *, context: Context | None = None, spins: bool = True, **options: Any) -> Any:
        """Return a new node."""
        make = options.pop('kind', Node)
        node = make(name, context=context or self.context(), **options)
        self._nodes.append(node)
        if spins:
            self.spin(node)
        return node

    def spin(self, node: Any) -> None:
        """Let a node run its callbacks in a thread."""
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        self._executors.append(executor)
        thread = threading.Thread(target=executor.spin, name=f'spin {node.get_name()}', daemon=True)
        thread.start()
        self._threads.append(thread)

    def wait(self, condition: Callable[[], Any], what: str = 'the condition') -> Any:
        """Wait until a condition holds, and return its value."""
        until = time.monotonic() + SECONDS
        while not (found := condition()):
            assert time.monotonic() < until, f'{what}: not within {SECONDS:g} s'
            time.sleep(0.005)
        return found

    def result(self, future: Any) -> Any:
        """Wait for a future of a node that spins."""
        self.wait(future.done, 'the future')
        return future.result()

    def close(self) -> None:
        """Shut everything down."""
        for executor in self._executors:
            executor.shutdown()
        for thread in self._threads:
            thread.join(SECONDS)
        for node in self._nodes:  # before their context, whose end may hang otherwise
            for waitable in list(node.waitables):  # actions, which destroy_node() leaves
                waitable.destroy()
            node.destroy_node()
        for context in self._contexts:
            context.try_shutdown()


@pytest.fixture(scope='session', autouse=True)
def datagrams_only(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let the contexts of this process hear each other as if they were processes.

    Two participants of Fast DDS can wait for each other for ever when one ends while the other, in the same process,
    announces a node (https://github.com/eProsima/Fast-DDS/issues/6193).
    """
    before = Path(os.environ[discovery.PROFILE])
    text = before.read_text(encoding='utf-8')
    off = '<library_settings><intraprocess_delivery>OFF</intraprocess_delivery></library_settings>'
    profile = tmp_path_factory.mktemp('profile') / before.name
    profile.write_text(text.replace('<profiles>', f'{off}<profiles>', 1), encoding='utf-8')
    os.environ[discovery.PROFILE] = str(profile)


@pytest.fixture
def ros() -> Iterator[Ros]:
    """Yield the nodes of a test."""
    made = Ros()
    yield made
    made.close()
