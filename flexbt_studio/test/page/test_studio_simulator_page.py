# SPDX-License-Identifier: BSD-3-Clause
"""A story at the simulated robot: start it, run the open tree on it, shut a door, drop an obstacle, and stop it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from studio_page import StudioPage, held, served

from flexbt_testing.browser import NEEDS_BROWSER

pytestmark = NEEDS_BROWSER

WORLD = """
plan:
  rooms:
    - {from: [0, 0], to: [4, 4]}
    - {from: [4, 0], to: [8, 4]}
  openings:
    - {at: [4, 2], width: 1.2}
robots:
  courier: {model: burger, pose: [1, 2, 0]}
doors:
  gate: {from: [4, 1.4], to: [4, 2.6], automatic: true}
places:
  far: [6.5, 2, 0]
"""
TREE = """<root BTCPP_format="4" main_tree_to_execute="Go">
  <BehaviorTree ID="Go">
    <Sequence><ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/></Sequence>
  </BehaviorTree>
</root>
"""
_CHOOSE = 'arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event("change"))'
_DRAWN = """
const {width, height} = arguments[0];
return new Set(new Uint32Array(arguments[0].getContext('2d').getImageData(0, 0, width, height).data.buffer)).size;
"""


def test_a_tree_drives_a_simulated_robot_until_a_door_is_shut(
    page: StudioPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'world.yaml').write_text(WORLD)
    (tmp_path / 'go.xml').write_text(TREE)

    def part(id: str) -> Any:
        return page.driver.find_element(By.ID, f'sim-{id}')

    def press(id: str) -> None:
        page.run('arguments[0].click()', part(id))

    def is_shown(id: str) -> bool:
        return bool(page.run('return arguments[0].checkVisibility()', part(id)))

    with served(tmp_path, None) as port:
        page.open(port, 'go.xml')
        page.run('document.querySelector("#simulator > summary").click()')
        page.until(lambda: 'world.yaml' in page.run('return arguments[0].innerHTML', part('world')))
        assert not is_shown('view')
        page.run(_CHOOSE, part('world'), 'world.yaml')
        page.run(_CHOOSE, part('speed'), '5')
        press('start')
        page.until(lambda: is_shown('view'))
        assert 'SIMULATION' in page.text('sim-view') and 'no real robot moves' in page.text('simulator')
        page.until(lambda: page.run(_DRAWN, part('map')) > 3)  # walls, the free floor, the robot
        # The costmaps of navigation are drawn while their layers are on, with a legend.
        assert 'occupied' not in page.text('sim-view')
        plain = page.run(_DRAWN, part('map'))
        page.run('for (const one of document.querySelectorAll("#sim-view .layers input")) one.click()')
        page.until(lambda: 'occupied' in page.text('sim-view') and 'waiting' not in page.text('sim-view'))
        page.until(lambda: page.run(_DRAWN, part('map')) > plain + 10)
        layered = page.run(_DRAWN, part('map'))
        page.run('for (const one of document.querySelectorAll("#sim-view .layers input")) one.click()')
        page.until(lambda: page.run(_DRAWN, part('map')) < layered and 'occupied' not in page.text('sim-view'))

        page.run(_CHOOSE, part('goal'), 'far')
        press('run')
        page.until(lambda: page.run('return document.querySelector("#picture .st-running") !== null'))
        page.until_told('the tree Go has ended: SUCCESS')

        page.run(_CHOOSE, part('what'), '0')
        assert page.run('return arguments[0].value', part('which')) == 'gate'
        with held(monkeypatch, 'simulator_what_if', is_done=True) as asked:
            press('happen')
            assert asked.wait(60.0)
            page.run(_CHOOSE, part('what'), '1')  # the next one
        page.until_told('gate door is shut and jams')
        page.run(_CHOOSE, part('goal'), '1 2 0')
        press('run')
        page.until_told('the tree Go has ended: FAILURE')

        press('drop')
        for count in range(7):
            ActionChains(page.driver).move_to_element_with_offset(part('map'), 20 * count - 60, 40).click().perform()
            page.until_told(f'dropped{f"_{count}" if count else ""} dropped')
        part('map').send_keys('\ue00c')  # Escape: of the map, which is no longer aimed at
        page.until(lambda: page.run('return arguments[0].ariaPressed', part('drop')) == 'false')
        assert page.run('return document.getElementById("live").ariaPressed') == 'true'
        page.until(lambda: not page.run('return arguments[0].disabled', part('take')))
        press('take')
        page.until(lambda: re.search('dropped_[4-6] removed', page.told))  # one after the other, however many there are

        page.run('document.getElementById("live").focus()')
        press('start')
        page.until(lambda: not is_shown('view'))
        assert page.run('return document.getElementById("live").ariaPressed') == 'false'
        assert page.text('sim-start') == 'Start'
