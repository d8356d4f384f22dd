# SPDX-License-Identifier: BSD-3-Clause
"""The line that is typed on the screen, a command or what is looked for in a recording, and what it may become."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from rich.text import Text
from textual.suggester import Suggester
from textual.widgets import Input

from flexbt_console.commands import find, offers
from flexbt_console.mirror import View
from flexbt_console.pictures import cut, window
from flexbt_console.present import Line, Tone
from flexbt_console.ui.interaction import Bound
from flexbt_core.values import one_line

from .pane import styled

KEYS_OF_LINE: Final = 'Enter does it  Tab completes  Up Down: another one  Esc leaves  F8 STOP'

NAME_COLUMNS: Final = 24
"""Of what an offer becomes; behind it stands what that does."""


class TypedLine(Input):
    """Belongs to the decision that was on the screen when it was begun, which is ``bound``."""

    _marked = 0

    def __init__(self, view: Callable[[], View], tell_fault: Callable[[Exception], None]) -> None:
        super().__init__(
            id='line',
            suggester=_Completing(self._completed),
            placeholder='a command, or a word of what it does; Tab completes, Esc leaves',
            select_on_focus=False,
            disabled=True,
        )
        self._view = view
        self._tell_fault = tell_fault
        self.bound = Bound(None)

    @property
    def is_open(self) -> bool:
        """Whether it is typed."""
        return self.has_class('typing')

    def open(self, text: str) -> None:
        """Begin it with this; the next key is typed into it."""
        decision = self._view().decision
        self.bound = Bound(decision.id if decision else None)
        self.disabled = False
        self.value = text
        self.cursor_position = len(text)
        self.add_class('typing')
        self.screen.set_focus(self)

    def close(self) -> str:
        """What was typed; it is gone."""
        self.remove_class('typing')
        self.disabled = True
        self.screen.set_focus(None)
        return self.value

    def watch_value(self, value: str) -> None:
        """The first of what it may become is marked."""
        self._marked = 0

    def mark(self, by: int) -> None:
        """Mark another one."""
        self._marked = min(max(0, self._marked + by), max(0, len(offers(self.value, self._view())) - 1))

    def take_marked(self) -> bool:
        """Become what was marked with the arrows, which is to be seen before it is done; False when that is typed."""
        is_another = self._marked > 0 and self._completed(self.value) != self.value
        if is_another:
            self.value = self._completed(self.value) or self.value
            self.cursor_position = len(self.value)
        return is_another

    def complete(self) -> None:
        """Become what is marked; at the end of the line, where that is seen."""
        if self.cursor_position == len(self.value):
            self.value = self._completed(self.value) or self.value
            self.cursor_position = len(self.value)

    def draw(self, view: View, columns: int, rows: int) -> Text:
        """How its command is written, and what it may become, in so many rows of so many cells."""
        words = self.value.split(' ')
        spec = find(words[0]) if len(words) > 1 else None
        usage = [Line(cut(f'  {spec.prompt_usage}', columns), Tone.DIM)] if spec is not None and spec.in_prompt else []
        found = offers(self.value, view)
        lines, refused = [], set()
        for number, (line, about, refusal) in enumerate(found):
            told = one_line(f'not possible: {refusal}' if refusal else about)
            shown = f'{">" if number == self._marked else " "} {one_line(line):{NAME_COLUMNS}}  {told}'.rstrip()
            lines.append(cut(shown, columns))
            if refusal:
                refused.add(lines[-1])
        offered = window(lines, self._marked, rows - len(usage))
        return styled([*usage, *(Line(line, Tone.DIM if line in refused else Tone.PLAIN) for line in offered)][:rows])

    def _completed(self, value: str) -> str | None:
        try:
            found = offers(value, self._view())
        except Exception as error:  # on a worker of the field, which would end the screen
            self._tell_fault(error)
            return None
        return found[min(self._marked, len(found) - 1)].line if value and found else None


class _Completing(Suggester):
    def __init__(self, complete: Callable[[str], str | None]) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._complete = complete

    async def get_suggestion(self, value: str) -> str | None:
        """See :class:`textual.suggester.Suggester`."""
        completed = self._complete(value)
        return completed if completed is not None and completed.startswith(value) else None
