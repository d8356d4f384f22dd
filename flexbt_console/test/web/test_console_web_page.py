# SPDX-License-Identifier: BSD-3-Clause
"""The page in a real browser: what is seen, what clicks and keys do, how a lost link and a lost server look."""

from __future__ import annotations

import dataclasses
import itertools
import json
import threading
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from web_support import NASTY, OTHER, PLAN, WHERE, WebRobot, WebRobots, served

from flexbt_common.values.queue_options import QueueOptions
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.mirror.records import (
    SYNTHESIZED,
    ActiveState,
    Behavior,
    BehaviorInput,
    BehaviorList,
    BehaviorParameter,
    CommandKind,
    DriveProgress,
    ExecutiveState,
    FramedPose,
    MissionQueue,
    Peer,
    QueueEntry,
    Subject,
    Subjects,
    SubjectValue,
    UserdataScope,
)
from flexbt_console.mirror.trees import MirroredStatus, StatusChange, TreeReport
from flexbt_console.ui.web.access import Access
from flexbt_testing.browser import NEEDS_BROWSER, Browser

selenium = pytest.importorskip('selenium', reason='selenium drives the browser: pip install selenium')
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

pytestmark = NEEDS_BROWSER


def test_everything_is_seen_and_nothing_of_it_is_html(browser: Browser) -> None:
    robot = WebRobot(is_drawn=True)
    robot.show(PLAN)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(
            lambda: browser.run('return document.querySelectorAll("#machine .graph, #trees .graph").length') == 2
        )
        for id, text in (
            ('runs', 'Patrol'),
            ('active', f'/Drive: follows {NASTY}'),
            ('decision-line', NASTY),
            ('decision-body', f'because WARN: {NASTY}'),
            ('decision-body', '1 done (wanted) → /Ask'),
            ('decision-body', '2 failed → ends with finished'),
            ('log', NASTY),
            ('trees', 'Drive: ▶ Wait'),
            ('pose', 'x 2.00 m'),
        ):
            browser.until_text(id, text)
        assert browser.run('return document.images.length') == 0
        classes = 'return document.querySelector(`[id="${arguments[0]}"]`).getAttribute("class")'
        assert {'lit', 'waits'} <= set(browser.run(classes, 's1').split())
        assert 'wanted' in browser.run(classes, 's1o0') and 'lit' not in browser.run(classes, 's2')
        assert 'success' in browser.run(classes, 't0n1')
        assert '▶' in browser.run('return document.querySelector(`[id="t0n2"]`).textContent')
        statuses = [MirroredStatus.FAILURE, MirroredStatus.SUCCESS, MirroredStatus.FAILURE]
        changes = [StatusChange(6.0, 1, MirroredStatus.FAILURE), StatusChange(6.0, 3, MirroredStatus.FAILURE)]
        robot.mirror.receive_tree_status(TreeReport('t', 2, statuses, changes, 6.0, finished=False, paused=False))
        browser.until(lambda: 'failure' in browser.run(classes, 't0n2'))
        assert '✗' in browser.run('return document.querySelector(`[id="t0n2"]`).textContent')
        driving = ActiveState('/Drive', progress=DriveProgress(distance=1.0))
        robot.show(PLAN, active_states=(driving,), peers=(Peer('/bt_server', alive=False, since=7.0),))
        browser.until_text('trees', 'Drive: SERVER GONE: last state')
        assert (
            browser.run('return getComputedStyle(document.querySelector("#trees .gone > .drawing")).opacity') == '0.45'
        )
        # The map has walls, the plan and the robot: the canvas has their colours.
        colours = browser.run(
            'const c = document.getElementById("map");'
            'const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;'
            'const s = new Set(); for (let i = 0; i < d.length; i += 4) s.add(`${d[i]},${d[i + 1]},${d[i + 2]}`);'
            ' return [...s]'
        )
        assert {'48,52,60', '255,255,255', '29,95,208', '179,38,30'} <= set(colours)
        # Names of places that are near each other stand beside each other, as far as there is room.
        boxes = browser.run(
            'const {RobotMap} = await import("./map.js");'
            'const context = document.createElement("canvas").getContext("2d"), boxes = [];'
            'for (const y of [50, 52, 54, 56, 58, 90]) RobotMap.prototype.label(context, "door", 99, y, 120, boxes);'
            'return boxes.map((one) => [one.left, one.right, one.top, one.bottom])'
        )
        assert len(boxes) == 5 and all(right <= 120 for _, right, _, _ in boxes)
        for (left, right, top, bottom), other in itertools.combinations(boxes, 2):
            assert right <= other[0] or other[1] <= left or bottom <= other[2] or other[3] <= top
        # So do those of robots beside those of the places where they are.
        place, robot_there = browser.run(
            'const {RobotMap} = await import("./map.js"), canvas = document.createElement("canvas");'
            'canvas.style.cssText = "width: 300px; height: 200px";'
            'document.body.append(canvas);'
            'const context = canvas.getContext("2d"), told = [];'
            'context.fillText = (text, x, y) => told.push([text, x, x + context.measureText(text).width, y]);'
            'const map = new RobotMap(canvas, document.createElement("p"), {});'
            'map.places = {kitchen: [1, 1]};'
            'map.others = [{name: "beta", x: 1, y: 1, yaw: 0, live: true}];'
            'map.draw();'
            'canvas.remove();'
            'return told'
        )
        assert (place[0], robot_there[0]) == ('kitchen', 'beta')
        assert place[2] <= robot_there[1] or robot_there[2] <= place[1] or abs(place[3] - robot_there[3]) >= 13
        # On a telephone the page scrolls, and its stop stays where it is.
        phone = {'width': 390, 'height': 844, 'deviceScaleFactor': 1, 'mobile': True}
        browser.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', phone)
        try:
            browser.until(lambda: browser.run('scrollTo(0, 1e6); return scrollY > 500'))
            under = (
                'const r = document.querySelector(".stop").getBoundingClientRect();'
                'return document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2)?.className'
            )
            assert browser.run(under) == 'stop' and browser.run('return document.body.scrollWidth') <= 390
        finally:
            browser.driver.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})


