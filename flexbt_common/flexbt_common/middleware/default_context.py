# SPDX-License-Identifier: BSD-3-Clause
"""rclpy's default context, for users' code: ``rclpy.ok()``, ``rclpy.create_node()``, ``rclpy.spin_once()``.

Our nodes have their own contexts. States and leaves of users are often written for a process that has called
``rclpy.init()``, so each process that runs them has an initialized default context as well. As it is not that of our
nodes, ``rclpy.shutdown()`` in a state does not end the node that runs the state.
"""

from __future__ import annotations

import gc
import os
import re
import sys
import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions, uninstall_signal_handlers

from flexbt_common.discovery import RANGE
from flexbt_core.values.text import one_line

from .fastdds import end_callbacks
from .implementation import CYCLONE_DDS, implementation

_RENAMING: Final = re.compile(r'__(node|name):=')
_REMAP: Final = ('-r', '--remap')
_opening: Final = threading.Lock()


class DefaultContext:
    """The default context of the process, as long as it is needed. Thread-safe."""

    def __init__(self, args: Sequence[str] | None = (), node: Node | None = None) -> None:
        """``args`` are the arguments of the process, None for ``sys.argv``. They also apply to users' nodes, except a
        new name of the node. ``node`` determines the domain and the kind of time of users' nodes.
        """
        self._args = sys.argv[1:] if args is None else args
        self._node = node
        self._opened: Context | None = None

    def open(self) -> None:
        """Initialize the context if needed.

        If users' code has shut it down and initialized it again, remove rclpy's signal handlers: they would also shut
        down the contexts of our nodes before an orderly end.
        """
        with _opening:
            if rclpy.ok():
                if self._opened not in (None, rclpy.get_default_context()):
                    uninstall_signal_handlers()
                    self._opened = rclpy.get_default_context()
                return
            node = self._node
            is_simulated = node is not None and node.get_parameter('use_sim_time').value
            rclpy.init(
                args=[*_without_name(self._args), *(_SIMULATED_TIME if is_simulated else ())],
                domain_id=None if node is None else node.context.get_domain_id(),
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._opened = rclpy.get_default_context()

    def shut_down(self) -> None:
        """End loops over ``rclpy.ok()`` and threads that spin. No effect if other code opened the context."""
        context = self._opened
        if context is None or context is not rclpy.get_default_context():
            return
        if hasattr(context, 'untrack_node'):  # or it would destroy its nodes now, under the threads that spin (rclpy 9)
            for node in _nodes_in(context):
                context.untrack_node(node)
        rclpy.try_shutdown()

    def close(self) -> None:
        """Shut the context down and destroy its remaining nodes."""
        self.shut_down()
        if self._opened is None:
            return
        remains = weakref.ref(self._opened)
        self._opened = None
        if (context := remains()) is not None:  # as each of its nodes refers to it
            for node in _nodes_in(context):
                try:
                    end_callbacks(node)
                    node.destroy_node()
                except InvalidHandle:  # already destroyed
                    continue
                except Exception as error:  # code of users; a node that was made in part has no logger
                    print(one_line(f'{type(node).__name__} was not destroyed: {error!r}'), file=sys.stderr)


@contextmanager
def offline_default_context() -> Iterator[None]:
    """Provide a default context during the block; its nodes discover no others."""
    default_context = DefaultContext(('--ros-args', '--disable-external-lib-logs'))
    with undiscovered():
        default_context.open()
    try:
        yield
    finally:
        default_context.close()


@contextmanager
def undiscovered() -> Iterator[None]:
    """Prevent discovery in both directions for nodes of contexts created in the block. Cyclone DDS cannot: it refuses
    nodes of a domain whose discovery differs from that of earlier ones in the process."""
    if implementation() == CYCLONE_DDS:
        yield
        return
    before = os.environ.get(RANGE)
    os.environ[RANGE] = 'OFF'
    try:
        yield
    finally:
        if before is None:
            del os.environ[RANGE]
        else:
            os.environ[RANGE] = before


_SIMULATED_TIME: Final = ('--ros-args', '-p', 'use_sim_time:=true')


def _without_name(args: Sequence[str]) -> Iterator[str]:
    """Yield the arguments without rules that rename every node of the process, which launch files add for a single
    node."""
    words = iter(args)
    for word in words:
        if word not in _REMAP:
            yield word
            continue
        rule = next(words, None)
        if rule is None or not _RENAMING.match(rule):
            yield from filter(None, (word, rule))


def _nodes_in(context: Context) -> list[Node]:
    """Return the nodes of a context. rclpy keeps no list of them. Unreferenced nodes have been collected, and a node
    whose constructor has raised has no context."""
    return [one for one in gc.get_objects() if issubclass(type(one), Node) and getattr(one, 'context', None) is context]
