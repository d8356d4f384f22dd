# SPDX-License-Identifier: BSD-3-Clause
"""Make docs/images/operator_page.png, and its dark form: the operator's page in a browser while a robot drives.

The second demonstration runs in tmux and serves the page. The program gives a goal and confirms the plan there, and
takes the picture in headless Chromium when the robot is on its way.

It needs tmux, selenium, Chromium and its driver.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from target import target

IMAGES: Final = Path(__file__).parents[1] / 'images'
PICTURES: Final = {'light': 'operator_page.png', 'dark': 'operator_page_dark.png'}
SIZE: Final = (1400, 950)
DEADLINE: Final = 180.0  # seconds for each awaited event
TMUX: Final = ['tmux', '-L', 'flexbt-operator-page', '-f', '/dev/null']
FLAGS: Final = (
    'headless no-sandbox disable-gpu no-first-run disable-background-networking disable-dev-shm-usage '
    'force-prefers-reduced-motion'
)


def wait_for(found: Callable[[], Any], what: str) -> Any:
    """Wait until ``found`` returns something, and return it. Raises TimeoutError."""
    end = time.monotonic() + DEADLINE
    while not (value := found()):
        if time.monotonic() > end:
            raise TimeoutError(f'{what}: not within {DEADLINE:g} s')
        time.sleep(0.1)
    return value


def tmux(*words: str) -> str:
    return subprocess.run([*TMUX, *words], check=True, capture_output=True, text=True).stdout


def address() -> str:
    """Return where the demonstration serves its page, as soon as it has said so."""
    pattern = re.compile(r'http://127\.0\.0\.1:\d+/\S*')
    found = wait_for(lambda: pattern.search(tmux('capture-pane', '-p', '-S', '-')), 'the page')
    return str(found[0])


class Page:
    """The page in a browser."""

    def __init__(self, url: str, size: tuple[int, int] = SIZE) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = str(shutil.which('chromium') or shutil.which('google-chrome'))
        for flag in [*FLAGS.split(), 'window-size={},{}'.format(*size)]:
            options.add_argument(f'--{flag}')
        self.driver = webdriver.Chrome(options=options, service=Service(shutil.which('chromedriver')))
        wait_for(lambda: self._opens(url), 'the server of the page')
        self.run('localStorage.setItem("flexbt-operator", JSON.stringify("ann"))')  # it asks for no name then
        self.driver.refresh()

    def _opens(self, url: str) -> bool:
        with contextlib.suppress(WebDriverException):
            self.driver.get(url)
            return True
        return False

    def run(self, script: str, *words: str) -> Any:
        """Run a script in the page."""
        return self.driver.execute_script(script, *words)

    def wait_text(self, id: str, pattern: str) -> None:
        """Wait until the text of an element matches."""
        script = 'return document.getElementById(arguments[0]).innerText'
        wait_for(lambda: re.search(pattern, self.run(script, id)), f'{pattern!r} in {id!r}')

    def answer(self, text: str) -> None:
        """Enter a command line, as an operator types it."""
        self.run(
            'const line = document.getElementById("line"); line.value = arguments[0];'
            'document.getElementById("line-form").requestSubmit()',
            text,
        )

    def resize(self, size: tuple[int, int]) -> None:
        """Show the page as on a screen of this size, which may be smaller than a window can be."""
        metrics = {'width': size[0], 'height': size[1], 'deviceScaleFactor': 2, 'mobile': True}
        self.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', metrics)

    def part(self, selector: str, file: Path) -> None:
        """Save a picture of an element."""
        self.driver.find_element('css selector', selector).screenshot(str(file))

    def picture(self, scheme: str, file: Path) -> None:
        """Save a picture in a colour scheme, light or dark."""
        media = {'features': [{'name': 'prefers-color-scheme', 'value': scheme}]}
        self.driver.execute_cdp_cmd('Emulation.setEmulatedMedia', media)
        self.run('return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))')
        self.driver.save_screenshot(str(file))


def main(directory: Path) -> None:
    """Operate the demonstration and write the pictures."""
    tmux('new-session', '-d', '-x', '160', '-y', '40', 'demo --demo 2 --speed 0.5')
    try:
        page = Page(address())
        try:
            page.wait_text('decision-line', 'Where shall the robot go')
            page.answer('kitchen')
            page.wait_text('decision-line', 'Is the path good')
            wait_for(lambda: page.run('return document.querySelector("#machine .graph") !== null'), 'the machine')
            wait_for(lambda: page.run('return !document.querySelector("[data-choice=done]").disabled'), 'the answer')
            time.sleep(1.0)  # an answer that comes at once is ignored
            page.run('document.querySelector("[data-choice=done]").click()')
            wait_for(lambda: page.run('return document.querySelector("#trees .graph") !== null'), 'the tree')
            page.wait_text('pose', r'x [2-9]\.\d+ m')
            for scheme, name in PICTURES.items():
                page.picture(scheme, directory / name)
        finally:
            page.driver.quit()
    finally:
        subprocess.run([*TMUX, 'send-keys', 'q'], check=False)
        time.sleep(0.5)
        subprocess.run([*TMUX, 'send-keys', 'q'], check=False)
        end = time.monotonic() + 30.0
        while subprocess.run([*TMUX, 'has-session'], capture_output=True).returncode == 0 and time.monotonic() < end:
            time.sleep(0.1)


if __name__ == '__main__':
    main(target(__doc__, IMAGES))
