# SPDX-License-Identifier: BSD-3-Clause
"""The screen, on Textual: panes of what the mirror knows, and keys that give the commands of the registry."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import math
import shlex
import threading
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Final, ParamSpec, Protocol

from rich.text import Text
from textual import events
from textual.actions import ActionParseResult
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.dom import DOMNode
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.suggester import Suggester
from textual.widget import AwaitMount
from textual.widgets import Input

from flexbt_console.commands import (
    Ask,
    CommandBuilder,
    CommandedRobot,
    Show,
    candidates,
    prompt_command_help,
    prompt_help,
)
from flexbt_console.errors import ConsoleError
from flexbt_console.mirror import Behavior, Change, Decision, Fleet, Mirror, RobotOverview, View
from flexbt_console.pictures import glyphs, tree_lines
from flexbt_console.present import Line, Tone
from flexbt_console.ui.interaction import (
    CHANGED,
    KEYS,
    Attention,
    Bound,
    Key,
    Local,
    Meaning,
    OnSignal,
    SentCommands,
    choose,
    help_lines,
    interpret,
    standard_error_as_lines,
)
from flexbt_core.clock import Clock
from flexbt_core.values import lines, one_line

from .decision_bar import ROWS, Picking, choice_texts, decision_lines
from .dialogs import ChoiceList, Reading, StartForm
from .machine_lines import machine_lines, outcome_texts
from .map_pane import CURSOR_STEPS, CURSOR_TURNS, MapPane
from .overview import Overview, others_text
from .panes import Pane, styled
from .replay_bar import MOVES, NOTHING_SENT, NoLink, Player, ReplayBar
from .replay_bar import help_lines as replay_help_lines
from .status_lines import alarm_text, keys_text, log_text, status_text
from .terminal_driver import TerminalDriver

P = ParamSpec('P')

REDRAW_SECONDS: Final = 0.05
"""Shortest time between two drawings, which limits what goes over a slow connection."""

AGE_SECONDS: Final = 0.7
"""How long after a look at what time alone changes the next one is: longer than from one status to the next."""

PLAY_SECONDS: Final = 0.1
"""From one picture of a recording that plays to the next."""

FIELD_SECONDS: Final = 0.5
"""A field has taken what was typed into it before that; else the next key does not wait for it, and sends nothing."""

TOLD_LINES: Final = 200
"""Lines that the console itself has told, and are remembered."""

ZOOMED: Final = ('machine', 'map', 'log')


_BESIDE_VIEW: Final = frozenset({Change.LOG, Change.EVENTS, Change.COMMAND})
"""What changes without a view that tells so."""


class Robots(Protocol):
    """Several robots, one of which is on the screen; see :class:`flexbt_console.link.FleetLink`."""

    fleet: Fleet
    own: str

    def select(self, name: str) -> tuple[Mirror, CommandedRobot]:
        """Have map and trees come from a robot, and give its mirror and its link."""


class _Completing(Suggester):
    def __init__(self, complete: Callable[[str], str | None]) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._complete = complete

    async def get_suggestion(self, value: str) -> str | None:
        """See :class:`textual.suggester.Suggester`."""
        return self._complete(value)


def _guarded(method: Callable[P, None]) -> Callable[P, None]:
    """A fault of the screen is told, and the screen goes on: the operator still has to be able to stop the robot."""

    @functools.wraps(method)
    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            method(*args, **kwargs)
        except Exception as error:
            screen: Any = args[0]
            screen.tell_fault(error)

    return call


class OperatorScreen(App[None]):
    """One operator at one terminal. ``timeout``: seconds for each answer; ``leaving``: what happens when it is left."""

    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None
    CSS = f"""
    Screen {{ layout: vertical; overflow: hidden; }}
    #status {{ height: 1; }}
    #alarm {{ height: auto; max-height: 3; }}
    #panes {{ height: 3fr; }}
    #machine {{ width: 1fr; height: 100%; }}
    #map {{ width: 1fr; height: 100%; border-left: solid $primary-darken-2; }}
    #decision {{ height: {ROWS}; border-top: solid $primary-darken-2; box-sizing: content-box; }}
    #log {{ height: 1fr; min-height: 3; border-top: solid $primary-darken-2; }}
    #lines {{ height: 100%; }}
    #line {{ height: 1; border: none; padding: 0; display: none; }}
    #line.typing {{ display: block; }}
    #keys {{ height: 1; }}
    .zoom-machine #map, .zoom-machine #log, .zoom-map #machine, .zoom-map #log, .zoom-log #panes {{ display: none; }}
    .zoom-map #map {{ border-left: none; }}
    ModalScreen {{ align: center middle; }}
    .dialog {{ width: 70; max-width: 90%; height: auto; max-height: 90%; padding: 0 1; border: round $primary;
               background: $surface; }}
    .dialog Label {{ width: 100%; }}
    .dialog OptionList {{ min-width: 12; }}
    .wide {{ width: 100%; max-width: 100%; }}
    .dim {{ text-style: dim; }}
    .ascii #map {{ border-left: ascii $primary-darken-2; }}
    .ascii #decision, .ascii #log {{ border-top: ascii $primary-darken-2; }}
    .ascii .dialog, .ascii OptionList, .ascii .dialog Input, .ascii SelectCurrent,
    .ascii SelectOverlay {{ border: ascii $primary; }}
    .ascii .dialog, .ascii OptionList {{ scrollbar-size: 0 0; }}
    .ascii SelectCurrent .arrow {{ display: none; }}
    """
    # With priority they are dealt with in the order in which they come, by what is open by then: a key that is typed
    # quickly behind the one that opens a line or a list is for that, and is no command.
    BINDINGS: ClassVar[list[BindingType]] = [
        *(
            Binding(key, action, show=False, priority=True)
            for key, action in (
                *(
                    (name, f'press("{key.action}")')
                    for key in KEYS
                    if key.action != 'pick'
                    for name in key.keys
                    if name != 'f8'
                ),
                *((str(number), f'pick({number})') for number in range(10)),
                *((key, f'replay("{move}")') for key, move in MOVES.items()),
                *((key, f'cursor("{key}")') for key in (*CURSOR_STEPS, *CURSOR_TURNS)),
                ('escape', 'leave_mode'),
                ('slash', 'slash'),
                ('tab', 'complete'),
                ('enter', 'enter_line'),
                ('f8', 'stop_now'),
            )
        ),
    ]

    def __init__(
        self,
        mirror: Mirror,
        link: CommandedRobot,
        make: CommandBuilder,
        timeout: float,
        clock: Clock,
        leaving: str,
        robots: Robots | None = None,
        replay: ReplayBar | None = None,
    ) -> None:
        super().__init__()
        self._replay = replay
        self._robots = robots
        self._robot = robots.own if robots is not None else ''
        self._followed: list[Mirror] = []
        self._mirror = mirror
        self._link = link
        self._make = make
        self._timeout = timeout
        self._clock = clock
        self._leaving = leaving
        self._signs = glyphs()
        if not self._signs.has_braille:
            self.add_class('ascii')
        self._map = MapPane(self._signs)
        self._picking = Picking(clock)
        self._attention = Attention(clock)
        self._overview: list[RobotOverview] = []
        self._told: deque[tuple[float, str]] = deque(maxlen=TOLD_LINES)
        self._sent = SentCommands(clock)
        self._is_planned = False
        self._drawn_at = -math.inf
        self._drawn: View | None = None
        self._zoomed = 0
        self._ageing: asyncio.TimerHandle | None = None
        self._is_quitting = False
        self._line_bound = Bound(None)
        self._opening: AwaitMount | None = None

    def get_driver_class(self) -> type[Driver]:
        """See :class:`textual.app.App`."""
        driver = super().get_driver_class()
        return TerminalDriver if driver is LinuxDriver else driver

    def compose(self) -> ComposeResult:
        """See :class:`textual.app.App`."""
        yield Pane(id='status')
        yield Pane(id='alarm')
        with Horizontal(id='panes'):
            yield Pane(id='machine')
            yield Pane(id='map')
        yield Pane(id='decision')
        with Vertical(id='log'):
            yield Pane(id='lines')
        yield Input(
            id='line',
            suggester=_Completing(self._completed),
            placeholder='a command; Tab completes, Esc leaves',
            select_on_focus=False,
            disabled=True,
        )
        yield Pane(id='keys')

    def on_mount(self) -> None:
        """Follow the mirror."""
        self._follow(self._mirror)
        if self._robots is not None:
            self._robots.fleet.add_listener(lambda: self._wake() if isinstance(self.screen, Overview) else None)
        if self._replay is not None:
            self.set_interval(PLAY_SECONDS, self._play_on)
            self.tell(['"?" shows the keys. This is a recording: nothing is sent.'])
        else:
            self.tell([f'"?" shows the keys. "!" or F8 stops the robot; "q": {self._leaving}.'])
        self.draw()

    def on_pane_resized(self) -> None:
        """Draw for the size that there is now."""
        self._wake()

    # What is shown

    def tell(self, text: Sequence[str]) -> None:
        """Add lines of the console's own to the log."""
        snapshot = self._mirror.view().snapshot
        stamp = snapshot.stamp if snapshot is not None else 0.0
        self._told.extend((stamp, line) for line in text)
        self._wake()

    def tell_fault(self, error: Exception) -> None:
        """Tell what is a fault of our own."""
        text = ['fault in the console, which goes on:', *lines(''.join(traceback.format_exception(error)))]
        self.tell([Line(line, Tone.ERROR) for line in text])

    def _wake(self) -> None:
        # From any thread; many changes make one drawing.
        if not self._is_planned and self.is_running:
            self._is_planned = True
            self.call_later(self._plan)

    def _plan(self) -> None:
        wait = self._drawn_at + REDRAW_SECONDS - self._clock.now()
        if wait > 0.0:
            self.set_timer(wait, self.draw)
        else:
            self.draw()

    @_guarded
    def draw(self) -> None:
        """Draw what the mirror knows now; what has not changed is not drawn."""
        self._is_planned = False
        self._drawn_at = self._clock.now()
        self._look_again()
        view = self._mirror.view()
        self._drawn = _timeless(view)
        for told in self._sent.updates():
            self.tell(told)
        self._picking.drawn(view)
        self._overview = self._robots.fleet.overview() if self._robots is not None else []
        views = [one.view for one in self._overview] or [view]
        self._attention.pending(views)
        if self._map.lose(view):
            self.tell([Line('the decision is gone; nothing was sent', Tone.WARNING)])
        if isinstance(self.screen, Overview):
            self.screen.draw()
            return
        base = self.screen_stack[0]
        for name, draw in self._parts():
            pane = base.query_one(f'#{name}', Pane)
            if name != 'alarm' and not (pane.size.width > 0 and pane.size.height > 0):
                continue
            text = draw(view, pane.content_size.width or self.size.width, pane.content_size.height)
            if name == 'alarm':
                pane.display = bool(text.plain)  # it takes a row only when there is something
            pane.show(text)

    def _look_again(self) -> None:
        if self._ageing is not None:
            self._ageing.cancel()
        self._ageing = asyncio.get_running_loop().call_later(AGE_SECONDS, self._age)

    def _age(self) -> None:
        """Draw what time alone has changed: nothing of one robot that is at rest and heard."""
        has_others = self._robots is not None and len(self._robots.fleet.names) > 1
        if has_others or self._sent or _timeless(self._mirror.view()) != self._drawn:
            self._wake()
        self._look_again()

    def _parts(self) -> tuple[tuple[str, Callable[[View, int, int], Text]], ...]:
        return (
            ('status', self._status),
            ('alarm', self._alarm),
            ('machine', self._machine),
            ('map', self._map.draw),
            ('decision', self._decision),
            ('lines', self._lines),
            (
                'keys',
                lambda view, columns, rows: (
                    self._replay.text(columns) if self._replay else keys_text(view, columns, self._make.operator)
                ),
            ),
        )

    def _machine(self, view: View, columns: int, rows: int) -> Text:
        running = view.running_trees
        shown = machine_lines(view, columns, rows, self._signs) if view.running else []
        room = max(4, rows // 2, rows - sum(len(run.nodes) + 1 for run in running))
        if len(shown) > room:
            shown = machine_lines(view, columns, room, self._signs)
        for number, run in enumerate(running):
            left = rows - len(shown)
            shown += tree_lines(run, columns, left // (len(running) - number), self._signs)
        if not shown and view.snapshot is not None and not view.running:
            shown = [Line('no behavior runs' if self._replay else 'no behavior runs; "s" starts one', Tone.DIM)]
        text = styled(shown)
        if not view.live:
            text.stylize('dim')
        return text

    def _decision(self, view: View, columns: int, rows: int) -> Text:
        picked, is_pointing = self._picking.picked(view.decision), self._map.is_pointing
        return styled(decision_lines(view, picked, columns, self._signs, is_pointing=is_pointing))

    def _status(self, view: View, columns: int, rows: int) -> Text:
        robot, others = 'RECORDING' if self._replay else '', ''
        if len(self._overview) > 1:
            robot, others = self._robot, others_text(self._overview, self._robot)
        return status_text(view, columns, robot, others, self._make.operator)

    def _alarm(self, view: View, columns: int, rows: int) -> Text:
        return alarm_text(view, columns, self._make.operator, is_recorded=self._replay is not None)

    def _lines(self, view: View, columns: int, rows: int) -> Text:
        # What became of one's own commands is told already.
        events = [event for event in self._mirror.events(max(1, rows)) if event.operator != self._make.operator]
        return log_text(self._mirror.log(max(1, rows)), events, self._told, columns, rows)

    # What is done

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Whether a key does that now; what is typed into a line or an open list is for these."""
        if action not in ('press', 'pick', 'replay', 'cursor', 'quit', 'leave_mode', 'slash', 'complete', 'enter_line'):
            return super().check_action(action, parameters)
        if len(self.screen_stack) > 1:
            return isinstance(self.screen, Overview) and parameters == ('stop',)
        is_typing = self.query_one('#line', Input).has_class('typing')
        return action == 'leave_mode' or is_typing == (action in ('complete', 'enter_line'))

    async def run_action(
        self,
        action: str | ActionParseResult,
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        """See :class:`textual.app.App`. A fault in what a key does, also in a dialog, is told, and it goes on."""
        try:
            return await super().run_action(action, default_namespace, namespaces)
        except Exception as error:
            self.tell_fault(error)
            return True

    def action_stop_now(self) -> None:
        """Stop, whatever is open."""
        self.action_press('stop')

    def action_press(self, action: str) -> None:
        """A key of the table was pressed."""
        key = next(key for key in KEYS if key.action == action)
        view = self._mirror.view()
        if isinstance(self.screen, Overview) and action == 'stop' and self._robots is not None:
            name = self.screen.chosen  # the one under the cursor is meant, and what becomes of it is seen
            self.pop_screen()
            self.switch(name)
            view = self._mirror.view()
        if action == 'confirm' and self._map.is_pointing:
            self._answer_by_cursor(view)
            return
        if why := key.blocked(view):
            self._warn(f'{key.label}: {why}')
            return
        if key.lines is None:
            getattr(self, f'_do_{action}')(key, view)
        elif len(written := key.lines(view, self._make.operator)) == 1:
            self.do(written[0])
        else:
            self._choose(key.help, written, written)

    def action_replay(self, move: str) -> None:
        """Move on the time line of the recording."""
        if self._replay is not None:
            self._replay.move(move)
            self._show_replay()

    @_guarded
    def _play_on(self) -> None:
        if self._replay is not None and self._replay.play_on():
            self._show_replay()

    def _show_replay(self) -> None:
        assert self._replay is not None
        if self._mirror is not self._replay.player.mirror:  # it went back: what was told since then is not told yet
            self._mirror = self._replay.player.mirror
            self._told.clear()
        self.draw()

    def action_pick(self, number: int) -> None:
        """A number was pressed."""
        view = self._mirror.view()
        if number == 0 and view.decision is not None and view.decision.choices:
            self._list_answers(view.decision, view)
            return
        try:
            self._picking.pick(number, view)
        except ConsoleError as error:
            self._warn(str(error))
        self.draw()

    def _list_answers(self, decision: Decision, view: View) -> None:
        def chosen(number: int | None) -> None:
            now = self._mirror.view().decision
            if number is not None and now is not None and now.id == decision.id:
                self.action_pick(number + 1)
            elif number is not None:
                self._warn(CHANGED)

        texts = choice_texts(decision, view.state(decision.path), self._signs)
        self._opening = self.push_screen(ChoiceList('pick an answer', texts), chosen)

    def action_cursor(self, key: str) -> None:
        """Move or turn the cursor on the map."""
        if self._map.move(key):
            self.draw()

    def action_leave_mode(self) -> None:
        """Leave what was begun; nothing is sent."""
        self._map.leave()
        self._is_quitting = False
        self._close_line()
        self.draw()

    def action_help_quit(self) -> None:
        """Ctrl-C, which leaves nothing but what was begun: whoever wants to leave is told how."""
        self.action_leave_mode()
        stop = '' if self._replay else ' "!" or F8 stops the robot.'
        self._warn(f'Ctrl-C gives up what was typed. "q" leaves: {self._leaving}.{stop}')

    async def action_quit(self) -> None:
        """Ctrl-Q, by which Textual ends a program at once, is as "q", which asks again while a behavior runs."""
        self.action_press('leave')

    @_guarded
    def do(self, text: str) -> None:
        """Do what a line says, as at the prompt; it is bound to the decision on the screen."""
        view = self._mirror.view()
        decision = view.decision
        try:
            self._carry_out(interpret(text, view, self._make, Bound(decision.id if decision else None)), view)
        except ConsoleError as error:
            self._warn(str(error))

    def _carry_out(self, meaning: Meaning, view: View) -> None:
        if meaning.command is not None:
            command = self._attention.measured(meaning.command)
            if command.decision_id:  # it is answered: there is nothing left to point at
                self._map.leave()
            self._sent.add(self._mirror, command.id)
            self._link.send(command, self._timeout, meaning.label)
        elif meaning.local is Local.QUIT:
            self.exit()
        elif meaning.local is Local.HELP:
            spec = meaning.line.spec if meaning.line else None
            self._read('help', prompt_help(self._leaving) if spec is None else prompt_command_help(spec))
        elif meaning.local is Local.SHOW:
            assert meaning.line is not None and meaning.line.spec is not None
            action = meaning.line.spec.action
            assert isinstance(action, Show)
            self._read(meaning.line.spec.name, action.show(meaning.line, view, self._mirror).text)
        elif meaning.local is Local.ASK:
            threading.Thread(target=self._ask, args=(meaning,), name='ask', daemon=True).start()

    async def on_event(self, event: events.Event) -> None:
        """See :class:`textual.app.App`. Every key counts as dealing with the decision on the screen.

        A key that changes a field, or leaves it, comes after what was typed into it, and before the next key: Textual
        has both in queues of different widgets. What a key has opened has its focus before the next key.
        """
        if isinstance(event, events.Key):
            if self._opening is not None:
                opening, self._opening = self._opening, None
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(opening(), FIELD_SECONDS)
            view = self._mirror.view()
            self._attention.touched(view, view.decision.id if view.decision is not None else None)
            field = self.focused
            if isinstance(field, Input) and not (event.is_forwarded or event.is_printable):
                typed = asyncio.Event()
                field.call_later(typed.set)
                try:
                    await asyncio.wait_for(typed.wait(), FIELD_SECONDS)
                except TimeoutError:
                    if event.key in ('enter', 'ctrl+s'):
                        self._warn('what was typed is not in its field yet; nothing was done: press it again')
                        return
                if not await self._check_bindings(event.key, priority=True):
                    await self._check_bindings(event.key)
                return
        await super().on_event(event)

    def _ask(self, meaning: Meaning) -> None:
        assert meaning.line is not None and meaning.line.spec is not None
        action = meaning.line.spec.action
        assert isinstance(action, Ask)
        try:
            text = action.ask(meaning.line, self._link, self._timeout, self._tell_progress).text
        except ConsoleError as error:
            text = [Line(line, Tone.WARNING) for line in lines(str(error))]
        self.call_later(self._read, meaning.line.spec.name, text)

    def _tell_progress(self, text: str) -> None:
        self.call_later(self.tell, lines(text))

    def _warn(self, text: str) -> None:
        self.tell([Line(line, Tone.WARNING) for line in lines(text)])

    def _read(self, title: str, text: Sequence[str]) -> None:
        self._opening = self.push_screen(Reading(title, text))

    def _do_confirm(self, key: Key, view: View) -> None:
        decision = view.decision
        if decision is not None and not self._picking.picked(decision):
            if decision.wants_pose:
                self._do_point(key, view)
            elif not decision.choices:
                self._open_line('input ')
            else:
                self._warn('pick an answer by its number; Enter sends it')
            return
        try:
            self._carry_out(self._picking.confirm(view, self._make), view)
        except ConsoleError as error:
            self._warn(str(error))

    def _do_point(self, key: Key, view: View) -> None:
        if not self._map.point(view):
            self._warn('there is no map to point at yet; ":" types a place, or x y yaw')
        self.draw()

    def _answer_by_cursor(self, view: View) -> None:
        text, decision = self._map.answer(view)
        try:
            if decision is None:
                self._warn('the decision is gone; nothing was sent')
            else:
                self._carry_out(choose(text, view, self._make, decision), view)
        except ConsoleError as error:
            self._warn(str(error))

    def _do_robots(self, key: Key, view: View) -> None:
        if self._robots is None:
            self._warn('there is one robot here')
            return

        def chosen(name: str | None) -> None:
            if name is not None:
                self.switch(name)

        self._opening = self.push_screen(Overview(self._robots.fleet.overview, self._robot), chosen)

    @_guarded
    def switch(self, name: str) -> None:
        """Go to another robot: all panes show it, and all commands are for it."""
        if self._robots is None or name == self._robot:
            return
        self._mirror, self._link = self._robots.select(name)
        self._robot = name
        self._picking.moved()
        self._map = MapPane(self._signs)
        self._told.clear()
        self._follow(self._mirror)
        self.tell([f'this is {one_line(name)}'])
        self.draw()

    def _follow(self, mirror: Mirror) -> None:
        if mirror not in self._followed:
            self._followed.append(mirror)
            mirror.add_listener(lambda change: self._changed(mirror, change))

    def _changed(self, mirror: Mirror, change: Change) -> None:
        if mirror is self._mirror and (change in _BESIDE_VIEW or _timeless(mirror.view()) != self._drawn):
            self._wake()

    def _do_force(self, key: Key, view: View) -> None:
        choices = [(path, outcome) for path in view.active_paths for outcome in view.outcomes(path)]
        shown = [f'{path}: {outcome}' for path, outcome in choices]
        for number, (path, outcome) in enumerate(choices):
            state = view.state(path)
            texts = outcome_texts(state, self._signs) if state else []
            place = state.outcomes.index(outcome) if state else -1
            shown[number] = f'{path}: {texts[place] if 0 <= place < len(texts) else outcome}'
        if not choices:
            self._warn('the outcomes of the active state are not known yet')
            return

        self._choose('leave a state by', shown, [shlex.join(('force', path, outcome)) for path, outcome in choices])

    def _choose(self, title: str, shown: Sequence[str], written: Sequence[str]) -> None:
        """Have one of the lines chosen, and do it."""

        def chosen(number: int | None) -> None:
            if number is not None:
                self.do(written[number])

        self._opening = self.push_screen(ChoiceList(title, shown), chosen)

    def _do_start(self, key: Key, view: View) -> None:
        usable = [behavior for behavior in view.behaviors or () if not behavior.error]
        if not usable:
            self._warn('the robot has not said which behaviors it has')
            return

        def chosen(number: int | None) -> None:
            if number is not None:
                self._fill_in(key.action, usable[number])

        shown = [f'{behavior.name}  {behavior.description}' for behavior in usable]
        self._opening = self.push_screen(ChoiceList(f'{key.action} a behavior', shown), chosen)

    _do_switch = _do_start

    @_guarded
    def _fill_in(self, verb: str, behavior: Behavior) -> None:
        def filled(line: str | None) -> None:
            if line is not None:
                self.do(line)

        self._opening = self.push_screen(StartForm(verb, behavior), filled)

    def _do_note(self, key: Key, view: View) -> None:
        self._open_line('note ')

    def _do_command_line(self, key: Key, view: View) -> None:
        self._open_line('')

    def _do_zoom(self, key: Key, view: View) -> None:
        base = self.screen_stack[0]
        self._zoomed = (self._zoomed + 1) % (len(ZOOMED) + 1)
        for number, name in enumerate(ZOOMED, 1):
            base.set_class(number == self._zoomed, f'zoom-{name}')

    def _do_help(self, key: Key, view: View) -> None:
        shown = replay_help_lines() if self._replay else [*help_lines(), '', *prompt_help(self._leaving)]
        self._read('keys', shown)

    def _do_leave(self, key: Key, view: View) -> None:
        if view.running and not self._is_quitting and self._replay is None:
            self._is_quitting = True
            self._warn(f'q again leaves: {self._leaving}; Esc stays')
        else:
            self.exit()

    # The line that is typed

    def _open_line(self, text: str) -> None:
        line = self.query_one('#line', Input)
        decision = self._mirror.view().decision
        self._line_bound = Bound(decision.id if decision else None)
        line.disabled = False
        line.value = text
        line.cursor_position = len(text)
        line.add_class('typing')
        self.screen.set_focus(line)  # at once: the next key is typed into it

    def _close_line(self) -> None:
        line = self.screen_stack[0].query_one('#line', Input)
        line.remove_class('typing')
        line.disabled = True
        self.screen_stack[0].set_focus(None)

    def action_enter_line(self) -> None:
        """A line was typed; it belongs to the decision that was on the screen when it was begun."""
        text = self.query_one('#line', Input).value
        self._close_line()
        view = self._mirror.view()
        try:
            if self._replay is not None and text.startswith('/'):
                self._replay.find(text[1:])
                self._show_replay()
                return
            self._carry_out(interpret(text, view, self._make, self._line_bound), view)
        except ConsoleError as error:
            self._warn(str(error))

    def action_slash(self) -> None:
        """Type a command, or what is looked for in a recording."""
        self._open_line('/' if self._replay is not None else '')

    def action_complete(self) -> None:
        """Complete the line that is typed, at whose end the completion is seen."""
        line = self.query_one('#line', Input)
        if line.cursor_position == len(line.value):
            line.value = self._completed(line.value) or line.value
            line.cursor_position = len(line.value)

    def _completed(self, value: str) -> str | None:
        """The line with its last word completed."""
        try:
            found = candidates(value, self._mirror.view())
        except Exception as error:  # on a worker of the field, which would end the screen
            self.tell_fault(error)
            return None
        head = value[: len(value) - len(value.rpartition(' ')[2])]
        return f'{head}{found[0]}' if value and found else None


def _timeless(view: View) -> View:
    """What is shown of a robot at rest, whose heartbeat tells nothing new; of another one all, which is never the same
    twice."""
    if view.running or view.snapshot is None or not view.live:
        return view
    return replace(view, age=None, snapshot=replace(view.snapshot, sequence=0, stamp=0.0))


def run_screen(
    mirror: Mirror,
    link: CommandedRobot,
    make: CommandBuilder,
    timeout: float,
    clock: Clock,
    leaving: str,
    on_signal: OnSignal,
    robots: Robots | None = None,
) -> None:
    """Run the screen in this terminal until the operator leaves it, or a signal ends it, of which ``on_signal`` tells
    (see :class:`flexbt_console.ui.terminal_watch.TerminalWatch`)."""
    _run(OperatorScreen(mirror, link, make, timeout, clock, leaving, robots), on_signal)


def show_recording(player: Player, clock: Clock, on_signal: OnSignal) -> None:
    """Show a recording in this terminal until the operator leaves it, or a signal ends it."""
    bar, make = ReplayBar(player, clock), CommandBuilder(None, NOTHING_SENT)
    _run(OperatorScreen(player.mirror, NoLink(), make, 1.0, clock, 'it was a recording', replay=bar), on_signal)


def _run(screen: OperatorScreen, on_signal: OnSignal) -> None:
    """Nothing else writes to its terminal."""

    async def run() -> None:
        with on_signal(screen.exit):
            await screen.run_async()

    with standard_error_as_lines(lambda text: screen.tell([Line(text, Tone.WARNING)])):
        asyncio.run(run())
