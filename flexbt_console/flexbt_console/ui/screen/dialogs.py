# SPDX-License-Identifier: BSD-3-Clause
"""What comes over the panes: a list to choose from, the form of a behavior, a text to read. Escape leaves each.

The keys that move or end one have priority, and its first field has the focus at once: so keys are dealt with in the
order in which they were typed, however quickly, and none of them reaches what was there before or comes after.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Final

from rich.text import Text
from textual.actions import SkipAction
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Input, Label, OptionList, Select
from textual.widgets.option_list import Option

from flexbt_console.commands import CommandSpec
from flexbt_console.mirror import Behavior, View
from flexbt_console.pictures import fold, map_image, where_text
from flexbt_console.present import Line, tone_of
from flexbt_core.values import one_line

from .panes import Pane, styled

if TYPE_CHECKING:
    from .terminal_images import ImageWidget

IMAGE_SECONDS: Final = 2.0
"""From one image of the map to the next: each is some ten kilobytes."""

MOST_ROWS: Final = 100
"""Of one line."""

CHOICES: Final = {'bool': ('false', 'true')}
"""The values of a type that has few."""

RESTRICTED: Final = {'int': r'[+-]?\d*', 'float': r'[+-]?(\d*\.?\d*([eE][+-]?\d*)?|i?n?f?|n?a?n?)'}
"""What may be typed of a type, as far as it has come."""


class ChoiceList(ModalScreen[int | None]):
    """A list; gives the number of the line that was chosen, from 0 on, or None."""

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

    def __init__(self, title: str, lines: Sequence[str]) -> None:
        """The title is a text of our own; the lines may be of others."""
        super().__init__()
        self._title = title
        self._lines = lines
        self._marked = 0

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with Vertical(classes='dialog') as dialog:
            dialog.border_title, dialog.border_subtitle = self._title, 'Enter chooses, Esc leaves'
            yield OptionList(*(Option(self._row(number, 0)) for number in range(len(self._lines))))

    def on_mount(self) -> None:
        """The list has the keys."""
        self.set_focus(self.query_one(OptionList))

    def on_resize(self) -> None:
        """The line under the cursor stays to be seen."""
        self.query_one(OptionList).scroll_to_highlight()

    def on_option_list_option_highlighted(self, event: OptionList.OptionHighlighted) -> None:
        """The line under the cursor has a mark, too: a colour alone is not seen everywhere."""
        for number in {self._marked, event.option_index}:
            event.option_list.replace_option_prompt_at_index(number, self._row(number, event.option_index))
        self._marked = event.option_index

    def _row(self, number: int, marked: int) -> Text:
        return Text(f'{">" if number == marked else " "} {one_line(self._lines[number])}')

    def action_move(self, move: str) -> None:
        """Move in the list, as it moves by itself; not by a page while there is no room for any line."""
        options = self.query_one(OptionList)
        if options.scrollable_content_region.height > 0:
            getattr(options, f'action_{move}')()

    def action_choose(self) -> None:
        """The line under the cursor."""
        self.dismiss(self.query_one(OptionList).highlighted)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """A line was clicked."""
        self.dismiss(event.option_index)


class StartForm(ModalScreen[str | None]):
    """The parameters of a behavior, and the options of the command; gives the line that starts it, or None.

    ``command`` is ``start`` or ``switch``.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'leave', 'leave', priority=True),
        Binding('enter', 'enter', 'start', priority=True),
        Binding('ctrl+s', 'send', 'start', priority=True),
        Binding('tab', 'app.focus_next', 'next', priority=True),
        Binding('shift+tab', 'app.focus_previous', 'previous', priority=True),
    ]

    def __init__(self, command: CommandSpec, behavior: Behavior) -> None:
        super().__init__()
        self._command = command
        self._behavior = behavior

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        with VerticalScroll(classes='dialog'):
            yield Label(Text(f'{self._command.name} {one_line(self._behavior.name)}'))
            if self._behavior.description:
                yield Label(Text(one_line(self._behavior.description)), classes='dim')
            for number, parameter in enumerate(self._behavior.parameters):
                told = f'{one_line(parameter.name)} ({one_line(parameter.type)})  {one_line(parameter.description)}'
                yield Label(Text(told))
                texts = parameter.choices or CHOICES.get(parameter.type, ())
                if texts:
                    first = parameter.default if parameter.default in texts else texts[0]
                    choices = [(one_line(text), text) for text in texts]
                    yield Select(choices, value=first, allow_blank=False, id=f'parameter-{number}')
                else:
                    restricted = RESTRICTED.get(parameter.type)
                    yield Input(parameter.default, id=f'parameter-{number}', restrict=restricted)
            yield Label(Text(f'options  {self._command.options_hint}'))
            yield Input(id='options')
            yield Label(Text(f'Enter or Ctrl-S: {self._command.name}; Tab: the next field; Esc leaves'), classes='dim')

    def on_mount(self) -> None:
        """The first field is ready to be typed into."""
        fields = self.query('Input, Select')
        if fields:
            self.set_focus(fields.first())

    async def action_leave(self) -> None:
        """Leave the values of a field that are open, or else the form."""
        opened = [field for field in self.query(Select) if field.expanded]
        for field in opened:
            await field.query_one(OptionList).run_action('dismiss')
        if not opened:
            self.dismiss(None)

    def action_enter(self) -> None:
        """Give the line, except where Enter opens the values of a field, or chooses one of them."""
        field = self.focused
        if isinstance(field, OptionList):
            raise SkipAction
        if isinstance(field, Select):
            field.action_show_overlay()
            self.set_focus(field.query_one(OptionList))
        else:
            self.action_send()

    def action_send(self) -> None:
        """Give the line."""
        words = [self._command.name, self._behavior.name]
        for number, parameter in enumerate(self._behavior.parameters):
            field: Any = self.query_one(f'#parameter-{number}')
            if field.value != parameter.default:
                words.append(f'{parameter.name}={field.value}')
        self.dismiss(f'{shlex.join(words)} {self.query_one("#options", Input).value}'.strip())


