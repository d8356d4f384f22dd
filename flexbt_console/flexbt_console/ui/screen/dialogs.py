# SPDX-License-Identifier: BSD-3-Clause
"""Dialogs over the panes: a list of choices, the form of a behavior, a text, the list of robots. Escape closes each.

The keys that move in a dialog or close it have priority, and its first field gets the focus at once. So keys are
handled in the order in which they were typed, however quickly, and each key reaches the dialog for which it was typed.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.suggester import SuggestFromList
from textual.widgets import Label, OptionList
from textual.widgets.option_list import Option

from flexbt_console.commands.operator_values import parameter_value, start_input
from flexbt_console.commands.spec import CommandSpec, Typed
from flexbt_console.commands.spec import Option as CommandOption
from flexbt_console.errors import ConsoleError, RefusedError
from flexbt_console.mirror.fleet import Fleet, RobotOverview
from flexbt_console.mirror.records import POSE_TYPES, Behavior, BehaviorInput, BehaviorParameter, FramedPose
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, fold
from flexbt_console.present.maps import map_image, where_text
from flexbt_console.present.rendering import BOOLEANS, left_out_text, machine_text_lines, parameter_text, robot_line
from flexbt_console.present.style import Line, Tone, tone_of, toned
from flexbt_console.present.tree_lines import window
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import one_line, short_repr

from .decision_bar import BURST_SECONDS
from .pane import TONES, Field, Pane, styled

if TYPE_CHECKING:
    from .textual_app import ImageWidget

IMAGE_SECONDS: Final = 2.0
"""Time between two images of the map, s. An image has some ten kilobytes."""

MOST_ROWS: Final = 100
"""Maximum rows into which a line is folded."""


class Entry(NamedTuple):
    """A line of a list: its text, the names by which it can be typed, and why it cannot be chosen ('' if it can)."""

    text: str
    names: tuple[str, ...]
    refusal: str = ''


class FindField(Field):
    """The field whose text filters a list. It has the focus instead of the list."""

    DEFAULT_CSS = 'FindField { dock: top; height: 1; border: none; padding: 0; } FindField:focus { border: none; }'


HOW_TO_CHOOSE: Final = 'type to find, Up Down mark, Enter chooses, Esc leaves'


class ChoiceList(ModalScreen[int | None]):
    """A list with a filter; returns the index of the chosen entry, from 0, or None.

    At first no entry is marked. Enter chooses the entry that was marked with the arrows, or the only one whose name was
    typed. Otherwise it chooses nothing, and shows what to do.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'dismiss(None)', 'leave', priority=True),
        Binding('enter', 'choose', 'choose', priority=True),
        *(
            Binding(key, f'move("{move}")', move, priority=True)
            for key, move in (
                ('up', 'cursor_up'),
                ('down', 'cursor_down'),
                ('home', 'first'),
                ('end', 'last'),
                ('pageup', 'page_up'),
                ('pagedown', 'page_down'),
            )
        ),
    ]

    def __init__(self, title: str, entries: Sequence[Entry]) -> None:
        """Make the list. ``title`` is shown as it is; the texts of entries may come from the robot and are escaped."""
        super().__init__()
        self._title = title
        self._entries = entries
        self._filtered_by = ''
        self._marked: int | None = None

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with Vertical(classes='dialog') as dialog:
            dialog.border_title, dialog.border_subtitle = Text(self._title), HOW_TO_CHOOSE
            yield FindField(placeholder='type to find')
            yield OptionList()

    def on_mount(self) -> None:
        """Focus the filter, so that it receives typed keys."""
        options = self.query_one(OptionList)
        options.can_focus = False
        options.set_options(self._options(''))  # passed to the constructor, the first would be marked
        self.set_focus(self.query_one(FindField))

    def on_resize(self) -> None:
        """Keep the marked line visible."""
        self.query_one(OptionList).scroll_to_highlight()

    def on_input_changed(self) -> None:
        """Show the entries that match the typed text."""
        self._filter()

    def _filter(self) -> str:
        """Return the typed text. If it has changed, show the matching entries and unmark all."""
        typed = self.query_one(FindField).value
        if typed != self._filtered_by:
            self._filtered_by, self._marked = typed, None
            self.query_one(OptionList).set_options(self._options(typed))
            self._tell(HOW_TO_CHOOSE)
        return typed.strip()

    def _options(self, typed: str) -> list[Option]:
        words = typed.casefold().split()
        return [
            Option(self._row(number), id=str(number), disabled=bool(entry.refusal))
            for number, entry in enumerate(self._entries)
            if all(word in ' '.join(entry.names).casefold() for word in words)
        ]

    def _row(self, number: int) -> Text:
        """Return the line of an entry. A marked one also has a sign, because not every terminal shows colours."""
        entry = self._entries[number]
        why = f'  (not possible: {one_line(entry.refusal)})' if entry.refusal else ''
        return Text(f'{">" if number == self._marked else " "} {one_line(entry.text)}{why}')

    def _tell(self, text: str) -> None:
        self.query_one('.dialog').border_subtitle = Text(text, 'bold' if text != HOW_TO_CHOOSE else '')

    def action_move(self, move: str) -> None:
        """Mark another line with an action of Textual's list; without effect while the list has no room for a line."""
        self._filter()
        options = self.query_one(OptionList)
        if options.scrollable_content_region.height > 0:
            getattr(options, f'action_{move}')()
        before, option = self._marked, options.highlighted_option
        self._marked = int(str(option.id)) if option is not None else None
        for number in (before, self._marked):
            if number is not None:
                options.replace_option_prompt(str(number), self._row(number))

    def action_choose(self) -> None:
        """Choose the entry that was marked or whose name was typed; otherwise show why none is chosen."""
        typed = self._filter()
        found = [self._marked] if self._marked is not None else self._named(typed)
        if len(found) == 1 and not (why := self._entries[found[0]].refusal):
            self.dismiss(found[0])
        elif len(found) == 1:
            self._tell(f'not possible: {one_line(why)}')
        elif found:
            self._tell(f'{len(found)} lines have this name: mark one with Up and Down')
        elif typed:
            self._tell('no line has this name: type it in full, or mark one with Up and Down')
        else:
            self._tell('nothing is marked yet: type a name, or mark a line with Up and Down')

    def _named(self, typed: str) -> list[int]:
        """Return the indices of the entries with the typed name: those of the same case if any, or else of any case."""
        for same in (str, str.casefold):
            found = [
                number
                for number, entry in enumerate(self._entries)
                if typed and same(' '.join(typed.split())) in [same(' '.join(name.split())) for name in entry.names]
            ]
            if found:
                return found
        return []

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Choose the line that was clicked."""
        self.dismiss(int(str(event.option_id)))


class FormField(Field):
    """A field of a form, which yields words of the command line. Up and Down step through its ``choices``."""

    DEFAULT_CSS = 'FormField { height: 1; border: none; padding: 0 2; } FormField:focus { border: none; }'
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('up', 'step(-1)', 'the choice before', show=False),
        Binding('down', 'step(1)', 'the next choice', show=False),
    ]

    def __init__(self, told: str, default: str = '', choices: Sequence[str] = (), placeholder: str = '') -> None:
        suggester = SuggestFromList(choices, case_sensitive=True) if choices else None
        super().__init__(default, suggester=suggester, placeholder=placeholder, select_on_focus=True)
        self.told = told
        self._default = default
        self._choices = choices

    def action_step(self, by: int) -> None:
        """Select the choice ``by`` places after the current one."""
        if self._choices:
            place = self._choices.index(self.value) + by if self.value in self._choices else min(by, 0)
            self.value = self._choices[place % len(self._choices)]
            self.cursor_position = len(self.value)

    @property
    def is_changed(self) -> bool:
        """True if the value differs from the default."""
        return self.value != self._default

    def words(self) -> list[str]:
        """Return the words of the command line for the value. Raises ConsoleError if the value is invalid."""
        raise NotImplementedError


class ParameterField(FormField):
    """A field for a parameter of a behavior."""

    def __init__(self, parameter: BehaviorParameter) -> None:
        choices = parameter.choices or BOOLEANS * (parameter.type == 'bool')
        default = parameter.default
        if parameter.choices and default not in choices:
            default = choices[0]
        super().__init__(parameter_text(parameter), default, choices)
        self._parameter = parameter

    def words(self) -> list[str]:
        """See :class:`FormField`."""
        if self.value == self._parameter.default:
            return []
        return [f'{self._parameter.name}={parameter_value(self._parameter, self.value)}']


class InputField(FormField):
    """A field for an input of a behavior. If it is empty, the input is not sent; a needed input is then refused."""

    def __init__(self, known: BehaviorInput, places: Mapping[str, FramedPose]) -> None:
        is_pose = known.type in POSE_TYPES
        told = f'input {one_line(known.key)} ({one_line(known.type) or "TYPE:VALUE"})  {one_line(known.description)}'
        super().__init__(told, choices=sorted(places) if is_pose else (), placeholder='a place, or x y yaw' * is_pose)
        self._known = known
        self._places = places

    def words(self) -> list[str]:
        """See :class:`FormField`."""
        if not self.value.strip():
            if self._known.needed:
                raise RefusedError(f'input {short_repr(self._known.key)} is needed')
            return []
        text = f'{self._known.key}={self._known.type}{":" * bool(self._known.type)}{self.value}'
        start_input(text, self._places)
        return ['--input', text]


class OptionField(FormField):
    """A field for an option of the command. If it is empty, the option is omitted."""

    def __init__(self, option: CommandOption, choices: Sequence[str], places: Mapping[str, FramedPose]) -> None:
        super().__init__(
            f'{option.name.removeprefix("--")}  {option.help}', choices=choices, placeholder=option.value or ''
        )
        self._option = option
        self._places = places

    def words(self) -> list[str]:
        """See :class:`FormField`."""
        if not self.value.strip():
            return []
        if self._option.name == '--input':
            start_input(self.value, self._places)
        elif self._option.read is not None:
            self._option.read(self.value)
        return [self._option.name, self.value]


class StartForm(ModalScreen[str | None]):
    """A form with a field for each parameter and input of a behavior, and for each option of the command. It returns
    the line that starts the behavior, or None. Below the fields it shows the machine of a synthesized behavior.

    ``command`` is ``start`` or ``switch``. If a value is invalid, the form shows why, and stays open. It also ignores
    an Enter that follows at once, or is held down, while nothing was filled in: that Enter was meant for the dialog
    that opened the form.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'dismiss(None)', 'leave', priority=True),
        Binding('enter,ctrl+s', 'send', 'start', priority=True),
        Binding('tab', 'app.focus_next', 'next', priority=True),
        Binding('shift+tab', 'app.focus_previous', 'previous', priority=True),
    ]

    def __init__(self, command: CommandSpec, behavior: Behavior, view: View, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._pressed_at = clock.now()
        self._command = command
        self._behavior = behavior
        typed = Typed((behavior.name,), view)
        options = {option.name: option for option in command.prompt_options}
        inputs = behavior.inputs if '--input' in options else ()
        self._fields: list[FormField] = [
            *(ParameterField(parameter) for parameter in behavior.parameters),
            *(InputField(known, view.places) for known in inputs),
            *(
                OptionField(option, [*option.values(typed)] if option.values is not None else [], view.places)
                for option in options.values()
                if option.value is not None
            ),
        ]

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with VerticalScroll(classes='dialog', can_focus=False) as dialog:
            dialog.border_title = Text(f'{self._command.name} {one_line(self._behavior.name)}')
            dialog.border_subtitle = f'Enter: {self._command.name}; Tab: next field; Up Down: choices; Esc leaves'
            if self._behavior.description:
                yield Label(Text(one_line(self._behavior.description)), classes='dim')
            for field in self._fields:
                yield Label(Text(field.told))
                yield field
            if self._behavior.machine:
                yield Label(Text('machine, as it was synthesized (PgUp PgDn scroll):'), classes='dim')
            if machine := machine_text_lines(self._behavior):
                yield Label(Text('\n'.join(machine), TONES[tone_of(machine[0])]))

    def on_mount(self) -> None:
        """Focus the first field."""
        if self._fields:
            self.set_focus(self._fields[0])

    def action_send(self) -> None:
        """Close the form with the line; if a value is invalid, show the reason and focus its field."""
        is_untouched = self.focused in (None, *self._fields[:1]) and not any(field.is_changed for field in self._fields)
        pressed_at, self._pressed_at = self._pressed_at, self._clock.now()
        if is_untouched and self._pressed_at - pressed_at < BURST_SECONDS:
            self.query_one('.dialog').border_subtitle = Text(f'just opened: Enter again: {self._command.name}', 'bold')
            return
        words = [self._command.name, self._behavior.name]
        for field in self._fields:
            try:
                words += field.words()
            except ConsoleError as error:
                self.set_focus(field)
                self.query_one('.dialog').border_subtitle = Text(one_line(str(error)), 'bold')
                return
        self.dismiss(shlex.join(words))


class ReadingDialog(ModalScreen[None]):
    """A text to read; lines that are too long are folded."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape,enter,q,question_mark', 'dismiss(None)', 'leave', priority=True),
    ]

    def __init__(self, title: str, text: Sequence[str]) -> None:
        super().__init__()
        self._title = title
        self._text = text

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with VerticalScroll(classes='dialog wide'):
            yield Label(Text(f'{self._title}  (up, down scroll; Esc leaves)'))
            yield Pane()

    def on_mount(self) -> None:
        """Focus the text, so that it receives the keys for scrolling."""
        self.set_focus(self.query_one(VerticalScroll))

    def on_pane_resized(self) -> None:
        """Fold the lines to the current width."""
        for scroll in self.query(VerticalScroll):  # none if the dialog was closed meanwhile
            columns = scroll.scrollable_content_region.width
            scroll.query_one(Pane).show(styled(folded(self._text, columns)))


class MapImage(ModalScreen[None]):
    """The map as an image, redrawn when it has changed. ``widget`` is the class of the image widget."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape,enter,q', 'dismiss(None)', 'leave', priority=True),
    ]

    def __init__(self, widget: ImageWidget, view: Callable[[], View]) -> None:
        super().__init__()
        self._widget = widget
        self._view = view
        self._drawn: object = None

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with Vertical(classes='dialog image'):
            yield Label(id='where')
            yield self._widget()

    def on_mount(self) -> None:
        """Draw the image, and again every IMAGE_SECONDS."""
        self.draw()
        self.set_interval(IMAGE_SECONDS, self.draw)

    def draw(self) -> None:
        """Draw the current map, unless it has not changed since it was last drawn."""
        view = self._view()
        shown = view.drawn, view.robot_pose, view.places, view.live
        if shown != self._drawn:
            self._drawn = shown
            age = '' if view.live else 'NOT OF NOW  '
            self.query_one('#where', Label).update(Text(f'{age}{where_text(view)}  (Esc leaves)'))
            self.query_one(self._widget).image = map_image(view)


