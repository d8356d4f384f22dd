# SPDX-License-Identifier: BSD-3-Clause
"""The thread that reads the terminal: what is typed becomes keys, and it sleeps while nothing is."""

from __future__ import annotations

import asyncio
import os
import queue
import selectors
import signal
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from textual import events
from textual.app import App
from textual.message import Message

from flexbt_common.command_line import restored_signals
from flexbt_console.ui.screen.textual_app import TerminalDriver
from flexbt_testing.waiting import DEADLINE, wait_until


class Reader(TerminalDriver):
    """Reads what is written to ``typed``, a pipe."""

    def __init__(self) -> None:
        asyncio.run(self._make())
        self.fileno, self.typed = os.pipe()
        self.keys: queue.Queue[str] = queue.Queue()
        self.thread = threading.Thread(target=self.run_input_thread, daemon=True)

    async def _make(self) -> None:  # Textual asks for the loop, and handles signals
        with restored_signals(signal.SIGTSTP, signal.SIGCONT):
            super().__init__(App())

    def process_message(self, message: Message) -> None:
        assert isinstance(message, events.Key)
        self.keys.put(message.key)

    def type(self, data: bytes, *keys: str) -> None:
        """Check that these keys come of it."""
        os.write(self.typed, data)
        assert [self.keys.get(timeout=DEADLINE) for _ in keys] == list(keys)


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """For how long the thread was ready to sleep, each time."""
    pauses: list[float | None] = []

    class NotingSelector(selectors.DefaultSelector):
        def select(self, timeout: float | None = None) -> Any:
            pauses.append(timeout)
            return super().select(timeout)

    monkeypatch.setattr(selectors, 'DefaultSelector', NotingSelector)
    return pauses


@pytest.fixture
def reader(pauses: list[float | None]) -> Iterator[Reader]:
    reader = Reader()
    pauses.clear()  # of asyncio
    reader.thread.start()
    yield reader
    reader.exit_event.set()
    reader.thread.join(DEADLINE)
    assert not reader.thread.is_alive()
    reader.exit_event.clear()
    for file in (reader.fileno, reader.typed):
        os.close(file)


def test_while_nothing_is_typed_the_thread_sleeps(reader: Reader, pauses: list[float | None]) -> None:
    wait_until(lambda: pauses == [None], 'the first sleep')
    reader.type(b'a', 'a')
    wait_until(lambda: pauses[-1] is None and len(pauses) > 1, 'the next one')
    asleep = len(pauses)
    reader.type(b'\x1b', 'escape')  # known only after some time in which nothing follows
    assert len(pauses) > asleep + 1


def test_keys_are_whole_however_their_bytes_come(reader: Reader) -> None:
    reader.type(b'\xc3')
    reader.type(b'\xa4', 'ä')
    reader.type(b'\x1b')
    reader.type(b'[A', 'up')
    reader.type(b'xyz', *'xyz')
    reader.type(b'\xff!', 'replacement_character', 'exclamation_mark')


def test_the_thread_can_be_ended_and_begun_again(reader: Reader, pauses: list[float | None]) -> None:
    reader.exit_event.set()
    reader.thread.join(DEADLINE)
    assert not reader.thread.is_alive()
    reader.exit_event.clear()
    reader.thread = threading.Thread(target=reader.run_input_thread, daemon=True)
    reader.thread.start()
    reader.type(b'b', 'b')


def test_the_end_of_a_terminal_that_is_gone_ends_the_thread(pauses: list[float | None]) -> None:
    reader = Reader()
    pauses.clear()
    os.close(reader.typed)
    reader.run_input_thread()
    assert len(pauses) == 1
    os.close(reader.fileno)