class ReadingDialog(ModalScreen[None]):
    """Lines to be read; those that are too long are folded."""

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
        """The text has the keys that scroll."""
        self.set_focus(self.query_one(VerticalScroll))

    def on_pane_resized(self) -> None:
        """Fold for the width that there is now."""
        for scroll in self.query(VerticalScroll):  # not any more, when it was closed meanwhile
            columns = scroll.scrollable_content_region.width
            scroll.query_one(Pane).show(styled(folded(self._text, columns)))


class MapImage(ModalScreen[None]):
    """The map as an image, drawn anew when it has changed; ``widget`` shows images, ``view`` gives what is known."""

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
        """It is drawn at once."""
        self.draw()
        self.set_interval(IMAGE_SECONDS, self.draw)

    def draw(self) -> None:
        """Draw what is known now, unless that is on the screen."""
        view = self._view()
        robot = view.snapshot.robot_pose if view.snapshot else None
        shown = view.surroundings, robot, view.places, view.live
        if shown != self._drawn:
            self._drawn = shown
            age = '' if view.live else 'NOT OF NOW  '
            self.query_one('#where', Label).update(Text(f'{age}{where_text(view)}  (Esc leaves)'))
            self.query_one(self._widget).image = map_image(*shown[:3])


def folded(text: Sequence[str], columns: int) -> list[str]:
    """The lines in rows of so many cells; where a line goes on, it stands under where its last part began."""
    rows: list[str] = []
    for line in text:
        begins = [found.end() for found in re.finditer(r'^ +|  +(?=\S)', line[: columns // 2])]
        indent = ' ' * (begins[-1] if begins else 4)
        rows += [Line(row, tone_of(line)) for row in fold(line, columns, MOST_ROWS, indent)]
    return rows