def test_the_queue_is_seen_and_its_buttons_move_remove_add_and_release(browser: Browser) -> None:
    robot = WebRobot()
    robot.show()
    entries = (
        QueueEntry(4, NASTY, QueueOptions(priority=1), running=True),
        QueueEntry(5, 'Patrol', waits_for='battery below 30%', outcome='failed', runs=1, message=NASTY),
        QueueEntry(7, 'Patrol', waits_for='a behavior runs'),
    )
    robot.mirror.receive_queue(MissionQueue('e', 3, NASTY, entries))
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('queue', 'RUNS')
        for id, text in (
            ('queue', f'4 {NASTY} RUNS'),
            ('queue', 'battery below 30%'),
            ('queue-held', f'HELD: {NASTY}'),
        ):
            browser.until_text(id, text)
        assert browser.run('return document.images.length') == 0

        def button(title: str) -> Any:
            return browser.driver.find_element(By.CSS_SELECTOR, f'#queue [title="{title}"]')

        # Only entries of the same priority change their places.
        assert [button(f'Move up entry {number}').is_enabled() for number in (4, 5, 7)] == [False, False, True]
        button('Move up entry 7').click()
        button('Remove entry 5').click()
        browser.driver.find_element(By.ID, 'queue-hold').click()
        # The page releases the hold that it shows, and no later one.
        browser.until(lambda: len(robot.sent) == 3)
        asked = [(one.kind, one.queue_number, one.queue_before) for one in robot.sent]
        assert asked == [
            (CommandKind.QUEUE_MOVE, 7, 5),
            (CommandKind.QUEUE_REMOVE, 5, 0),
            (CommandKind.QUEUE_RELEASE, 3, 0),
        ]
        robot.mirror.receive_queue(MissionQueue('e'))
        browser.until(lambda: browser.driver.find_element(By.ID, 'queue-hold').text == 'Hold')
        assert 'The queue is empty' in browser.driver.find_element(By.ID, 'queue-pane').text


def test_a_click_answers_the_decision_it_was_made_for(browser: Browser) -> None:
    robot = WebRobot()
    robot.show(PLAN)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        button = '[data-choice=failed]'
        browser.until(lambda: browser.driver.find_elements(By.CSS_SELECTOR, button))
        # The button of d1, pressed when d2 is on the page: as a late click.
        browser.run('window.late = document.querySelector(arguments[0])', button)
        robot.show(OTHER)
        browser.until_text('decision-line', 'other')
        browser.run('window.late.click()')  # sooner than anybody can have read it
        browser.until_text('told', 'nothing was sent')
        browser.until_it_may_be_answered()
        browser.run('window.late.click()')
        browser.until_text('told', 'changed')
        assert robot.sent == []
        browser.driver.find_element(By.CSS_SELECTOR, button).click()
        (sent,) = robot.wait_sent(1)
        assert (sent.kind, sent.decision_id) == (CommandKind.CONFIRM, 'd2')
        browser.until_text('told', 'applied')
        # Enter again and again, while nothing waits for a moment and then another one; no time passes.
        answered = browser.run(
            'const {DecisionBar} = await import("./decision.js");'
            'const asked = {id: "a", kind: "transition", line: "", reasons: [], choices: [], wanted: "done"};'
            'const sent = [];'
            'const places = [0, 1, 2].map(() => document.createElement("div"));'
            'const all = document.createElement("label").appendChild(document.createElement("select"));'
            'const bar = new DecisionBar(...places, all, {send: (one) => sent.push(one), tell() {},'
            ' placesOf: () => []});'
            'bar.allow(true);'
            'for (const shown of [[asked], [], [{...asked, id: "b"}]]) { bar.show(shown, 0); bar.confirm(); }'
            'return sent.map((one) => one.decision)'
        )
        assert answered == ['a']


COUNT_PLAN_PIXELS = """
const canvas = document.getElementById('map');
const colour = getComputedStyle(document.documentElement).getPropertyValue('--plan').trim();
const [red, green, blue] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
let count = 0;
for (let at = 0; at < data.length; at += 4) {
  count += data[at] === red && data[at + 1] === green && data[at + 2] === blue;
}
return count;
"""


def test_what_was_not_received_is_said_and_answered_only_by_who_insists(browser: Browser) -> None:
    robot = WebRobot()
    robot.mirror.receive_plan(((2.0, 2.0), (3.0, 1.0)))  # of something else
    judged = dataclasses.replace(PLAN, subject=('path', NASTY), subject_number=1)
    robot.show(judged)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('decision-body', f'path, {NASTY} NOT RECEIVED: the subject of this decision is not shown')
        browser.until(lambda: browser.run(COUNT_PLAN_PIXELS) == 0)
        browser.until_it_may_be_answered()
        for _ in range(2):
            browser.driver.find_element(By.CSS_SELECTOR, '[data-choice=failed]').click()
            browser.until_text('told', 'not received; nothing was sent')
        browser.run('document.body.focus()')
        assert robot.sent == []
        path = SubjectValue('path', 'nav_msgs/msg/Path', points=((0.5, 0.5), (3.5, 0.5), (3.5, 2.5)))
        robot.mirror.receive_subjects(Subjects('e', (Subject(judged.id, 1, (path, SubjectValue(NASTY, text=NASTY))),)))
        browser.until_text('decision-body', f'about path: 5.0 m to x 3.50 y 2.50; {NASTY}: {NASTY}')
        browser.until(lambda: browser.run(COUNT_PLAN_PIXELS) > 100)
        assert browser.driver.find_elements(By.ID, 'unseen') == []
        robot.mirror.receive_subjects(Subjects('e'))  # it is lost: another executive has said so
        browser.until(lambda: browser.driver.find_elements(By.ID, 'unseen'))
        browser.driver.find_element(By.ID, 'unseen').click()
        browser.driver.find_element(By.CSS_SELECTOR, '[data-choice=failed]').click()
        (sent,) = robot.wait_sent(1)
        assert (sent.kind, sent.outcome) == (CommandKind.FORCE, 'failed')
        robot.show(WHERE)
        browser.until_text('decision-line', 'Where to?')
        browser.until(lambda: browser.run(COUNT_PLAN_PIXELS) == 0)  # of something else, still
        robot.show(WHERE, active_states=(ActiveState('/Drive', progress=DriveProgress(distance=1.0)),))  # along it
        browser.until(lambda: browser.run(COUNT_PLAN_PIXELS) > 0)


