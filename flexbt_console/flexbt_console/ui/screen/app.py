# SPDX-License-Identifier: BSD-3-Clause
"""The screen, on Textual: panes that show the mirror, and keys that send the commands of the registry."""

from __future__ import annotations

import asyncio
import contextlib
import math
import shlex
import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import prompt_help
from flexbt_console.commands.registry import find
from flexbt_console.commands.spec import UNSEEN, CommandSpec, Reading
from flexbt_console.errors import ConsoleError, NotShownError, RefusedError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.fleet import RobotOverview
from flexbt_console.mirror.mirror import Change, Mirror
from flexbt_console.mirror.records import Behavior, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.present.debugging import debug_lines, marks_of_nodes
from flexbt_console.present.queue import entry_details, entry_line, queue_title
from flexbt_console.present.style import Line, Tone
from flexbt_console.ui.answers import CHANGED, Bound, Local, Meaning, choose
from flexbt_console.ui.keys import KEYS, KeyBinding, help_lines
from flexbt_console.ui.station import Attention, RobotRequest, Session, Station
from flexbt_console.ui.terminal import OnSignal, standard_error_as_lines
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import escape_lines, one_line

from .decision_bar import ROWS, Burst, choice_texts, waiting_texts
from .dialogs import ChoiceList, Entry, MapImage, Overview, ReadingDialog, StartForm
from .lines import CommandInput
from .pane import Pane
from .panes import PANES, Layout, Panes
from .replay_bar import CURSOR_MOVES, MOVES, NOTHING_SENT, NoLink, ReplayBar, replay_help_lines
from .robot_panes import CURSOR_STEPS, CURSOR_TURNS, outcome_texts
from .textual_app import OrderedApp, TerminalDriver, image_widget

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.link.operator_link import ExecutiveLink
    from flexbt_console.recording.player import RunPlayer

    from .textual_app import ImageWidget

REDRAW_SECONDS: Final = 0.05
"""Minimum time between two drawings, s; limits the traffic over a slow connection."""

AGE_SECONDS: Final = 0.7
"""Time between two checks of values that change only with time, s; longer than between two statuses."""

PLAY_SECONDS: Final = 0.1
"""Time between two pictures of a recording that plays, s."""


_BESIDE_VIEW: Final = frozenset({Change.LOG, Change.EVENTS, Change.COMMAND})
"""Changes that are not reported by a view."""


