# SPDX-License-Identifier: BSD-3-Clause
"""The prompt, on prompt_toolkit: reads lines, draws the toolbar, and prints events above the line."""

from __future__ import annotations

import asyncio
import contextlib
import math
import sys
import threading
import traceback
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

from prompt_toolkit import PromptSession
from prompt_toolkit.application import in_terminal
from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.formatted_text import StyleAndTextTuples
from prompt_toolkit.history import InMemoryHistory
from prompt_toolkit.input import Input
from prompt_toolkit.output import ColorDepth, Output
from prompt_toolkit.shortcuts import CompleteStyle
from prompt_toolkit.styles import Style

from flexbt_console.commands.completion import candidates
from flexbt_console.commands.spec import Reading
from flexbt_console.errors import ConsoleError
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import fold
from flexbt_console.present.events import SETTLE_SECONDS, Follower
from flexbt_console.present.style import Line, Tone, coloured, has_colours, toned
from flexbt_console.ui.answers import Bound, Local, NoLiveLinkError, ShownDecision
from flexbt_console.ui.station import RobotRequest, Session, Station
from flexbt_console.ui.terminal import OnSignal, standard_error_as_lines
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import escape_lines, one_line

from .raw_input import MOST_TYPED, RawInput, is_gone
from .toolbar import toolbar

AGE_SECONDS: Final = 0.5
"""Period of redrawing the age of the picture while nothing else happens, s."""

REDRAW_SECONDS: Final = 0.1
"""Minimum time between two drawings, s; limits the traffic over a slow terminal connection."""

AT_ONCE: Final = 10_000
TURN_SECONDS: Final = 0.001
"""Characters that are printed at once, within some milliseconds; then what was typed meanwhile has its turn."""

TOOLBAR_ROWS: Final = 12

STYLE: Final = Style.from_dict(
    {
        'bottom-toolbar': 'noreverse',
        'good': 'bold ansigreen',
        'warning': 'bold ansiyellow',
        'error': 'bold ansired',
        'decision': 'bold ansicyan',
        'dim': 'ansibrightblack',
    }
)


def run_prompt(station: Station, clock: Clock, on_signal: OnSignal) -> None:
    """Run the prompt in this terminal until the operator quits, the terminal is gone, or a signal arrives.

    ``on_signal`` handles the signals: see :meth:`TerminalWatch.on_signal`.
    """
    keyboard = RawInput(lambda characters: prompt.refuse_paste(characters))
    prompt = Prompt(station, clock, on_signal=on_signal, input=keyboard)
    asyncio.run(prompt.run())


@dataclass(frozen=True)
class _Held:
    """A line that was typed without a live link, after that many STOPs, and the mirror's time until which it waits for
    one."""

    text: str
    bound: Bound
    until: float
    stops: int