def test_everything_can_be_done_by_keys(browser: Browser) -> None:
    robot = WebRobot(answers=False)
    robot.show(PLAN)
    station, touched = robot.station(), []
    station.attention.touched = lambda view, decision_id: touched.append(decision_id)  # type: ignore[method-assign]
    with served({'robot': station}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.run('return document.querySelector("[data-choice]") !== null'))
        for typed, word in (('yes', 'yes'), ('12', '12'), ('go on', 'goon')):
            browser.press(typed, Keys.ENTER, Keys.ENTER)  # an answer that has no line to be typed into
            browser.until_text('told', f"nothing was sent: '{word}' was typed in one go")
            browser.press(Keys.ESCAPE)
        assert robot.sent == []
        browser.press('2')
        browser.until(lambda: touched == [PLAN.id])  # from now on it counts as dealt with
        pressed = 'return document.querySelector("[data-choice=failed]").getAttribute("aria-pressed")'
        browser.until(lambda: browser.run(pressed) == 'true')
        browser.press(Keys.ENTER)
        assert robot.wait_sent(1)[0].outcome == 'failed'
        browser.press('1')  # it is still there, as after an answer that is refused
        browser.until(lambda: touched == [PLAN.id, PLAN.id])
        robot.answers = True
        robot.show(WHERE)
        browser.until_text('decision-line', 'Where to?')
        browser.until_text('map-keys', 'arrows')
        browser.press('g')
        browser.until_it_may_be_answered()
        browser.press(Keys.ENTER, Keys.ENTER)  # shows the cursor, and sends nothing that was not aimed at
        browser.until_text('map-cursor', 'cursor x 2.00 y 2.00 yaw 0.00')
        browser.press(Keys.ARROW_RIGHT, Keys.ARROW_UP, '<')
        browser.until_text('map-cursor', 'yaw 0.39')
        browser.press(Keys.ENTER)
        (answer,) = robot.wait_sent(2)[1].inputs
        assert answer.type.startswith('geometry_msgs') and robot.sent[1].decision_id == 'd4'
        assert json.loads(answer.text)['pose']['position']['x'] > 2.0 and browser.text('map-cursor') == ''
        robot.show(state=ExecutiveState.RUNNING)
        browser.until_text('decision-line', 'No pending decision')
        browser.run('document.activeElement.blur()')
        browser.press(':')
        browser.press('note a "word" isn\'t lost', Keys.ENTER)
        assert robot.wait_sent(3)[2].text == 'a "word" isn\'t lost'
        browser.press(Keys.F8)  # also while a line is typed
        assert robot.wait_sent(4)[3].kind is CommandKind.STOP
        robot.show(locked=('/Drive',))
        browser.until_text('active', '/Drive (locked)')
        browser.run('document.activeElement.blur()')
        browser.press('b', Keys.ENTER, 'L', Keys.ENTER)  # each shows its line first; also with caps lock
        sent = [(one.kind, one.path) for one in robot.wait_sent(6)[4:]]
        assert sent == [(CommandKind.BREAKPOINT, '/Drive'), (CommandKind.UNLOCK, '/Drive')]
        # Tab reaches every control, and each has a name.
        names = browser.run(
            'return [...document.querySelectorAll("button, input, select, canvas, [tabindex]")]'
            '.filter(e => e.checkVisibility() && !e.disabled && !(e.innerText || e.labels?.length ||'
            ' e.getAttribute("aria-label") || e.getAttribute("aria-labelledby") || e.textContent)).map(e => e.id)'
        )
        assert names == []


