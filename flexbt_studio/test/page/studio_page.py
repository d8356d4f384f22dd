# SPDX-License-Identifier: BSD-3-Clause
"""The studio's page in a browser, and its server on a thread."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import pytest

from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.server import serving
from flexbt_studio.server.session import Page, Sessions
from flexbt_studio.server.web_server import StudioServer
from flexbt_studio.server.workbench import Workbench
from flexbt_testing.browser import Browser
from flexbt_testing.waiting import DEADLINE

TOKEN = 'a-token'  # noqa: S105

_TEXT = """
const place = document.getElementById('text');
if (!place.shadowRoot) return place.querySelector('textarea').value;
return [...place.shadowRoot.querySelectorAll('.cm-line')].map((line) => line.textContent).join('\\n');
"""


@contextlib.contextmanager
def served(folder: Path, editor: Path | None, port: int = 0) -> Iterator[int]:
    """Serve the studio of a folder on a thread of its own, and provide the port."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    application = StudioServer(Workbench(folder), Access('127.0.0.1', TOKEN), editor).application()
    serves = serving(application, '127.0.0.1', port)
    used = asyncio.run_coroutine_threadsafe(serves.__aenter__(), loop).result(60.0)
    try:
        yield used
    finally:
        asyncio.run_coroutine_threadsafe(serves.__aexit__(None, None, None), loop).result(60.0)
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


@contextlib.contextmanager
def held(
    monkeypatch: pytest.MonkeyPatch, method: str, *, is_done: bool = False, passing: int = 0
) -> Iterator[threading.Event]:
    """Let the requests of a method wait until the end of the ``with`` block, or their answers if ``is_done``.
    So many pass before.

    Provide what is set when the first one has come.
    """
    answered, asked, goes_on = Sessions._result, threading.Event(), threading.Event()
    passed = chain(repeat(True, passing), repeat(False))

    async def waiting(self: Sessions, page: Page, called: str, arguments: dict[str, Any]) -> Any:
        if called != method or next(passed):
            return await answered(self, page, called, arguments)
        result = await answered(self, page, called, arguments) if is_done else None
        asked.set()
        await asyncio.to_thread(goes_on.wait, DEADLINE)
        return result if is_done else await answered(self, page, called, arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Sessions, '_result', waiting)
        try:
            yield asked
        finally:
            goes_on.set()


class StudioPage(Browser):
    """A browser at the studio."""

    def open(self, port: int, file: str, more: str = '') -> None:
        """Open the page with a file, and wait for its graph."""
        self.driver.get('about:blank')  # another fragment alone would load nothing
        self.driver.get(f'http://127.0.0.1:{port}/#token={TOKEN}&file={file}{more}')
        self.until(lambda: self.selected)
        self.until(lambda: self.focused == self.selected)

    def go(self, file: str, *, times: int = 1) -> None:
        """Show a file of the list. Press so many times at once, before any answer comes."""
        script = '[...document.querySelectorAll("#files button")].find((one) => one.textContent === arguments[0])'
        self.until(lambda: self.run(f'return {script} !== undefined', file))  # the list comes after the connection
        self.run(f'const row = {script}; for (let n = 0; n < arguments[1]; n++) row.click()', file, times)

    def tab(self, file: str) -> None:
        """Show an open file."""
        script = '[...document.querySelectorAll("#tabs button")].find((one) => one.title === arguments[0])'
        self.run(f'{script}.click()', file)

    @property
    def selected(self) -> str:
        """Path of the selected item of the graph; '' if there is none."""
        return str(self.run('return document.querySelector("#picture [aria-selected=true]")?.dataset.path ?? ""'))

    @property
    def focused(self) -> str:
        """Path of the item that has the focus, or the identifier of another element."""
        return str(self.run('const one = document.activeElement; return one.dataset.path ?? one.id'))

    @property
    def told(self) -> str:
        """What the live region says."""
        return self.text('told')

    @property
    def shown_text(self) -> str:
        """The text in the text pane: all lines that it shows."""
        return str(self.run(_TEXT))

    @property
    def invalid(self) -> list[str]:
        """Paths of the items with problems."""
        script = 'return [...document.querySelectorAll("#picture [aria-invalid]")].map((one) => one.dataset.path)'
        found: Any = self.run(script)
        return list(found)

    def until_told(self, text: str) -> None:
        """Wait until the live region says this."""
        self.until(lambda: text in self.told)

    def until_selected(self, path: str) -> None:
        """Wait until an item is selected and has the focus."""
        self.until(lambda: (self.selected, self.focused) == (path, path))

    def until_sheet(self, text: str) -> None:
        """Wait until a dialog to read is open and contains a text."""
        self.until(lambda: self.run('return document.getElementById("sheet").open') and text in self.text('sheet'))

    def write(self) -> None:
        """Move the focus into the text."""
        script = (
            'const place = document.getElementById("text");'
            '(place.shadowRoot?.querySelector(".cm-content") ?? place.querySelector("textarea")).focus()'
        )
        self.run(script)

    def click(self, path: str) -> None:
        """Click an item of the graph."""
        self.run(
            'document.querySelector(`#picture [data-path="${CSS.escape(arguments[0])}"] > .box`)'
            '.dispatchEvent(new MouseEvent("click", {bubbles: true}))',
            path,
        )
        self.until_selected(path)

    def tab_to(self, id: str) -> None:
        """Press Tab until an element has the focus. Raises AssertionError if it never gets it."""
        for _ in range(60):
            if self.focused == id:
                return
            self.press('\ue004')
        raise AssertionError(f'Tab does not lead to {id!r}, but to {self.focused!r}')

    def has_changes(self) -> bool:
        """Return whether the head shows unsaved changes."""
        return self.text('difference') == 'Unsaved changes'