class Prompt:
    """The prompt of one operator at one terminal. All methods run on the event loop's thread unless stated.

    A line that needs a live link waits for one at most for the time-out of the station.
    """

    def __init__(
        self,
        station: Station,
        clock: Clock,
        *,
        on_signal: OnSignal = lambda end: contextlib.nullcontext(),
        input: Input | None = None,
        output: Output | None = None,
    ) -> None:
        self._mirror = station.mirror
        self._station = station
        self._session = Session(station, clock)
        self._on_signal = on_signal
        self._held: deque[_Held] = deque()
        self._shown = ShownDecision(clock)
        self._follower = Follower(station.mirror)
        self._history = _History()
        self._print_queue: asyncio.Queue[tuple[list[str], str | None]] = asyncio.Queue()
        self._refresh_planned = False
        self._settled_at = math.inf
        self._ended = False
        self._has_colours = has_colours(sys.stdout)
        self._prompt: PromptSession[str] = PromptSession(
            '> ',
            completer=_PromptCompleter(station.mirror),
            history=self._history,
            complete_while_typing=False,
            complete_style=CompleteStyle.READLINE_LIKE,
            reserve_space_for_menu=0,
            bottom_toolbar=self._toolbar,
            style=STYLE,
            color_depth=None if self._has_colours else ColorDepth.DEPTH_1_BIT,
            input=input,
            output=output,
        )
        self._prompt.app.min_redraw_interval = REDRAW_SECONDS
        self._prompt.default_buffer.on_text_changed += lambda buffer: self._typed(buffer.text)

    @property
    def shown_decision(self) -> str | None:
        """Identifier of the decision on the screen."""
        return self._shown.shown

    def refuse_paste(self, characters: int) -> None:
        """Report that a paste was too long for a line."""
        told = f'a paste of {characters} characters was dropped: the limit of a line is {MOST_TYPED}; nothing was done'
        self._print(_warned([told]))

    def _typed(self, text: str) -> None:
        """Note that the operator works on the decision on the screen."""
        # A line that was cut, here or in the terminal's reader, stays refused even if the operator shortens it.
        self._history.is_cut = bool(text) and (self._history.is_cut or len(text) > MOST_TYPED)
        if len(text) > MOST_TYPED + 1:
            self._prompt.default_buffer.text = text[: MOST_TYPED + 1]
            return
        if text:
            self._station.attention.touched(self._mirror.view(), self._shown.shown)
        self._shown.typed(text)

    async def run(self) -> None:
        """Read and execute lines until the operator quits, or the terminal is gone."""
        self._loop = loop = asyncio.get_running_loop()
        self._over = asyncio.Event()
        self._mirror.add_listener(lambda change: self._wake(loop))
        loop.set_exception_handler(self._fault)
        self._print([f'In a browser: {one_line(self._station.page)}'] if self._station.page else [])
        self._print([f'"help" lists the commands. "stop" stops the robot; "quit": {self._station.leaving}.'])
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._on_signal(self._over.set))
            stack.enter_context(self._prompt.app.input.raw_mode())
            if sys.stderr.isatty():
                stack.enter_context(standard_error_as_lines(self._print_later))
            tasks = [loop.create_task(part()) for part in (self._read, self._print_all, self._age, self._over.wait)]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                self._ended = True
                for task in tasks:
                    task.cancel()
                results = await asyncio.gather(*tasks, return_exceptions=True)
        for error in results:
            if isinstance(error, Exception) and not is_gone(error):
                raise error

    async def _read(self) -> None:
        """Read and execute lines until the operator quits."""
        while True:
            try:
                text = await self._prompt.prompt_async(set_exception_handler=False, handle_sigint=False)
            except EOFError:
                return
            except KeyboardInterrupt:
                self._shown.take()
                self._history.is_cut = False
                self._clear(self._prompt.default_buffer.text)
                continue
            bound, is_cut, self._history.is_cut = self._shown.take(), self._history.is_cut, False
            if is_cut:
                told = f'the line {text!r:.40}... was longer than {MOST_TYPED} characters, and is cut; nothing was done'
                self._print(_warned([told]))
            elif not self._do(text, bound):
                return

    async def _age(self) -> None:
        """Redraw regularly, for the parts that depend only on time."""
        while True:
            self._refresh()
            await asyncio.sleep(AGE_SECONDS)

    def _clear(self, text: str) -> None:
        """Discard the typed line, as Ctrl-C does in a shell."""
        if not text.strip() and not self._held:
            self._print([f'Ctrl-C clears the line. "quit" leaves: {self._station.leaving}. "stop" stops the robot.'])
        for held in self._held:
            self._print(_warned([f'{one_line(held.text)}: canceled; nothing was sent']))
        self._held.clear()

    def _do(self, text: str, bound: Bound, stops: int | None = None) -> bool:
        """Execute a line, which may have waited since that many STOPs; return False to quit."""
        view = self._mirror.view()
        view = view if stops is None else replace(view, stops=stops)
        try:
            meaning = self._session.interpret(text, view, bound)
            done = self._session.carry_out(meaning, view)
        except NoLiveLinkError:
            self._held.append(_Held(text, bound, self._mirror.now() + self._station.timeout, view.stops))
            told = f'{one_line(text)}: waiting for a live link, at most {self._station.timeout:g} s; Ctrl-C cancels it'
            self._print(_warned([told]))
        except ConsoleError as error:
            self._print(_warned(escape_lines(str(error))))
        except Exception as error:
            self._print(_fault_lines(error))
        else:
            if isinstance(done, Reading):
                self._print(done.text)
            elif isinstance(done, RobotRequest):
                asking = threading.Thread(target=self._ask, args=(text.split()[0], done), name='ask', daemon=True)
                try:
                    asking.start()
                except RuntimeError as error:  # no more threads can be started
                    self._print(_warned([f'{one_line(text)}: {error}; nothing was asked']))
            return meaning.local is not Local.QUIT
        return True

    def _do_held(self) -> None:
        """Execute the lines that waited for a live link, and discard those whose time is over."""
        while self._held:
            is_late = self._mirror.now() >= self._held[0].until  # whatever is live after the process stood still
            if not (is_late or self._mirror.view().live):
                return
            held = self._held.popleft()
            if not is_late:
                self._do(held.text, held.bound, held.stops)
            else:
                late = f'there was no live link within {self._station.timeout:g} s; nothing was sent'
                self._print(_warned([f'{one_line(held.text)}: {late}']))

    def _ask(self, name: str, request: RobotRequest) -> None:
        """Ask the executive. Runs on a separate thread, because the answer may take long."""
        try:
            text = request.ask(self._station.link, self._print_later).text
        except ConsoleError as error:
            text = _warned([f'{name}: {line}' for line in escape_lines(str(error))])
        except Exception as error:
            text = _fault_lines(error)
        with contextlib.suppress(RuntimeError):  # the loop was closed just now
            self._loop.call_soon_threadsafe(self._print, text)

    def _print_later(self, text: str) -> None:
        """Print a text; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop was closed just now
            self._loop.call_soon_threadsafe(self._print, escape_lines(text))

    def _fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handle an exception that escaped a callback: end if the terminal is gone, else report a fault."""
        error = context.get('exception')
        if is_gone(error):
            self._over.set()
        else:
            self._print(_fault_lines(error or RuntimeError(context['message'])))

    def _toolbar(self) -> StyleAndTextTuples:
        view = self._mirror.view()
        self._shown.drawn(view.decision.id if view.decision else None)
        size = self._prompt.app.output.get_size()
        shown = toolbar(view, size.columns, min(TOOLBAR_ROWS, max(1, size.rows - 4)))
        fragments: StyleAndTextTuples = []
        for number, (style, text) in enumerate(shown):
            fragments.append((style, text if number == 0 else f'\n{text}'))
        return fragments

    def _wake(self, loop: asyncio.AbstractEventLoop) -> None:
        # Runs on the executor thread. Many messages cause one refresh.
        if not self._refresh_planned and not self._ended:
            self._refresh_planned = True
            with contextlib.suppress(RuntimeError):  # the loop was closed just now
                loop.call_soon_threadsafe(self._refresh)

    def _refresh(self) -> None:
        self._refresh_planned = False
        if self._ended:
            return
        view = self._mirror.view()
        self._station.attention.pending([view])
        self._do_held()
        if self._is_settled(view):
            self._tell(view)
        self._prompt.app.invalidate()

    def _tell(self, view: View) -> None:
        for event in self._follower.events(view):
            self._print(event.text, view)
        for lines in self._session.answers():
            self._print(lines)

    def _is_settled(self, view: View) -> bool:
        """Return whether the latched messages had time to arrive after the first status. Events are then in order."""
        if view.snapshot is None or self._settled_at <= self._loop.time():
            return True
        if self._settled_at == math.inf:
            self._settled_at = self._loop.time() + SETTLE_SECONDS
            self._loop.call_later(SETTLE_SECONDS, self._refresh)
        return False

    def _print(self, text: list[str], view: View | None = None) -> None:
        decision = (view or self._mirror.view()).decision
        if text:
            self._print_queue.put_nowait((text, decision.id if decision else None))

    async def _print_all(self) -> None:
        output = self._prompt.app.output
        while True:
            text, decision_id = await self._print_queue.get()
            text = list(text)
            while not self._print_queue.empty() and sum(map(len, text)) < AT_ONCE:
                more, decision_id = self._print_queue.get_nowait()
                text += more
            async with in_terminal():
                columns = output.get_size().columns
                for line in text:
                    for part in fold(line, columns, rows=len(line)):
                        self._write(part)
                output.flush()
            # A terminal that does not report its cursor has no toolbar, so this print shows the decision.
            self._shown.drawn(decision_id)
            await asyncio.sleep(TURN_SECONDS)

    def _write(self, line: str) -> None:
        output = self._prompt.app.output
        before, after = coloured(toned('\n', line), self._has_colours).split('\n')
        output.write_raw(before)
        # write() replaces an escape character by "?", should the line contain one.
        output.write(line)
        output.write_raw(after)
        output.write('\n')


class _History(InMemoryHistory):
    """The lines that were typed, without those that were cut."""

    def __init__(self) -> None:
        super().__init__()
        self.is_cut = False
        """True if the typed line was too long at some time since it was last empty."""

    def append_string(self, string: str) -> None:
        """See :class:`prompt_toolkit.history.History`."""
        if not self.is_cut:
            super().append_string(string)


class _PromptCompleter(Completer):
    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        text = document.text_before_cursor
        last = text.rpartition(' ')[2]
        for word in candidates(text, self._mirror.view()):
            yield Completion(word, start_position=-len(last))


def _fault_lines(error: BaseException) -> list[str]:
    text = ['fault in the console, which continues:', *escape_lines(''.join(traceback.format_exception(error)))]
    return _warned(text, Tone.ERROR)


def _warned(text: list[str], tone: Tone = Tone.WARNING) -> list[str]:
    return [Line(line, tone) for line in text]