def test_a_click_on_the_map_answers_and_drops_an_obstacle(browser: Browser) -> None:
    class World:
        dropped: tuple[tuple[str, float, float, float], ...] = ()

        def is_possible(self) -> bool:
            return True

        def drop(self, x: float, y: float, timeout: float) -> str:
            self.dropped += (('box', x, y, 0.2),)
            return 'box'

        def remove(self, name: str, timeout: float) -> None:
            self.dropped = ()

    robot, world = WebRobot(), World()
    robot.show(WHERE)
    with served({'robot': robot.station(world)}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('map-keys', 'Click')
        canvas = browser.driver.find_element(By.ID, 'map')
        ActionChains(browser.driver).move_to_element(canvas).click().perform()  # the middle of the map is 2.0, 1.5
        (value,) = robot.wait_sent(1)[0].inputs
        where = json.loads(value.text)['pose']['position']
        assert (where['x'], where['y']) == pytest.approx((2.0, 1.5), abs=0.05)
        browser.until(lambda: browser.driver.find_element(By.ID, 'drop').is_displayed())
        browser.driver.find_element(By.ID, 'drop').click()
        ActionChains(browser.driver).move_to_element(canvas).click().perform()
        browser.until_text('obstacles', 'remove box')
        assert world.dropped[0][1:] == pytest.approx((2.0, 1.5, 0.2), abs=0.05)
        assert len(robot.sent) == 1
        browser.driver.find_element(By.CSS_SELECTOR, '#obstacles button').click()
        browser.until(lambda: not world.dropped)
        browser.press('g', Keys.ENTER)
        browser.until_text('map-cursor', 'cursor')
        browser.press(Keys.ESCAPE)
        dropping = 'return document.getElementById("drop").getAttribute("aria-pressed")'
        browser.until(lambda: browser.run(dropping) == 'false')
        assert browser.run('return document.activeElement === document.body') and browser.text('map-cursor') == ''


def test_neither_another_button_nor_two_fingers_nor_the_click_of_a_dialog_point_at_a_pose(browser: Browser) -> None:
    robot = WebRobot(answers=False, is_drawn=True)
    robot.show(WHERE)
    with served({'robot': robot.station()}) as port, browser.emulated(1400, 950, mobile=True):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('map-keys', 'Click')
        browser.run('document.querySelector("#map-pane .enlarge").click()')
        canvas = browser.driver.find_element(By.ID, 'map')
        ActionChains(browser.driver).context_click(canvas).perform()
        for kind, fingers in (('touchStart', 1), ('touchStart', 2), ('touchMove', 2), ('touchEnd', 1), ('touchEnd', 0)):
            points = [{'x': 500 + 200 * finger, 'y': 500, 'id': finger} for finger in range(fingers)]
            browser.driver.execute_cdp_cmd('Input.dispatchTouchEvent', {'type': kind, 'touchPoints': points})
        browser.press('n', 'x', Keys.ENTER)  # what comes later has come
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.NOTE]
        browser.press(Keys.ESCAPE, 'f')
        browser.until(lambda: browser.run('return document.querySelectorAll("#dialog-body li button").length') == 2)
        row = browser.driver.find_element(By.CSS_SELECTOR, '#dialog-body li button')
        # A busy machine may take long from the first click to the second one.
        browser.run('const at = performance.now(); performance.now = () => at')
        ActionChains(browser.driver).double_click(row).perform()  # the dialog is closed by the first click
        browser.run('delete performance.now')
        browser.until(lambda: not browser.run('return document.getElementById("dialog").open'))
        browser.press(Keys.ESCAPE, 'n', 'y', Keys.ENTER)
        assert [one.kind for one in robot.wait_sent(3)] == [CommandKind.NOTE, CommandKind.FORCE, CommandKind.NOTE]


def test_a_double_click_and_a_key_that_is_held_down_press_once(browser: Browser) -> None:
    robot = WebRobot(answers=False, is_drawn=True)
    asked = dataclasses.replace(PLAN, id='d9', path='/Ask', outcome='received', outcomes=('received',))
    robot.show(PLAN, asked, active_states=(ActiveState('/Drive'), ActiveState('/Ask')))
    robot.mirror.receive_queue(MissionQueue('e', 0, '', (QueueEntry(5, 'Patrol'), QueueEntry(7, 'Patrol'))))
    enter = {'key': 'Enter', 'code': 'Enter', 'text': '\r', 'windowsVirtualKeyCode': 13}

    def double_click(selector: str) -> None:
        element = browser.until(lambda: browser.driver.find_elements(By.CSS_SELECTOR, selector))[0]
        browser.run('arguments[0].scrollIntoView({block: "center"})', element)
        ActionChains(browser.driver).double_click(element).perform()

    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_it_may_be_answered()
        double_click('#machine .choice[id="s2o0"] rect')  # the first click puts the decision into the bar
        browser.until(lambda: 'nothing was sent' in browser.text('log') + browser.text('told'))
        double_click('#queue [title="Remove entry 5"]')
        browser.until(lambda: 'nothing was done at the second press' in browser.text('log') + browser.text('told'))
        browser.run('document.getElementById("pause").focus()')
        for number in range(4):
            held = {'type': 'keyDown', 'autoRepeat': number > 0, **enter}
            browser.driver.execute_cdp_cmd('Input.dispatchKeyEvent', held)
        browser.driver.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyUp', **enter})
        browser.press('n', 'x', Keys.ENTER)
        kinds = [CommandKind.QUEUE_REMOVE, CommandKind.PAUSE, CommandKind.NOTE]
        assert [one.kind for one in robot.wait_sent(3)] == kinds


def test_a_button_that_has_just_changed_its_meaning_sends_nothing(browser: Browser) -> None:
    robot = WebRobot(answers=False)
    robot.show()
    robot.mirror.receive_queue(MissionQueue('e'))
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        changes: list[tuple[str, str, Callable[[], object]]] = [
            ('pause', 'Go on', lambda: robot.show(state=ExecutiveState.PAUSED)),
            ('queue-hold', 'Release', lambda: robot.mirror.receive_queue(MissionQueue('e', 3, 'it failed'))),
        ]
        for id, word, change in changes:
            browser.run(
                'const [id, word] = arguments, button = document.getElementById(id);'
                'const press = (_, watch) => {'
                ' if (button.textContent.includes(word)) { watch.disconnect(); button.click(); } };'
                'const what = {subtree: true, childList: true, characterData: true};'
                'new MutationObserver(press).observe(button, what)',
                id,
                word,
            )
            change()
            browser.until_text('told', 'has just come to mean')
        assert robot.sent == []
        browser.until_it_may_be_answered()
        for id in ('pause', 'queue-hold'):
            browser.driver.find_element(By.ID, id).click()
        asked = [(one.kind, one.queue_number) for one in robot.wait_sent(2)]
        assert asked == [(CommandKind.RESUME, 0), (CommandKind.QUEUE_RELEASE, 3)]


def test_a_button_of_the_queue_that_has_just_come_to_mean_another_entry_sends_nothing(browser: Browser) -> None:
    robot = WebRobot(answers=False)
    robot.show()
    first, *others = [QueueEntry(number, 'Patrol') for number in (4, 5, 7)]
    robot.mirror.receive_queue(MissionQueue('e', entries=(first, *others)))
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('queue', '7 Patrol')
        browser.run(
            'const list = document.getElementById("queue");'
            'const press = (_, watch) => { watch.disconnect(); list.children[1].lastElementChild.click(); };'
            'new MutationObserver(press).observe(list, {childList: true})'
        )
        robot.mirror.receive_queue(MissionQueue('e', entries=tuple(others)))
        browser.until_text('told', 'has just come to mean "queue remove 7"')
        assert robot.sent == []
        browser.until_it_may_be_answered()
        browser.driver.find_element(By.CSS_SELECTOR, '#queue [title="Remove entry 7"]').click()
        assert [one.queue_number for one in robot.wait_sent(1)] == [7]


