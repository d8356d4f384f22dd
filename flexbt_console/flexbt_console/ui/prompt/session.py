# SPDX-License-Identifier: BSD-3-Clause
"""The prompt itself, on prompt_toolkit: typing, drawing, and printing what happens above the line."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from prompt_toolkit import PromptSession
from prompt_toolkit.application import in_terminal
from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.formatted_text import StyleAndTextTuples
from prompt_toolkit.input import Input
from prompt_toolkit.output import ColorDepth, Output
from prompt_toolkit.shortcuts import CompleteStyle
from prompt_toolkit.styles import Style

from flexbt_console.commands import CommandBuilder, Show, candidates, command_help, prompt_help
from flexbt_console.errors import ConsoleError
from flexbt_console.mirror import Command, CommandState, LogLine, Mirror, Pose, View
from flexbt_console.present import Follower, command_result_lines
from flexbt_core.clock import Clock
from flexbt_core.values import lines

from .short_form import Bound, Local, Meaning, interpret
from .shown_decision import ShownDecision
from .toolbar import toolbar

Send = Callable[[Command, float, str], object]
"""Sends a command that is to be answered within so many seconds, with its label; the mirror follows its fate."""

AGE_SECONDS: Final = 0.5
"""How often the age of the picture is drawn anew while nothing else happens."""

REDRAW_SECONDS: Final = 0.1
"""Shortest time between two drawings, which limits what goes over a slow terminal connection."""

TOOLBAR_ROWS: Final = 12

STYLE: Final = Style.from_dict(
    {
        'bottom-toolbar': 'noreverse',
        'live': 'bold ansigreen',
        'stale': 'bold ansiyellow',
        'lost': 'bold ansired',
        'decision': 'bold ansicyan',
        'dim': 'ansibrightblack',
    }
)

GREETING: Final = '"help" lists the commands. "stop" stops the robot; "quit" leaves it going on.'


def run_prompt(mirror: Mirror, send: Send, make: CommandBuilder, timeout: float, clock: Clock) -> None:
    """Run the prompt in this terminal until the operator quits, or SIGINT, SIGTERM or SIGHUP comes."""
    asyncio.run(Prompt(mirror, send, make, timeout, clock).run())


class Prompt:
    """One operator at one terminal. Everything here runs on the event loop's thread."""

    def __init__(
        self,
        mirror: Mirror,
        send: Send,
        make: CommandBuilder,
        timeout: float,
        clock: Clock,
        *,
        input: Input | None = None,
        output: Output | None = None,
    ) -> None:
        self._mirror = mirror
        self._send = send
        self._make = make
        self._timeout = timeout
        self._shown = ShownDecision(clock)
        self._follower = Follower(mirror)
        self._pending: list[str] = []
        self._print_queue: asyncio.Queue[tuple[list[str], str | None]] = asyncio.Queue()
        self._refresh_planned = False
        self._ended = False
        self._session: PromptSession[str] = PromptSession(
            '> ',
            completer=_PromptCompleter(mirror, make.places),
            complete_while_typing=False,
            complete_style=CompleteStyle.READLINE_LIKE,
            reserve_space_for_menu=0,
            bottom_toolbar=self._toolbar,
            refresh_interval=AGE_SECONDS,
            style=STYLE,
            color_depth=ColorDepth.DEPTH_1_BIT if os.environ.get('NO_COLOR') else None,
            input=input,
            output=output,
        )
        self._session.app.min_redraw_interval = REDRAW_SECONDS
        self._session.default_buffer.on_text_changed += lambda buffer: self._shown.typed(buffer.text)

    @property
    def shown_decision(self) -> str | None:
        """Identifier of the decision that is on the screen."""
        return self._shown.shown

    async def run(self) -> None:
        """Read and do lines until the operator quits."""
        loop = asyncio.get_running_loop()
        self._mirror.add_listener(lambda change: self._wake(loop))
        for known in (signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(known, self._quit)
        printer = loop.create_task(self._print_all())
        self._print([GREETING])
        self._refresh()
        try:
            while True:
                try:
                    text = await self._session.prompt_async()
                except (EOFError, KeyboardInterrupt):
                    return
                bound = Bound(*self._shown.take())
                if not self._do(text, bound):
                    return
        finally:
            self._ended = True
            for known in (signal.SIGTERM, signal.SIGHUP):
                loop.remove_signal_handler(known)
            printer.cancel()

    def _do(self, text: str, bound: Bound) -> bool:
        """Do what a line says; False to quit."""
        view = self._mirror.view()
        try:
            meaning = interpret(text, view, self._make, bound)
            if meaning.local is Local.QUIT:
                return False
            if meaning.local is Local.HELP:
                self._print(_help(meaning))
            elif meaning.local is Local.SHOW:
                self._print(_show(meaning, view, _Known(self._mirror, self._make.places)))
        except ConsoleError as error:
            self._print(lines(str(error)))
            return True
        if meaning.command is not None:
            self._pending.append(meaning.command.id)
            self._send(meaning.command, self._timeout, meaning.label)
        return True

    def _toolbar(self) -> StyleAndTextTuples:
        view = self._mirror.view()
        self._shown.drawn(view.decision.id if view.decision else None)
        size = self._session.app.output.get_size()
        shown = toolbar(view, size.columns, min(TOOLBAR_ROWS, max(1, size.rows - 4)))
        fragments: StyleAndTextTuples = []
        for number, (style, text) in enumerate(shown):
            fragments.append((style, text if number == 0 else f'\n{text}'))
        return fragments

    def _wake(self, loop: asyncio.AbstractEventLoop) -> None:
        # From the executor thread; many messages make one refresh.
        if not self._refresh_planned and not self._ended:
            self._refresh_planned = True
            with contextlib.suppress(RuntimeError):  # the loop was closed just now
                loop.call_soon_threadsafe(self._refresh)

    def _refresh(self) -> None:
        self._refresh_planned = False
        view = self._mirror.view()
        for event in self._follower.events(view):
            self._print(event.text, view)
        for command_id in list(self._pending):
            tracked = self._mirror.command(command_id)
            if tracked is not None and tracked.state is not CommandState.PENDING:
                self._pending.remove(command_id)
                self._print(command_result_lines(tracked))
        self._session.app.invalidate()

    def _quit(self) -> None:
        if self._session.app.is_running:
            self._session.app.exit(exception=EOFError)

    def _print(self, text: list[str], view: View | None = None) -> None:
        decision = (view or self._mirror.view()).decision
        if text:
            self._print_queue.put_nowait((text, decision.id if decision else None))

    async def _print_all(self) -> None:
        output = self._session.app.output
        while True:
            text, decision_id = await self._print_queue.get()
            while not self._print_queue.empty():
                more, decision_id = self._print_queue.get_nowait()
                text = text + more
            async with in_terminal():
                for line in text:
                    # write() shows an escape character as "?", should one have slipped through.
                    output.write(line + '\n')
                output.flush()
            # On a terminal that does not tell where its cursor is, there is no toolbar: this was the drawing.
            self._shown.drawn(decision_id)


@dataclass(frozen=True)
class _Known:
    _mirror: Mirror
    places: Mapping[str, Pose]

    def log(self, count: int) -> tuple[LogLine, ...]:
        return self._mirror.log(count)


class _PromptCompleter(Completer):
    def __init__(self, mirror: Mirror, places: Mapping[str, Pose]) -> None:
        self._mirror = mirror
        self._places = places

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        text = document.text_before_cursor
        last = text.rpartition(' ')[2]
        for word in candidates(text, self._mirror.view(), self._places):
            yield Completion(word, start_position=-len(last))


def _show(meaning: Meaning, view: View, known: _Known) -> list[str]:
    assert meaning.line is not None and meaning.line.spec is not None
    action = meaning.line.spec.action
    assert isinstance(action, Show)
    return action.show(meaning.line, view, known).text


def _help(meaning: Meaning) -> list[str]:
    spec = meaning.line.spec if meaning.line else None
    return prompt_help() if spec is None else command_help(spec).splitlines()
