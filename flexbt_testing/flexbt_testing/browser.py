# SPDX-License-Identifier: BSD-3-Clause
"""A real browser at a page, for tests: Chromium without a window, driven by Selenium."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from .waiting import wait_until

_BROWSERS: Final = ('chromium-headless-shell', 'chromium', 'chromium-browser', 'google-chrome')
"""Commands of browsers. The first one, which has no windows at all, takes half of the processor time of the others."""
CHROMIUM: Final = next(filter(None, map(shutil.which, _BROWSERS)), None)
DRIVER: Final = shutil.which('chromedriver')
BROWSER_SECONDS: Final = 90.0
"""Time limit for what a page shows, s; long enough for a busy machine."""
_FLAGS: Final = (
    'headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking disable-component-update '
    'disable-sync disable-dev-shm-usage force-prefers-reduced-motion window-size=1400,950'
)

NEEDS_BROWSER: Final = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason='no Chromium with its driver: apt install chromium-headless-shell chromium-driver'
)
AXE: Final = Path(sys.prefix, 'share', 'flexbt_studio', 'node_modules', 'axe-core', 'axe.min.js')
"""The checker of accessibility axe-core, which ``make setup`` gets with the text editor of the studio."""
NEEDS_AXE: Final = pytest.mark.skipif(
    not AXE.is_file(), reason='axe-core is not installed: install npm, then make setup'
)
_OF_COLOURS: Final = ('color-contrast', 'link-in-text-block')
"""Rules of axe-core that the colour scheme of the page has to do with."""
_RUN_AXE: Final = """
const [rules, done] = arguments;
const first = (node) => node.failureSummary.split('\\n')[1].trim();
const told = (rule, node) => `${rule.id}: ${node.target.flat().join(' ')}: ${first(node)}`;
axe.run(document, {resultTypes: ['violations'], ...(rules.length ? {runOnly: rules} : {})}).then(
  ({violations}) => done(violations.flatMap((rule) => rule.nodes.map((node) => told(rule, node)))),
  (error) => done([String(error)]),
);
"""


@contextlib.contextmanager
def started_browser(profile: Path) -> Iterator[Any]:
    """Provide Selenium's driver of a new browser whose profile is in this folder. Skip the test without Selenium."""
    pytest.importorskip('selenium', reason='selenium drives the browser: pip install selenium')
    from selenium import webdriver
    from selenium.common.exceptions import WebDriverException
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in _FLAGS.split():
        options.add_argument(f'--{flag}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    profile.mkdir(parents=True, exist_ok=True)
    service = Service(str(DRIVER), env={**os.environ, 'TMPDIR': str(profile)})  # the first browser takes no folder
    driver = webdriver.Chrome(options=options, service=service)
    driver.set_script_timeout(BROWSER_SECONDS)
    try:
        yield driver
    finally:
        with contextlib.suppress(WebDriverException):  # it ends before it answers; the driver would end only its script
            driver.execute_cdp_cmd('Browser.close', {})
        driver.quit()


class Browser:
    """A browser at a page."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def until(self, done: Callable[[], object]) -> Any:
        """Wait until the condition is true, and return its value."""
        return wait_until(
            done, lambda: self.run('return `${location.href}\\n${document.body.innerText}`'), BROWSER_SECONDS
        )

    def text(self, id: str) -> str:
        """Return the text of an element as it is read."""
        return str(self.run('return document.getElementById(arguments[0]).innerText', id))

    def until_text(self, id: str, text: str) -> None:
        """Wait until an element contains a text."""
        self.until(lambda: text in self.text(id))

    def run(self, script: str, *words: Any) -> Any:
        """Run a script in the page, and return its result."""
        return self.driver.execute_script(script, *words)

    def press(self, *keys: str) -> None:
        """Press keys one after the other, wherever the focus is."""
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    def chord(self, *keys: str) -> None:
        """Press a key while others are held: the last one, with those before it."""
        from selenium.webdriver.common.action_chains import ActionChains

        actions = ActionChains(self.driver)
        for key in keys[:-1]:
            actions.key_down(key)
        actions.send_keys(keys[-1])
        for key in reversed(keys[:-1]):
            actions.key_up(key)
        actions.perform()

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

    def violations(self) -> list[str]:
        """Return what axe-core finds in the page as it is shown, in light and in dark: rule, element, and remedy."""
        if not self.run('return Boolean(window.axe)'):
            self.run(AXE.read_text('utf-8'))
        found = []
        for scheme, rules in (('light', ()), ('dark', _OF_COLOURS)):
            with self.emulated(1400, 950, prefers_color_scheme=scheme):
                found += [f'{scheme}: {one}' for one in self.driver.execute_async_script(_RUN_AXE, rules)]
        return found

    def until_live(self) -> None:
        """Wait until an operator's page is connected and shows the state of its robot."""
        self.until_text('link', 'LIVE')
        self.until(lambda: self.run('return document.body.classList.contains("blind")') is False)

    def until_it_may_be_answered(self) -> None:
        """Wait for as long as an operator's page takes no answer to what has just come up, in the time of the page."""
        shown = self.run('return performance.now()')
        self.until(lambda: self.run('return performance.now()') > shown + 400.0)

    def complaints(self) -> list[str]:
        """Return the errors of the page since the last call, except for connections that were lost."""
        found = [one['message'] for one in self.driver.get_log('browser') if one['level'] == 'SEVERE']
        return [text for text in found if 'ERR_CONNECTION' not in text and 'WebSocket' not in text]