def test_an_enter_at_what_has_the_focus_neither_stops_nor_confirms(browser: Browser) -> None:
    robot = WebRobot(answers=False, is_drawn=True)
    robot.show(PLAN)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_it_may_be_answered()
        browser.press(':')
        browser.press('status', Keys.ENTER)
        browser.until_text('dialog-body', 'RUNNING')
        browser.press(Keys.ENTER)  # away with it
        browser.until(lambda: not browser.run('return document.getElementById("dialog").open'))
        browser.until_it_may_be_answered()
        browser.run('document.querySelector("#trees-pane summary").focus()')
        browser.press(Keys.ESCAPE, Keys.ENTER)
        browser.until(lambda: browser.run('return document.querySelector("#trees-pane details").open'))
        browser.press(Keys.ESCAPE, 'n', 'x', Keys.ENTER)
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.NOTE]
        # A line that was given up keeps the next one at no decision of then.
        browser.press(Keys.ESCAPE, ':')
        browser.press('stat', Keys.ESCAPE)
        robot.show(OTHER)
        browser.until_text('decision-line', 'other')
        browser.press(':')
        browser.press('confirm', Keys.ENTER)
        assert robot.wait_sent(2)[1].decision_id == OTHER.id


def test_what_is_typed_as_an_answer_stays_when_something_else_is_asked(browser: Browser) -> None:
    robot = WebRobot()
    where = dataclasses.replace(WHERE, subject=('path',), subject_number=1)
    robot.show(where)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.driver.find_elements(By.ID, 'value'))
        browser.driver.find_element(By.ID, 'value').send_keys('ki')
        robot.show(where, PLAN)
        browser.until_text('decision-line', '(+1 more)')
        browser.press('t')
        subject = Subject(where.id, 1, (SubjectValue('path', text='a cup'),))  # more is known of the same decision
        robot.mirror.receive_subjects(Subjects('e', (subject,)))
        browser.until_text('decision-body', 'about path: a cup')
        browser.press('chen', Keys.ENTER)
        (sent,) = robot.wait_sent(1)
        assert sent.decision_id == WHERE.id and json.loads(sent.inputs[0].text)['pose']['position']['x'] == 3.0


@pytest.mark.parametrize('word', ['\u202eevil\u2066\u200b\x1b[2J\x00\u2028', 'x' * 10_000, '部屋 ' * 3_000])
def test_whatever_a_text_is_nothing_is_hidden_and_stop_and_answers_stay_on_the_page(
    browser: Browser, word: str
) -> None:
    robot, path = WebRobot(), f'/{word}'
    parameters = (BehaviorParameter(word, word, word, (), word), BehaviorParameter('room', choices=(word, 'b')))
    robot.mirror.receive_behaviors(BehaviorList('e', (Behavior(word, description=word, parameters=parameters),)))
    robot.mirror.receive_places({word: FramedPose(1.0, 1.0)})
    robot.show(
        dataclasses.replace(PLAN, path=path, outcomes=('done', word), prompt=word),
        behavior=word,
        message=word,
        active_states=(ActiveState(path, 1.0, (word,)),),
        peers=(Peer(word, alive=False, problem=word),),
        authority=word,
        locked=(path,),
        breakpoints=(path,),
    )
    hidden = r'return /[^\P{C}\n]|[\p{Zl}\p{Zp}]/u.exec(document.body.innerText)?.[0].codePointAt(0) ?? null'
    seen = (
        'const box = arguments[0].getBoundingClientRect();'
        'return arguments[0].contains(document.elementFromPoint(box.left + 5, box.top + 5)) && box.right <= innerWidth'
    )
    with served({'r1': robot.station(), 'r2': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/?robot=r1')
        browser.until_live()
        browser.until(lambda: browser.run('return document.querySelectorAll("[data-choice]").length') == 2)
        for selector in ('#stop', '[data-choice="done"]', '#line', '[data-robot="r2"]'):
            assert browser.run(seen, browser.driver.find_element(By.CSS_SELECTOR, selector)), selector
        assert browser.run('return document.documentElement.scrollWidth <= innerWidth')
        with browser.emulated(390, 844, mobile=True):
            browser.until(lambda: browser.run('return innerWidth') == 390)  # and not more, to show what is beside
            assert browser.run('return document.documentElement.scrollWidth') == 390
            assert browser.run(seen, browser.driver.find_element(By.ID, 'stop'))
        assert browser.run(hidden) is None
        for keys in ('f', 's', (Keys.DOWN, Keys.ENTER)):  # the last opens the form of the behavior
            browser.press(*keys)
            browser.until(lambda: browser.run('return document.querySelector("dialog").open'))
            assert browser.run(hidden) is None
            if keys == 'f':
                browser.press(Keys.ESCAPE)
                browser.until(lambda: not browser.run('return document.querySelector("dialog").open'))
        (switch,) = (spec for spec in COMMANDS if spec.name == 'switch')
        told = [option.help for option in switch.prompt_options if option.value is not None]
        browser.until(lambda: all(one in browser.text('dialog-body') for one in told))


def test_on_a_phone_what_runs_is_read_and_who_asks_for_the_authority_gets_it(browser: Browser) -> None:
    robot = WebRobot()
    robot.show(authority='ann', authority_requests=('bob',), behavior='Navigate Split')
    phone = {'width': 390, 'height': 844, 'deviceScaleFactor': 1, 'mobile': True}
    browser.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', phone)
    try:
        with served({'robot': robot.station()}) as port:
            browser.driver.get(f'http://127.0.0.1:{port}/')
            browser.until_live()
            browser.until_text('alarm', 'bob requests control: press "c" to answer')
            assert browser.run('return document.getElementById("runs").getBoundingClientRect().width') > 120
            browser.press('c')
            browser.until(lambda: browser.run('return document.querySelector("dialog").open'))
            shown = [line for line in browser.text('dialog-body').split('\n') if line]
            assert shown == ['handover bob', 'refuse bob', 'release']
            browser.driver.find_element(By.CSS_SELECTOR, '#dialog-body button').click()
            assert robot.wait_sent(1)[0].kind is CommandKind.HAND_OVER_AUTHORITY
    finally:
        browser.driver.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})