def folded(text: Sequence[str], columns: int) -> list[str]:
    """Fold the lines into rows of at most ``columns`` cells. Align continuations with the last column of their line."""
    rows: list[str] = []
    for line in text:
        begins = [found.end() for found in re.finditer(r'^ +|  +(?=\S)', line[: columns // 2])]
        indent = ' ' * (begins[-1] if begins else 4)
        rows += fold(line, columns, MOST_ROWS, indent)
    return rows


# The list of robots: one line each, the most urgent first, filtered by the typed text.

KEYS_OF_OVERVIEW: Final = 'type to find  Up Down mark  Enter goes there  Tab the most urgent  ! F8 STOP  Esc leaves'

PAGE: Final = 10
"""Number of robots that PgUp and PgDn move by."""


class Overview(ModalScreen[str | None]):
    """The list of robots; returns the name of the chosen one, or None.

    The mark stays at its robot when the order of the list changes. Typing marks the robot that matches, if it is the
    only one. The keys of the list have priority, so that a key typed quickly after Enter is for the chosen robot and
    not for the previous one.
    """

    CSS = 'Overview { align: left top; } Overview Pane { width: 100%; height: 1fr; }'
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'leave', 'leave', priority=True),
        Binding('tab', 'most_urgent', 'go to the most urgent', priority=True),
        Binding('enter', 'choose', 'go there', priority=True),
        *(
            Binding(key, f'step({by})', key, priority=True)
            for key, by in (
                ('down', 1),
                ('up', -1),
                ('pagedown', PAGE),
                ('pageup', -PAGE),
                ('end', sys.maxsize),
                ('home', -sys.maxsize),
            )
        ),
    ]

    def __init__(self, fleet: Fleet, own: str) -> None:
        super().__init__()
        self._fleet = fleet
        self._robots = fleet.overview
        self._own = own
        self._marked = own
        self._filtered_by = ''

    @property
    def chosen(self) -> str:
        """Name of the marked robot, or else of the one on the screen."""
        self._filter()
        return self._marked or self._own

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        yield FindField()
        yield Pane()

    def on_mount(self) -> None:
        """Focus the filter, so that it receives typed keys."""
        self.set_focus(self.query_one(FindField))

    def on_pane_resized(self) -> None:
        """Draw for the new size."""
        self.draw()

    def on_input_changed(self) -> None:
        """Show the robots that match the typed text."""
        self.draw()

    def _filter(self) -> list[RobotOverview]:
        """Return the robots that match the typed text. If it has changed, mark the only match, or else none."""
        typed = self.query_one(FindField).value.strip().lstrip('/').casefold()
        robots = [one for one in self._robots() if typed in one.name.casefold()]
        if typed != self._filtered_by:
            self._filtered_by = typed
            named = [one.name for one in robots if typed == one.name.lstrip('/').casefold()]
            fitting = named or [one.name for one in robots]
            self._marked = '' if not typed or len(fitting) > 1 else next(iter(fitting), '')
        if all(one.name != self._marked for one in robots):
            self._marked = ''
        return robots

    def draw(self, told: str = '') -> None:
        """Draw the robots in their current state, and ``told`` in the last row instead of the keys."""
        for field in self.query(FindField):  # none while the dialog opens or closes
            robots, columns, rows = self._filter(), self.size.width, self.size.height
            needing = sum(one.needs_operator for one in self._robots())
            unreachable = sum(one.is_unreachable for one in self._robots())
            beside = [f'unreachable: {unreachable}'] * bool(unreachable) + left_out_text(self._fleet.left_out)
            counts = '  '.join([f'robots: {len(robots)}', f'need you: {needing}', *beside])
            head = f' {counts}  (type to find)'
            field.placeholder = cut(head, columns - 1)
            lines: list[str] = []
            place = 0
            for number, robot in enumerate(robots):
                line, is_marked = robot_line(robot), robot.name == self._marked
                place = number if is_marked else place
                lines.append(cut(toned(f'{">" if is_marked else " "} {line}', line), columns))
            shown = window(lines, place, rows - 2)
            shown += [''] * (rows - 2 - len(shown))
            last = Line(told, Tone.WARNING) if told else Line(KEYS_OF_OVERVIEW, Tone.DIM)
            for pane in self.query(Pane):
                pane.show(styled([*shown, cut(last, columns)]))

    def action_step(self, by: int) -> None:
        """Move the mark."""
        names = [one.name for one in self._filter()]
        if names:
            place = names.index(self._marked) if self._marked in names else -1 if by > 0 else len(names)
            self._marked = names[min(max(0, place + by), len(names) - 1)]
            self.draw()

    def action_choose(self) -> None:
        """Close the list with the marked robot; if none is marked, show why."""
        fitting = self._filter()
        if self._marked:
            self.dismiss(self._marked)
        elif fitting:
            self.draw('no robot is marked: type more of its name, or mark one with Up and Down')
        else:
            self.draw('no robot has such a name')

    def action_most_urgent(self) -> None:
        """Close the list with the most urgent other robot that needs its operator, or with None if none does."""
        needing = (one.name for one in self._robots() if one.needs_operator and one.name != self._own)
        self.dismiss(next(needing, None))

    def action_leave(self) -> None:
        """Clear the typed text, or else close the list."""
        field = self.query_one(FindField)
        if field.value:
            field.value = ''
            self.draw()
        else:
            self.dismiss(None)
