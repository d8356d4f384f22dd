# SPDX-License-Identifier: BSD-3-Clause
"""axe-core finds nothing in the operator's page, with and without a decision, in light and in dark."""

from __future__ import annotations

import pytest
from web_support import PLAN, WebRobot, served

from flexbt_testing.browser import NEEDS_AXE, NEEDS_BROWSER, Browser

pytestmark = [NEEDS_BROWSER, NEEDS_AXE]


@pytest.mark.parametrize('decides', [True, False])
def test_axe_finds_nothing_in_the_page_of_a_robot(browser: Browser, decides: bool) -> None:
    robot = WebRobot(is_drawn=True)
    if decides:
        robot.show(PLAN)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.run('return document.querySelector("#machine .graph") !== null') or not decides)
        browser.run('for (const one of document.querySelectorAll("details")) one.open = true')
        assert browser.violations() == []
        browser.press('?')
        browser.until(lambda: browser.run('return document.getElementById("dialog").open'))
        assert browser.violations() == []