class OperatorScreen(OrderedApp):
    """The screen of one operator at one terminal."""

    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None
    CSS = f"""
    Screen {{ layout: vertical; overflow: hidden; }}
    #status, #keys {{ height: 1; }}
    #alarm {{ height: auto; max-height: 3; }}
    #panes {{ height: 3fr; }}
    #machine, #map {{ width: 1fr; height: 100%; }}
    #map {{ border-left: solid $primary-darken-2; }}
    #decision {{ height: {ROWS}; border-top: solid $primary-darken-2; box-sizing: content-box; }}
    #log {{ height: 1fr; min-height: 3; border-top: solid $primary-darken-2; }}
    #line {{ height: 1; border: none; padding: 0; display: none; }}
    #line.typing {{ display: block; }}
    .hidden {{ display: none; }}
    #map.alone {{ border-left: none; }}
    ModalScreen {{ align: center middle; }}
    .dialog {{ width: 96; max-width: 90%; height: auto; max-height: 90%; padding: 0 1; border: round $primary;
               background: $surface; }}
    .dialog Label {{ width: 100%; }}
    .image {{ width: 95%; max-width: 95%; height: 95%; max-height: 95%; }}
    .image > * {{ width: auto; height: 1fr; }}
    .image > Label {{ height: 1; }}
    .dialog > OptionList {{ min-width: 12; max-height: 100%; border: none; padding: 0; }}
    .wide {{ width: 100%; max-width: 100%; }}
    .dim {{ text-style: dim; }}
    .ascii #map {{ border-left: ascii $primary-darken-2; }}
    .ascii #decision, .ascii #log {{ border-top: ascii $primary-darken-2; }}
    .ascii .dialog {{ border: ascii $primary; }}
    .ascii .dialog, .ascii OptionList {{ scrollbar-size: 0 0; }}
    """
    # With priority, keys are handled in the order in which they were typed, by what is open then: a key typed
    # quickly after one that opens a line or a list goes to that line or list, and is not a command.
    BINDINGS: ClassVar[list[BindingType]] = [
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
            ('up', 'mark(-1)'),
            ('down', 'mark(1)'),
            ('enter', 'enter_line'),
            ('f8', 'stop_now'),
        )
    ]
    OF_LINE: Final = ('complete', 'mark', 'enter_line')
    OF_PANES: Final = ('press', 'pick', 'replay', 'cursor', 'quit', 'slash')

    def __init__(
        self,
        station: Station,
        clock: Clock,
        robots: FleetLink | None = None,
        replay: ReplayBar | None = None,
        layout: Layout | None = None,
        image_widget: ImageWidget | None = None,
    ) -> None:
        super().__init__()
        self._session = Session(station, clock)
        self._clock = clock
        self._robots = robots
        self._replay = replay
        self._image_widget = image_widget
        self._overview: list[RobotOverview] = []
        self._followed: list[Mirror] = []
        self._turned_to = ''
        self._line = CommandInput(self._view, self.tell_error)
        self._panes = Panes(clock, station, layout or Layout(), self._line, replay)
        self._panes.robot = robots.own if robots is not None else ''
        if not self._panes.signs.has_braille:
            self.add_class('ascii')
        self._burst = Burst(clock)
        self._is_planned = False
        self._drawn_at = -math.inf
        self._drawn: View | None = None
        self._ageing: asyncio.TimerHandle | None = None
        self._is_quitting = False
        self._keys_waiting = 0
        self._stopped: deque[tuple[Mirror, str]] = deque()
        """The STOPs that were sent when their keys were read, until these have their turn; each with its robot."""

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
        yield Pane(id='log')
        if self._replay is not None:
            yield Pane(id='lanes')
        yield self._line
        yield Pane(id='keys')

    def on_mount(self) -> None:
        """Follow the mirror."""
        self._follow(self._station.mirror)
        if self._robots is not None:
            self._robots.fleet.add_listener(self._fleet_changed)
        if self._replay is not None:
            self.set_interval(PLAY_SECONDS, self.guarded(self._play_on))
            self.tell(['Press ? for the keys. This is a recording: nothing is sent.'])
        else:
            page = [f'In a browser: {one_line(self._station.page)}'] if self._station.page else []
            self.tell([*page, f'Press ? for the keys, ! or F8 to stop the robot, q to quit: {self._station.leaving}.'])
        self.draw()

    # Display

    @property
    def _station(self) -> Station:
        return self._session.station

    def tell(self, text: Sequence[str]) -> None:
        """Add lines from the console itself to the log."""
        snapshot = self._station.mirror.view().snapshot
        self._panes.log.tell(snapshot.stamp if snapshot is not None else 0.0, text)
        self._wake()

    def tell_error(self, error: Exception) -> None:
        """Report a refusal, or a fault of the console."""
        if isinstance(error, ConsoleError):
            self._warn(str(error))
        else:
            fault = escape_lines(''.join(traceback.format_exception(error)))
            self.tell([Line(line, Tone.ERROR) for line in ('fault in the console, which continues:', *fault)])

    def _warn(self, text: str) -> None:
        self.tell([Line(line, Tone.WARNING) for line in escape_lines(text)])

    def _view(self) -> View:
        """Return the view, with the decision that the operator has chosen first."""
        return self._station.mirror.view().turned_to(self._turned_to)

    def key_read(self, key: str) -> None:
        """See :class:`.textual_app.OrderedApp`. Send a STOP at once, however busy the screen is.

        F8 stops the robot on the screen, whatever is open but the list of robots, where another one may be marked; "!"
        does when nothing is open and no key waits that may open something. When the key has its turn, another robot may
        be on the screen: then that is stopped, too.
        """
        is_alone, self._keys_waiting = self._keys_waiting == 0, self._keys_waiting + 1
        if is_alone:
            self._stopped.clear()
        takes_keys = is_alone and len(self.screen_stack) == 1 and not self._line.is_open
        if (key == 'f8' and not isinstance(self.screen, Overview)) or (key == 'exclamation_mark' and takes_keys):
            station, view = self._station, self._station.mirror.view()
            with contextlib.suppress(Exception):  # it is reported when the key has its turn
                done = station.carry_out(self._session.interpret('stop', view, Bound(None)), view)
                if isinstance(done, OperatorCommand):
                    self._stopped.append((station.mirror, done.id))

    async def on_event(self, event: events.Event) -> None:
        """See :class:`.textual_app.OrderedApp`."""
        if isinstance(event, events.Key) and not event.is_forwarded:
            is_elsewhere = len(self.screen_stack) > 1 or self._line.is_open
            self._burst.typed(event.key, event.character if event.is_printable else None, is_elsewhere=is_elsewhere)
        await super().on_event(event)
        if isinstance(event, events.Key) and not event.is_forwarded:
            self._keys_waiting = max(0, self._keys_waiting - 1)

    def touched(self) -> None:
        """Note that the operator works on the decision on the screen; any key counts."""
        view = self._view()
        self._station.attention.touched(view, view.decision.id if view.decision is not None else None)

    def on_pane_resized(self) -> None:
        """Draw for the current size."""
        self._wake()

    def on_input_changed(self) -> None:
        """Redraw when other completions are shown."""
        self._wake()

    def _wake(self) -> None:
        # From any thread; several changes cause one redraw.
        if not self._is_planned and self.is_running:
            self._is_planned = True
            self.call_later(self._plan)

    def _plan(self) -> None:
        wait = self._drawn_at + REDRAW_SECONDS - self._clock.now()
        if wait > 0.0:
            self.set_timer(wait, self.draw)
        else:
            self.draw()

    def draw(self) -> None:
        """Draw what has changed in the mirror."""
        self._is_planned = False
        self._drawn_at = self._clock.now()
        self._look_again()
        try:
            self._draw(self._view())
        except Exception as error:
            self.tell_error(error)

    def _draw(self, view: View) -> None:
        self._drawn = _timeless(view)
        for told in self._session.news(view):
            self.tell(told)
        self._panes.picking.drawn(view)
        self._overview = self._robots.fleet.overview() if self._robots is not None else []
        self._station.attention.pending([one.view for one in self._overview] or [view])
        if self._panes.map.lose(view):
            self._warn('the decision is no longer pending; nothing was sent')
        if isinstance(self.screen, Overview):
            self.screen.draw()
            return
        base, visible = self.screen_stack[0], self._panes.visible(view)
        for name in PANES:
            base.query_one(f'#{name}').set_class(name not in visible, 'hidden')
        base.query_one('#panes').set_class(not {'machine', 'map'} & {*visible}, 'hidden')
        base.query_one('#map').set_class('machine' not in visible, 'alone')
        mirror = self._station.mirror
        for pane in base.query(Pane):
            if pane.id in ('alarm', 'lanes') or (pane.size.width > 0 and pane.size.height > 0):
                columns, rows = pane.content_size.width or self.size.width, pane.content_size.height
                pane.show(text := self._panes.text_of(str(pane.id), view, mirror, self._overview, columns, rows))
                if pane.id in ('alarm', 'lanes'):
                    pane.display = bool(text.plain)  # it has a row only if it has a text

    def _follow(self, mirror: Mirror) -> None:
        if mirror not in self._followed:
            self._followed.append(mirror)
            mirror.add_listener(lambda change: self._changed(mirror, change))

    def _changed(self, mirror: Mirror, change: Change) -> None:
        if mirror is self._station.mirror and (change in _BESIDE_VIEW or _timeless(mirror.view()) != self._drawn):
            self._wake()

    def _fleet_changed(self) -> None:
        if any(isinstance(one, Overview) for one in self.screen_stack[-1:]):  # which is empty at the end
            self._wake()

    def _look_again(self) -> None:
        if self._ageing is not None:
            self._ageing.cancel()
        self._ageing = asyncio.get_running_loop().call_later(AGE_SECONDS, self._age)

    def _age(self) -> None:
        """Redraw the parts that depend only on time. A single idle robot with a live link has none."""
        has_others = self._robots is not None and len(self._robots.fleet.names) > 1
        if has_others or self._session.is_waiting or _timeless(self._station.mirror.view()) != self._drawn:
            self._wake()
        self._look_again()

    # Keys

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether a key has an effect now; an open list or line receives typed characters instead."""
        if action not in (*self.OF_PANES, *self.OF_LINE, 'leave_mode'):
            return super().check_action(action, parameters)
        if len(self.screen_stack) > 1:
            return isinstance(self.screen, Overview) and parameters == ('stop',)
        return action == 'leave_mode' or self._line.is_open == (action in self.OF_LINE)

    def action_stop_now(self) -> None:
        """Stop, whatever dialog is open."""
        self.action_press('stop')

    def action_press(self, action: str) -> None:
        """Handle a key of the table."""
        key = next(key for key in KEYS if key.action == action)
        if isinstance(self.screen, Overview) and action == 'stop':
            name = self.screen.chosen  # stop the robot under the cursor, and show the effect
            self.pop_screen()
            if name != self._panes.robot:
                self._stop_and_show(name)
                return
        view = self._view()
        if action == 'stop' and self._stopped:
            mirror, command_id = self._stopped.popleft()
            self._session.follow(mirror, command_id)
            if mirror is self._station.mirror:
                self._wake()
                return
        if action == 'confirm':
            self._panes.picking.pressed()
            self._burst.check_enter()
        elif key.gives_command and action != 'stop':
            self._burst.check_key(key.shown)
        if why := key.blocked(view):
            raise RefusedError(f'{key.label}: {why}')
        if key.gives_command:
            self._station.builder.require_operator()
        if key.begins is not None:
            self._line.open(key.begins)
        elif key.lines is None:
            getattr(self, f'_do_{action}')(key, view)
        elif len(written := key.lines(view, self._station.builder.operator)) == 1 and key.asks:
            self._session.interpret(written[0], view, _shown(view))  # shows at once why it cannot work now
            self._line.open(written[0])
        elif len(written) == 1:
            self.do(written[0])
        else:
            entries = [Entry(line, (line, line.partition(' ')[2])) for line in written]
            self.open(ChoiceList(key.help, entries), lambda number: self.do(written[number]))
        self._wake()

    def _stop_and_show(self, name: str) -> None:
        """Stop another robot, and then go to it: that waits for the node, which may be busy."""
        assert self._robots is not None
        if self._stopped:  # the robot that was on the screen when the key was read
            self._session.follow(*self._stopped.popleft())
        mirror, link = _found(self._robots.robot, name)
        view = mirror.view()
        meaning = self._session.interpret('stop', view, Bound(None))
        sent = replace(self._station, mirror=mirror, link=link).carry_out(meaning, view)
        assert isinstance(sent, OperatorCommand)
        self._session.follow(mirror, sent.id)
        self.switch(name)

    def action_replay(self, move: str) -> None:
        """Move on the time line of the recording."""
        if self._replay is not None:
            self._replay.move(move)
            self._show_replay()

    def _play_on(self) -> None:
        if self._replay is not None and self._replay.play_on():
            self._show_replay()

    def _show_replay(self) -> None:
        assert self._replay is not None
        if self._station.mirror is not (mirror := self._replay.player.mirror):  # it went back: what was told since then
            self._session.turn_to(replace(self._station, mirror=mirror))  # is not told yet
            self._panes.log.moved()
        self.draw()

    def action_pick(self, number: int) -> None:
        """Pick the answer with this number."""
        view = self._view()
        self._panes.picking.pressed()
        decision = view.decision
        if number > 0 or decision is None or not decision.choices:
            self._panes.picking.pick(number, view)
            self.draw()
            return
        asked_id = decision.id

        def chosen(number: int) -> None:
            now = self._view().decision
            if now is None or now.id != asked_id:
                raise RefusedError(CHANGED)
            self._panes.picking.pick(number + 1, self._view())
            self.draw()

        texts = choice_texts(decision, view.state(decision.path), self._panes.signs)
        named = zip(texts, decision.choices, strict=True)
        entries = [Entry(text, (choice, str(number))) for number, (text, choice) in enumerate(named, 1)]
        self.open(ChoiceList('pick an answer', entries), chosen)

    def action_cursor(self, key: str) -> None:
        """Move or turn the cursor on the map; in a recording, move on its time line."""
        if self._replay is not None and key in CURSOR_MOVES:
            self.action_replay(CURSOR_MOVES[key])
        elif self._panes.map.move(key):
            self.draw()

    def action_leave_mode(self) -> None:
        """Cancel the pending input; nothing is sent. Return a scrolled pane to the latest."""
        self._panes.map.leave()
        self._is_quitting = False
        self._line.close()
        self._panes.follow()
        self.draw()

    def action_help_quit(self) -> None:
        """Cancel the pending input, and show how to quit (Ctrl-C)."""
        self.action_leave_mode()
        stop = '' if self._replay else ' Press ! or F8 to stop the robot.'
        self._warn(f'Ctrl-C clears what was typed. Press q to quit: {self._station.leaving}.{stop}')

    async def action_quit(self) -> None:
        """Handle Ctrl-Q as "q", which asks again while a behavior runs: Textual would end the program at once."""
        self.action_press('leave')

    def action_slash(self) -> None:
        """Open the line for a command, or for a search in a recording."""
        self._line.open('/' if self._replay is not None else '')

    def action_complete(self) -> None:
        """Complete the typed line."""
        self._line.complete()

    def action_mark(self, by: int) -> None:
        """Mark another completion."""
        self._line.mark(by)
        self.draw()

    def action_enter_line(self) -> None:
        """Execute the typed line. It belongs to the decision that was on the screen when typing began."""
        if self._line.take_marked():
            self.draw()
            return
        text, bound = self._line.close(), self._line.bound
        if self._replay is not None and text.startswith('/'):
            self._replay.find(text[1:])
            self._show_replay()
        else:
            view = self._view()
            self._carry_out(self._session.interpret(text, view, bound), view)
        self.draw()

    # Actions

    def do(self, text: str) -> None:
        """Execute a line, as at the prompt; it is bound to the decision on the screen."""
        view = self._view()
        self._carry_out(self._session.interpret(text, view, _shown(view)), view)

    def _carry_out(self, meaning: Meaning, view: View) -> None:
        command = meaning.command
        if command is not None and any(mirror is self._station.mirror for mirror, _ in self._stopped):
            meaning = replace(meaning, command=replace(command, stops=0))  # its key was read before that of a STOP
        done = self._session.carry_out(meaning, view)
        if isinstance(done, OperatorCommand):
            if done.decision_id:  # answered: end pointing on the map
                self._panes.map.leave()
        elif isinstance(done, Reading):
            self._read(done)
        elif done is not None:
            asking = threading.Thread(target=self._ask, args=(done, self._station.link), name='ask', daemon=True)
            try:
                asking.start()
            except RuntimeError as error:  # no more threads can be started
                raise RefusedError(f'{error}; nothing was asked') from error
        elif meaning.local is Local.QUIT:
            self.exit()

    def _ask(self, request: RobotRequest, robot: RobotLink) -> None:
        try:
            self.call_later(self._read, request.ask(robot, self._tell_later))
        except Exception as error:
            self.call_later(self.tell_error, error)

    def _tell_later(self, text: str) -> None:
        self.call_later(self.tell, escape_lines(text))

    def _read(self, reading: Reading) -> None:
        if reading.is_map and self._image_widget is not None:
            self.open(MapImage(self._image_widget, self._view))
        else:
            self.open(ReadingDialog(reading.title, reading.text))

    def _do_confirm(self, key: KeyBinding, view: View) -> None:
        decision, answer = view.decision, ''
        try:
            if self._panes.map.is_pointing:
                answer, decision = self._panes.map.answer(view)
                if decision is None:
                    raise RefusedError('the decision is no longer pending; nothing was sent')
                self._carry_out(choose(answer, view, self._station.builder, decision), view)
            elif (answer := self._panes.picking.picked(decision)) or decision is None:
                self._carry_out(self._panes.picking.confirm(view, self._station.builder), view)
            elif decision.wants_pose:
                raise RefusedError('"g" points at it on the map; ":" types a place, or x y yaw')
            elif decision.choices:
                raise RefusedError('pick an answer by its number; Enter sends it')
            else:
                self._line.open('input ')
        except NotShownError as error:
            assert decision is not None
            asked = decision.id

            def insist() -> None:
                now = self._view()
                meaning = choose(answer, now, self._station.builder, Bound(asked).decision(now), unseen=True)
                self._carry_out(meaning, now)

            self._ask_to_insist(error, Entry(f'answer {answer} without seeing it', (answer,)), insist)

    def _ask_to_insist(self, error: NotShownError, entry: Entry, insist: Callable[[], None]) -> None:
        """Ask whether to send a command although its subject was not received."""
        self._warn(str(error))
        entries = [Entry('send nothing, and wait for it', ('wait',)), entry]
        self.open(ChoiceList('the subject was not received', entries), lambda number: insist() if number == 1 else None)

    def _do_point(self, key: KeyBinding, view: View) -> None:
        self._panes.map.point(view)
        self.draw()

    def _do_waiting(self, key: KeyBinding, view: View) -> None:
        waiting = view.decisions

        def chosen(number: int) -> None:
            self._turned_to = waiting[number].id
            self._panes.picking.turned_to(self._turned_to)
            self.draw()

        texts = zip(waiting_texts(view), waiting, strict=True)
        entries = [Entry(text, (one.path, _label(one.path))) for text, one in texts]
        self.open(ChoiceList(key.help, entries), chosen)

    def _do_robots(self, key: KeyBinding, view: View) -> None:
        if self._robots is None:
            raise RefusedError('there is only one robot')
        self.open(Overview(self._robots.fleet, self._panes.robot), self.switch)

    def switch(self, name: str) -> None:
        """Switch to another robot: all panes show it, and all commands go to it."""
        if self._robots is None or name == self._panes.robot:
            return
        mirror, link = _found(self._robots.select, name)
        self._session.turn_to(replace(self._station, mirror=mirror, link=link))
        self._panes.robot = name
        self._turned_to = ''
        self._panes.moved()
        self._follow(mirror)
        self.tell([f'this is {one_line(name)}'])
        self.draw()

    def _do_force(self, key: KeyBinding, view: View) -> None:
        choices = [(path, outcome) for path in view.active_paths for outcome in view.outcomes(path)]
        entries = []
        for path, outcome in choices:
            state = view.state(path)
            texts = dict(zip(state.outcomes, outcome_texts(state, self._panes.signs), strict=True)) if state else {}
            names = (outcome, *(f'{of}{sep}{outcome}' for of in (path, _label(path)) for sep in (' ', ': ')))
            entries.append(Entry(f'{path}: {texts.get(outcome, outcome)}', names))
        self.open(
            ChoiceList('leave a state by', entries), lambda number: self.do(shlex.join(('force', *choices[number])))
        )

    def _do_debug(self, key: KeyBinding, view: View) -> None:
        """Let the operator select a node of a running tree, and then what to do at it."""
        marked = [(run, node, marks_of_nodes(view.snapshot, run)) for run in view.running_trees for node in run.nodes]
        entries = [
            Entry(f'{node.path}  {run.status(node.uid).name}{marks.get(node.path, "")}', (node.path, node.name))
            for run, node, marks in marked
        ]

        def chosen(number: int) -> None:
            run, node, marks = marked[number]
            lines = debug_lines(run, node, has_marks=node.path in marks)
            offered = [Entry(f'{name}: {line}', (name, line)) for name, line in lines.items()]
            self.open(ChoiceList(one_line(node.path), offered), lambda which: self.do([*lines.values()][which]))

        self.open(ChoiceList(key.help, entries), chosen)

    def _do_queue(self, key: KeyBinding, view: View) -> None:
        """Let the operator select an entry of the mission queue and what to do with it, or a line for all of it."""
        queue = view.queue
        assert queue is not None
        offers = {'queue add ...': 'queue add '}
        offers |= {line: line for line in (queue.hold and 'queue release', 'queue hold', 'queue clear') if line}

        def run(line: str) -> None:
            if line.endswith(' '):
                self._line.open(line)
                self.draw()
            else:
                self.do(line)

        def chosen(number: int) -> None:
            if number >= len(queue.entries):
                run([*offers.values()][number - len(queue.entries)])
                return
            entry = queue.entries[number].number
            lines = [f'queue move {entry} first', f'queue move {entry} last', f'queue remove {entry}']
            lines.append(f'queue edit {entry} ')
            choices = [Entry(line, (line, line.split()[1])) for line in lines]
            self.open(
                ChoiceList(entry_line(queue.entries[number], view.places), choices), lambda which: run(lines[which])
            )

        entries = [
            Entry(f'{entry_line(one, view.places)}  {entry_details(one)}', (str(one.number), one.behavior))
            for one in queue.entries
        ]
        entries += [Entry(text, (line.strip(), line.split()[1])) for text, line in offers.items()]
        self.open(ChoiceList(queue_title(queue), entries), chosen)

    def _do_start(self, key: KeyBinding, view: View) -> None:
        behaviors = view.behaviors or ()
        entries = [Entry(f'{one.name}  {one.description}', (one.name,), one.error) for one in behaviors]
        command = find(key.action)
        assert command is not None
        chosen = ChoiceList(f'{command.name} a behavior', entries)
        self.open(chosen, lambda number: self._fill_in(command, behaviors[number]))

    _do_switch = _do_start

    def _fill_in(self, command: CommandSpec, behavior: Behavior) -> None:
        """Open the form of a behavior, and send its line if the behavior has not changed meanwhile."""

        def filled(line: str) -> None:
            name = one_line(behavior.name)
            if behavior not in (self._view().behaviors or ()):
                raise RefusedError(f'{name} has changed since the form was opened; nothing was sent. Check it again')
            try:
                self.do(line)
            except NotShownError as error:
                entry = Entry(f'{command.name} {name} without seeing its machine', (behavior.name,))
                self._ask_to_insist(error, entry, lambda: self.do(f'{line} {UNSEEN}'))

        self.open(StartForm(command, behavior, self._view(), self._clock), filled)

    def _do_focus(self, key: KeyBinding, view: View) -> None:
        self._panes.layout.focus_next()

    def _do_zoom(self, key: KeyBinding, view: View) -> None:
        self._panes.layout.enlarge()

    def _do_hide(self, key: KeyBinding, view: View) -> None:
        self._panes.layout.hide()

    def _do_scroll_back(self, key: KeyBinding, view: View) -> None:
        self._panes.scroll(self._station.mirror, -1)

    def _do_scroll_on(self, key: KeyBinding, view: View) -> None:
        self._panes.scroll(self._station.mirror, 1)

    def _do_help(self, key: KeyBinding, view: View) -> None:
        page = [f'In a browser: {one_line(self._station.page)}', ''] if self._station.page else []
        keys = [*page, *help_lines(), '', *prompt_help(self._station.leaving)]
        shown = replay_help_lines() if self._replay else keys
        self._read(Reading(None, shown, title='keys'))

    def _do_leave(self, key: KeyBinding, view: View) -> None:
        if view.running and not self._is_quitting and self._replay is None:
            self._is_quitting = True
            raise RefusedError(f'Press q again to quit: {self._station.leaving}. Esc to stay')
        self.exit()


def _found(find: Callable[[str], tuple[Mirror, ExecutiveLink]], name: str) -> tuple[Mirror, ExecutiveLink]:
    """Return what ``find`` knows of a robot. Raises RefusedError if the robot is not known any more."""
    try:
        return find(name)
    except KeyError:
        raise RefusedError(f'{one_line(name)} was dropped from the list: it has been gone for long') from None


def _shown(view: View) -> Bound:
    return Bound(view.decision.id if view.decision else None)


def _label(path: str) -> str:
    return path.rpartition('/')[2]


def _timeless(view: View) -> View:
    """Return the view without the fields that change with each heartbeat of an idle robot with a live link; for any
    other robot, the whole view, which never compares equal."""
    if view.running or view.snapshot is None or not view.live:
        return view
    return replace(view, age=None, snapshot=replace(view.snapshot, sequence=0, stamp=0.0))


# The screen in this terminal, of robots or of a recording.

LAYOUT_FILE = f'{USER_DIRECTORY}/screen_layout'
"""File that stores the layout between sessions."""


def run_screen(station: Station, clock: Clock, on_signal: OnSignal, robots: FleetLink | None = None) -> None:
    """Run the screen in this terminal until the operator leaves it, or a signal ends it, which ``on_signal`` reports
    (see :class:`TerminalWatch`)."""
    _run(
        OperatorScreen(station, clock, robots, layout=Layout(home_path(LAYOUT_FILE)), image_widget=image_widget()),
        on_signal,
    )


def show_recording(player: RunPlayer, clock: Clock, on_signal: OnSignal) -> None:
    """Show a recording in this terminal until the operator leaves it, or a signal ends it."""
    builder = CommandBuilder(None, NOTHING_SENT)
    station = Station(player.mirror, NoLink(), builder, 1.0, Attention(clock), 'it was a recording')
    bar = ReplayBar(player, clock)
    _run(
        OperatorScreen(station, clock, replay=bar, layout=Layout(home_path(LAYOUT_FILE)), image_widget=image_widget()),
        on_signal,
    )


def _run(screen: OperatorScreen, on_signal: OnSignal) -> None:
    """Nothing else writes to its terminal."""

    async def run() -> None:
        with on_signal(screen.exit):
            await screen.run_async()

    with standard_error_as_lines(lambda text: screen.tell([Line(text, Tone.WARNING)])):
        asyncio.run(run())
