# SPDX-License-Identifier: BSD-3-Clause
"""A real browser at a page."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flexbt_testing.waiting import wait_until

selenium = pytest.importorskip('selenium', reason='selenium drives the browser: pip install selenium')
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
DRIVER = shutil.which('chromedriver')
DEADLINE = 90.0
FLAGS = (
    'headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking disable-component-update '
    'disable-sync disable-dev-shm-usage force-prefers-reduced-motion window-size=1400,950'
)
NEEDS_BROWSER = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason='no Chromium with its driver: apt install chromium chromium-driver'
)


class Browser:
    """A browser at a page."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def until(self, done: Callable[[], object]) -> Any:
        """Wait until that is so, and give it."""
        return wait_until(done, lambda: self.driver.find_element(By.TAG_NAME, 'body').text, DEADLINE)

    def text(self, id: str) -> str:
        """Return what is read at an element."""
        return str(self.driver.execute_script('return document.getElementById(arguments[0]).innerText', id))

    def until_text(self, id: str, text: str) -> None:
        """Wait until that is read there."""
        self.until(lambda: text in self.text(id))

    def run(self, script: str, *words: Any) -> Any:
        """Run a script in the page."""
        return self.driver.execute_script(script, *words)

    def press(self, *keys: str) -> None:
        """Press keys, wherever the focus is."""
        ActionChains(self.driver).send_keys(*keys).perform()

    def until_it_may_be_answered(self) -> None:
        """Wait for as long as what has just come up takes no answer, in the time of the page."""
        shown = self.run('return performance.now()')
        self.until(lambda: self.run('return performance.now()') > shown + 400.0)

    @contextlib.contextmanager
    def emulated(self, width: int, height: int, *, mobile: bool = False, **media: str) -> Iterator[None]:
        """Show the page in a window of this size, with these media features, during a ``with`` block."""
        size = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': mobile}
        features = [{'name': name.replace('_', '-'), 'value': value} for name, value in media.items()]
        self.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', size)
        self.driver.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': mobile})
        self.driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': features})
        try:
            yield
        finally:
            self.driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})
            self.driver.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': False})
            self.driver.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})

    def until_live(self) -> None:
        """Wait for a page that is live."""
        self.until_text('link', 'LIVE')
        self.until(lambda: self.run('return document.body.classList.contains("blind")') is False)