def test_of_many_that_wait_any_can_be_answered_and_then_the_oldest_is_shown_again(browser: Browser) -> None:
    robot = WebRobot(answers=False)
    waiting = [dataclasses.replace(PLAN, id=f'w{number}', prompt=f'number {number}') for number in range(40)]
    robot.show(*waiting)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('decision-line', 'number 0 (+39 more)')
        browser.driver.get(f'http://127.0.0.1:{port}/?robot=robot&decision=w7')  # as in the message of an alert
        browser.until_live()
        browser.until_text('decision-line', 'number 7 (+39 more)')
        browser.press('a', Keys.END)
        browser.until_text('decision-line', 'number 39')
        browser.run('document.activeElement.blur()')
        browser.press('2', Keys.ENTER)
        (sent,) = robot.wait_sent(1)
        assert (sent.decision_id, sent.outcome) == ('w39', 'failed')
        robot.show(*waiting[:-1])
        browser.until_text('decision-line', 'number 0 (+38 more)')
        browser.press('a', Keys.DOWN)
        browser.until_text('decision-line', 'number 1 ')
        robot.show(*waiting[1:-1])  # the focus stays in the list while others come and go
        browser.until_text('decision-line', 'number 1 (+37 more)')
        assert browser.run('return document.activeElement.id') == 'waiting'
        robot.show(waiting[1])
        browser.until(lambda: browser.run('return document.getElementById("choose-waiting").hidden'))
        assert len(robot.sent) == 1


def test_a_list_sends_what_was_typed_in_full_or_gone_to_and_nothing_else(browser: Browser) -> None:
    robot = WebRobot(is_drawn=True)
    speed = BehaviorParameter('speed', 'float', '0.3', (), 'while it carries', 'Top speed', 'm/s', '0', '1.5')
    goal = BehaviorInput('goal', 'geometry_msgs/PoseStamped', 'where to drive', needed=True)
    made = Behavior('Made', SYNTHESIZED, machine='# look\nmachine: {}')
    behaviors = (
        Behavior('Broken', error='ImportError: no module named moveit'),
        made,
        Behavior('Unseen', SYNTHESIZED),
        Behavior('Errand', parameters=(speed,)),
        Behavior('Patrol', parameters=(speed,), inputs=(goal,)),
    )
    robot.mirror.receive_behaviors(BehaviorList('e', behaviors))
    robot.show(PLAN)

    def type_into(key: str, text: str, *keys: str) -> None:
        browser.run('document.activeElement.blur()')
        browser.press(key)
        browser.until(lambda: browser.run('return document.querySelector("dialog .find") === document.activeElement'))
        browser.press(text, *keys)

    def leave() -> None:
        browser.press(Keys.ESCAPE)
        browser.until(lambda: not browser.run('return document.querySelector("dialog").open'))

    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.run('return document.querySelector("[data-choice]") !== null'))
        for typed, told in (('', 'nothing is chosen yet'), ('fail', 'no line has this name'), ('x', 'no line')):
            type_into('f', typed, Keys.ENTER, Keys.ENTER)
            browser.until_text('dialog-body', told)
            leave()
        assert robot.sent == []
        type_into('f', 'failed', Keys.ENTER)
        assert robot.wait_sent(1)[0].outcome == 'failed'
        browser.until_text('told', 'applied')  # and not confirmed by the same Enter
        assert len(robot.sent) == 1
        browser.until_text('decision-line', 'No pending decision')
        type_into('f', 'fa', Keys.DOWN, Keys.ENTER)  # the only line that fits
        assert robot.wait_sent(2)[1].outcome == 'failed'
        type_into('f', Keys.DOWN, 'failex', Keys.ENTER)  # what is typed at a line is typed into the field
        browser.until_text('dialog-body', 'no line has this name')
        leave()
        assert len(robot.sent) == 2
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        browser.until_text('start', 'Start')
        type_into('s', 'broken', Keys.ENTER)
        browser.until_text('dialog-body', 'not possible: ImportError: no module named moveit')
        leave()
        browser.run('performance.now = () => 1000')  # what comes at once was meant for what opened the form
        type_into('s', 'errand', Keys.ENTER, Keys.ENTER)
        browser.until_text('dialog-body', 'just opened: Enter again: start')
        leave()
        assert len(robot.sent) == 2
        type_into('s', 'patrol', Keys.ENTER)
        browser.until_text('dialog-body', 'Top speed [speed] (float, from 0 to 1.5 m/s) while it carries')
        browser.press(Keys.END, '5', Keys.ENTER)
        invalid = 'return document.querySelector("dialog input:invalid")?.validationMessage ?? ""'
        browser.run('document.querySelector("dialog [name=goal]").value = "kitchen"')
        browser.run('document.querySelector("dialog [name=goal]").dispatchEvent(new Event("input"))')
        browser.run('document.querySelector("#dialog-body input").select()')
        browser.press('9', Keys.ENTER)
        browser.until(lambda: 'beyond its limits' in browser.run(invalid))
        assert len(robot.sent) == 2
        browser.press(Keys.BACKSPACE, '1.5', Keys.ENTER)
        start = robot.wait_sent(3)[2]
        assert (start.kind, start.arguments) == (CommandKind.START, (('speed', '1.5'),))
        assert [one.key for one in start.inputs] == ['goal']
        browser.until(lambda: not browser.run('return document.querySelector("dialog").open'))
        submit = 'document.querySelector("dialog form").dispatchEvent(new Event("input"));'
        submit += 'document.querySelector("dialog form").requestSubmit()'
        type_into('s', 'made', Keys.ENTER)
        browser.until_text('dialog-body', made.machine)
        changed = dataclasses.replace(made, machine='machine: {}')
        robot.mirror.receive_behaviors(BehaviorList('e', (*behaviors[2:], changed)))
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='', message='news')
        browser.until_text('alarm', 'news')
        browser.run(submit)
        browser.until_text('told', 'Made has changed since the form was opened; nothing was sent')
        type_into('s', 'unseen', Keys.ENTER)
        browser.until_text('dialog-body', 'machine NOT RECEIVED')
        browser.run(submit)
        browser.until_text('dialog-body', 'machine was not received; nothing was sent')
        assert len(robot.sent) == 3
        browser.driver.find_element(By.ID, 'unseen-machine').click()
        browser.run(submit)
        assert robot.wait_sent(4)[3].behavior == 'Unseen'
        # A level of autonomy is a button of its own: none is sent on the way to another.
        browser.driver.find_element(By.CSS_SELECTOR, '#autonomy [value="3"]').click()
        assert robot.wait_sent(5)[4].autonomy == 3


