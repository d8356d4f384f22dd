# SPDX-License-Identifier: BSD-3-Clause
"""Pause, resume and single-step a tree that its host ticks.

A paused tree is not ticked, and its leaves pause the work that they started if they can (:meth:`LeafNode.on_pause`).
The clock continues, as in FlexBE and in py_trees: a Timeout limits events in the world, which does not stop. The next
tick handles everything that became due meanwhile.

A host may also hold a tree. This is a second pause, independent of the one by command: the tree continues when neither
is in effect. A breakpoint holds a tree within a tick (:meth:`TickControl.held_in_tick`).
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Final

from flexbt_core.behavior_tree.model.status import NodeStatus

from .tree import Tree

TickCommandReply = Callable[[str], None]
"""A callback, called once: with '' if the command took effect, else with the reason why it did not. It runs on the
thread of the host or of the caller."""


class TickCommand(Enum):
    """A command to a tree. PAUSE of a paused tree, and RESUME of an unpaused one, succeed without any effect."""

    PAUSE = 'pause'
    RESUME = 'resume'
    STEP = 'step'


def _ignore(_refusal: str) -> None:
    """Ignore the answer to a command: it was given before."""


MOST_WAITING: Final = 1000
"""Maximum number of commands that wait for the current tick; further ones are rejected."""


class TickControl:
    """A layer between a tree and its host: it accepts commands from any thread, and runs them in order between ticks.

    The host ticks by :meth:`tick`; it need not wait for the clock while :attr:`paused`, and must not sleep while
    :attr:`pending`. ``on_command()`` is called, from any thread, when the host should call :meth:`tick` soon, and
    ``on_change(paused)`` on the thread of the host, also when only the :attr:`reason` has changed. :meth:`close` ends
    the control.
    """

    def __init__(self, on_command: Callable[[], None], on_change: Callable[[bool], None]) -> None:
        self._on_command = on_command
        self._on_change = on_change
        self._commands: deque[tuple[TickCommand, TickCommandReply]] = deque()
        self._lock = threading.Lock()
        self._asked_to_pause = False
        self._hold = ''
        self._why = ''  # the reason for which it is paused now
        self._is_held_in_tick = False
        self._step: TickCommandReply = _ignore
        self._closed: str | None = None
        self.not_paused: tuple[str, ...] = ()
        """Leaves whose work continues while the tree is paused, as 'path: why'."""

    @property
    def paused(self) -> bool:
        return bool(self._why)

    @property
    def is_paused_by_command(self) -> bool:
        """True if a command has paused the tree, whether or not the host holds it as well."""
        return self._asked_to_pause

    @property
    def reason(self) -> str:
        """Why the tree is to be paused: 'paused' for a command, the reason of the host to hold it, or both; else ''."""
        if not self._asked_to_pause:
            return self._hold
        return f'{self._hold}; also a pause' if self._hold else 'paused'

    @property
    def pending(self) -> bool:
        """True if there are commands that :meth:`tick` would run."""
        return bool(self._commands) or self.reason != self._why

    def command(self, command: TickCommand, answer: TickCommandReply) -> None:
        """Queue a command. PAUSE is answered once the current tick has ended, STEP when its tick has ended; PAUSE and
        RESUME at once while the tree is held within that tick."""
        with self._lock:
            refusal = self._closed
            if refusal is None and len(self._commands) >= MOST_WAITING:
                refusal = f'{MOST_WAITING} commands wait for the end of the tick that is under way'
            is_answered = refusal is None and self._is_held_in_tick and command is not TickCommand.STEP
            if refusal is None:
                self._commands.append((command, _ignore if is_answered else answer))
        if refusal is None:
            self._on_command()
        if refusal is not None or is_answered:
            answer(refusal or '')

    def hold(self, reason: str) -> None:
        """Hold the tree for this ``reason`` of the host; '' releases it. From any thread."""
        self._hold = reason
        self._on_command()

    def close(self, reason: str) -> None:
        """Reject all pending and future commands with this reason, because the run has ended."""
        with self._lock:
            if self._closed is not None:
                return
            self._closed = reason
            commands = tuple(self._commands)
            self._commands.clear()
        for _, answer in commands:
            answer(reason)

    def tick(self, tree: Tree) -> NodeStatus | None:
        """Run the commands up to the first STEP, then tick the tree unless it is paused: by ``tick_once``, or for a
        STEP by ``tick_exactly_once``. Return None if it was not ticked. Propagates the exceptions of the tick.
        """
        step = self._obey(tree)
        if step is None:
            return None if self.paused else tree.tick_once()
        self._step = step
        try:
            status = tree.tick_exactly_once()
        except BaseException as error:
            self._take_step()(f'the tick raised: {error}')
            raise
        # Pause the work that the step has started.
        self.not_paused = tree.pause() if status is NodeStatus.RUNNING else ()
        self._take_step()('')
        return status

    @contextmanager
    def held_in_tick(self, tree: Tree) -> Iterator[None]:
        """Return a context in which the tree is held within a tick, on its thread. Commands that wait for the end of
        the tick are answered: they have their effect after it. Raises NodeExecutionError if a leaf does not resume."""
        was_paused = self.paused
        with self._lock:
            self._is_held_in_tick = True
            waiting = [answer for command, answer in self._commands if command is not TickCommand.STEP]
            self._commands = deque(
                (command, answer if command is TickCommand.STEP else _ignore) for command, answer in self._commands
            )
        self.not_paused = tree.pause()
        if not was_paused:
            self._on_change(True)
        for answer in (*waiting, self._take_step()):
            answer('')
        try:
            yield
        finally:
            with self._lock:
                self._is_held_in_tick = False
            if not was_paused:
                self._on_change(False)
        if not was_paused:
            self.not_paused = ()
            tree.resume()

    def _take_step(self) -> TickCommandReply:
        """Return the reply of the step that is under way; it is called once."""
        step, self._step = self._step, _ignore
        return step

    def _obey(self, tree: Tree) -> TickCommandReply | None:
        """Run commands up to the first valid STEP and return its reply callback; None if the queue has none."""
        while True:
            with self._lock:
                command, answer = self._commands.popleft() if self._commands else (None, None)
            if command is TickCommand.PAUSE or command is TickCommand.RESUME:
                self._asked_to_pause = command is TickCommand.PAUSE
            try:
                self._settle(tree)
            except BaseException as error:
                if answer is not None:
                    answer(f'a leaf raised: {error}')
                raise
            if answer is None:
                return None
            if command is not TickCommand.STEP:
                answer('')
            elif self._hold:
                answer(f'the tree is held: {self._hold}')
            elif self.paused:
                return answer
            else:
                answer('the tree is not paused; pause it before you step it')

    def _settle(self, tree: Tree) -> None:
        why, before = self.reason, self._why
        if why == before:
            return
        self._why = why
        if not (why and before):
            self.not_paused = tree.pause() if why else ()
        self._on_change(self.paused)
        if not why:
            tree.resume()