def test_a_behavior_that_has_changed_is_not_started_by_the_form_of_before(browser: Browser) -> None:
    robot = WebRobot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press('s')
        browser.press('Patrol', Keys.ENTER)
        browser.until_text('dialog-title', 'start Patrol')
        faster = Behavior('Patrol', parameters=(BehaviorParameter('speed', 'float', '1.5'),))
        robot.mirror.receive_behaviors(BehaviorList('e', (faster,)))
        robot.show(message='changed')
        browser.until_text('alarm', 'changed')  # what was sent before has come
        browser.until_it_may_be_answered()
        browser.press(Keys.ENTER)
        browser.until_text('told', 'has changed since the form was opened')
        assert robot.sent == []


def test_what_is_filled_in_stays_when_an_answer_of_the_robot_comes_late(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, answers = WebRobot(), threading.Event()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')

    def userdata(path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
        assert answers.wait(60.0)
        return (UserdataScope('/', ()),)

    monkeypatch.setattr(robot, 'userdata', userdata)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press(':', 'userdata', Keys.ENTER, 's')
        browser.press('Patrol', Keys.ENTER)
        browser.until_text('dialog-title', 'start Patrol')
        browser.press('7')
        browser.run('document.getElementById("recordings").click()')
        answers.set()
        browser.until_text('told', 'userdata:')
        browser.until_text('dialog-title', 'start Patrol')
        assert browser.run('return document.activeElement.value') == '0.37'


def test_a_default_of_several_lines_stays_as_it_is(browser: Browser) -> None:
    robot = WebRobot()
    robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
    parameters = (BehaviorParameter('words', 'str', 'one\ntwo'), BehaviorParameter('speed', 'float', '0.3'))
    robot.mirror.receive_behaviors(BehaviorList('e', (Behavior('Say', parameters=parameters),)))
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press('s')
        browser.press('Say', Keys.ENTER)
        browser.until_text('dialog-title', 'start Say')
        browser.press(Keys.TAB, '0.5', Keys.ENTER)
        assert robot.wait_sent(1)[0].arguments == (('speed', '0.5'),)


def test_what_is_typed_into_a_list_of_the_page_is_what_is_taken_or_nothing(browser: Browser) -> None:
    names = [
        ['done', 'Drive done'],
        ['failed', 'Drive failed'],
        ['Done', 'Look Done'],
        ['seen it'],
        ['done', 'Look done'],
    ]
    take = (
        'const {Commands} = await import("./commands.js"), taken = [];'
        'const rows = arguments[0].map((names, row) => ({text: names[0], names, run: () => taken.push(row)}));'
        'const list = Commands.prototype.list(rows), field = list.querySelector("input");'
        'field.value = arguments[1];'
        'field.dispatchEvent(new Event("input"));'
        'for (let n = 0; n < 2; n++) field.dispatchEvent(new KeyboardEvent("keydown", {key: "Enter", bubbles: true}));'
        'return taken'
    )
    some = st.sampled_from([name for row in names for name in row])

    @given(st.one_of(some, some.map(lambda name: name[:3]), some.map(str.upper), st.text(max_size=8)))
    @settings(max_examples=100, deadline=None)
    def type_it(word: str) -> None:
        typed = ' '.join(word.split())
        exact = [row for row, known in enumerate(names) if typed in known]
        same = [row for row, known in enumerate(names) if typed.lower() in [name.lower() for name in known]]
        meant = exact or same
        taken = browser.run(take, names, word)
        assert set(taken) == (set(meant) if typed and len(meant) == 1 else set())

    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        type_it()


def test_an_enter_that_ends_a_composition_takes_nothing(browser: Browser) -> None:
    enter = 'new KeyboardEvent("keydown", {key: "Enter", isComposing: arguments[0], bubbles: true})'
    robot = WebRobot(is_drawn=True)
    robot.show()
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press('f')
        browser.press('done')
        for composes in (True, False):
            browser.run(f'document.activeElement.dispatchEvent({enter})', composes)
            assert browser.run('return document.getElementById("dialog").open') is composes
        assert [(one.kind, one.outcome) for one in robot.wait_sent(1)] == [(CommandKind.FORCE, 'done')]


def test_what_is_old_looks_old_and_only_a_stop_goes_out(browser: Browser) -> None:
    robot = WebRobot(answers=False)
    robot.show(PLAN)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        robot.mirror.sender_gone()
        robot.clock.advance(7.0)
        browser.until_text('link', 'LOST')
        browser.until_text('alarm', 'NO LINK')
        browser.until_text('age', 's old')
        assert browser.run('return [...document.querySelectorAll("[data-choice], #pause")].every(b => b.disabled)')
        assert float(browser.run('return getComputedStyle(document.getElementById("now")).opacity')) < 0.6
        browser.press('1', Keys.ENTER)
        browser.until_text('told', 'nothing was sent')
        browser.press('!')
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.STOP]


def test_a_lost_server_is_told_and_found_again(browser: Browser) -> None:
    robot = WebRobot()
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press(':', 'pause')
    browser.until_text('link', 'NO SERVER')
    browser.until_text('alarm', 'trying again')
    browser.press(Keys.F8)
    browser.until_text('told', 'nothing was sent')
    browser.press(Keys.ENTER)
    assert browser.run('return document.getElementById("line").value') == 'pause'
    with served({'robot': robot.station()}, port=port):
        browser.until_live()
        browser.press(Keys.ENTER)
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.PAUSE]


def test_a_key_is_answered_also_while_nothing_was_heard(browser: Browser) -> None:
    with served({'robot': WebRobot().station()}, Access('127.0.0.1', 'secret')) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/#token=another')
        browser.until_text('alarm', 'the token is missing or wrong')
        browser.press('p')
        browser.until_text('told', 'nothing was sent')


def test_a_page_that_comes_back_is_not_live_before_it_has_heard_anything(browser: Browser) -> None:
    robot = WebRobot()
    leave = 'dispatchEvent(new PageTransitionEvent(arguments[0], {persisted: true}));'
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        assert browser.run(f'{leave} return document.getElementById("link").textContent', 'pagehide') == 'CONNECTING'
        browser.run(leave, 'pageshow')
        browser.until_live()


def test_the_way_to_the_decision_keeps_the_token(browser: Browser) -> None:
    with served({'robot': WebRobot().station()}, Access('127.0.0.1', 'secret')) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/#token=secret')
        browser.until_live()
        browser.press(Keys.TAB, Keys.ENTER)
        browser.until(lambda: browser.run('return document.activeElement.id') == 'decision')
        assert browser.run('return location.hash') == '#token=secret'


def test_a_page_that_names_no_robot_goes_to_the_first_that_is_found(browser: Browser) -> None:
    robots = WebRobots({})
    with served(robots) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_text('link', 'LISTENING')
        robots.come('/first', WebRobot().station())
        browser.until_live()
        assert browser.run('return new URL(location).searchParams.get("robot")') == '/first'
        robots.come('/second', WebRobot().station())
        browser.until(lambda: browser.run('return document.querySelectorAll("[data-robot]").length') == 2)
        assert browser.run('return document.getElementById("robot").value') == '/first'
        browser.driver.get(f'http://127.0.0.1:{port}/?robot=thrid')
        browser.until_text('link', 'NO SUCH ROBOT')
        browser.until_text('alarm', "no robot 'thrid' was found (/first, /second)")
        assert browser.run('return document.querySelectorAll("[data-robot]").length') == 2
        robots.come('/thrid', WebRobot().station())
        browser.until_live()


def test_a_page_that_names_no_robot_stays_at_the_one_it_has_got(browser: Browser) -> None:
    robots = {name: WebRobot() for name in ('/calm', '/urgent')}
    robots['/calm'].show(PLAN)
    stations = {name: robot.station() for name, robot in robots.items()}
    with served(stations) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/#token=t')
        browser.until_live()
        browser.until(lambda: browser.run('return new URL(location).searchParams.get("robot")') == '/calm')
        assert browser.run('return location.hash') == '#token=t'
    browser.until_text('link', 'NO SERVER')
    others = WebRobots({'/urgent': stations['/urgent'], '/calm': stations['/calm']})  # which has another one of its own
    with served(others, port=port):
        browser.until_live()
        browser.until(lambda: others.opened == ['/calm'])
        assert browser.run('return document.getElementById("robot").value') == '/calm'


def test_a_page_whose_token_is_wrong_waits_and_takes_another_at_once(browser: Browser) -> None:
    """The server was started again with a new one: each wrong token would hold up all pages of this computer."""
    robot = WebRobot()
    robot.show()
    with served({'/': robot.station()}, Access('127.0.0.1', 'before')) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/#token=before')
        browser.until_live()
        browser.run(
            'const wait = setTimeout; window.waits = [];'
            'window.setTimeout = (act, ms) => { window.waits.push(ms); return wait(act, ms); }'
        )
    with served({'/': robot.station()}, Access('127.0.0.1', 'after'), port):
        browser.until_text('alarm', 'the token is missing or wrong')
        browser.until(lambda: browser.run('return Math.max(...window.waits)') == 20_000)
        browser.run('location.hash = "#token=after"')
        browser.until_live()


def test_fifty_robots_have_a_line_each_and_keep_the_focus(browser: Browser) -> None:
    robots = {f'r{number}': WebRobot() for number in range(50)}
    with served({name: robot.station() for name, robot in robots.items()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/?robot=r7')
        browser.until_live()
        browser.until(lambda: browser.run('return document.querySelectorAll("[data-robot]").length') == 50)
        browser.run('window.line = document.querySelector("[data-robot=r30]"); line.focus()')
        robots['r22'].show(peers=(Peer('navigation', alive=False),))
        browser.until_text('robots', 'r22: RUNNING Patrol navigation not found')
        browser.until_text('robots-told', 'robots: 50, need you: 0')
        robots['r41'].show(PLAN)  # who waits comes first
        first = 'return document.querySelector("[data-robot]").dataset.robot'
        browser.until(lambda: browser.run(first) == 'r41')
        browser.until_text('robots-told', 'need you: 1')
        assert browser.run('return document.activeElement === line')  # which may be clicked just then
        browser.press(Keys.ENTER)
        browser.until(lambda: browser.run('return document.getElementById("robot").value') == 'r30')
        assert all(robot.sent == [] for robot in robots.values())
