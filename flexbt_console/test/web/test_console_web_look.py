# SPDX-License-Identifier: BSD-3-Clause
"""How the page looks in a real browser: what fits, what is readable, panels, diagrams, and who the operator is."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import threading
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from web_support import OTHER, PLAN, WHERE, WebRobot, WebRobots, served

from flexbt_common.errors import ResourceError
from flexbt_console.mirror.records import (
    CommandKind,
    ExecutiveState,
    LogLine,
    LogSeverity,
    StateKind,
    StateStructure,
    Structure,
    UserdataScope,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredNodeKind, MirroredStatus, TreeNodes, TreeReport
from flexbt_console.ui.web.drawings import Drawing, Drawings
from flexbt_testing.browser import NEEDS_BROWSER, Browser

selenium = pytest.importorskip('selenium', reason='selenium drives the browser: pip install selenium')
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

pytestmark = NEEDS_BROWSER

SIZES = {
    'laptop': (1400, 800),
    'small': (1024, 768),
    'tablet': (820, 1180),
    'phone': (390, 844),
    'turned': (844, 390),
    'least': (320, 640),
}
MOBILE = ('tablet', 'phone', 'turned', 'least')

# What is visible is within the window, or in something that scrolls; nothing lies on a control; texts are not clipped.
CUT_OFF = """
const scrolls = document.scrollingElement.scrollHeight > innerHeight;
const bad = [];
const of = 'button, select, input, h1, h2, p, label, .badge, .status, summary';
for (const one of document.querySelectorAll(of)) {
  if (!one.checkVisibility() || one.matches('.sr, .skip, :is(h1):has(+ label:not([hidden]))')) continue;
  const box = one.getBoundingClientRect(), name = one.id || one.className || one.textContent;
  if (!box.width || box.left < 0 || box.right > innerWidth + 0.5) bad.push(['beside', name, box.left, box.right]);
  const isSeen = box.top >= 0 && box.bottom <= innerHeight + 0.5;
  if (!scrolls && !isSeen) bad.push(['below', name, box.bottom]);
  const style = getComputedStyle(one);
  if (style.overflow === 'visible' && !one.matches('p') && one.scrollWidth > one.clientWidth + 1 && one.clientWidth) {
    bad.push(['clipped', name, one.scrollWidth, one.clientWidth]);
  }
  if (!one.matches('button, select, input') || !isSeen) continue;
  const there = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
  if (there && !one.contains(there) && !there.contains(one) && !there.closest('.head')) bad.push(['covered', name]);
}
if (document.documentElement.scrollWidth > innerWidth) bad.push(['scrolls', document.documentElement.scrollWidth]);
return bad;
"""

# Texts smaller than 12 pixels on the screen, of the page and of its diagrams.
SMALL = """
const bad = [];
for (const one of document.querySelectorAll('body *')) {
  const isText = [...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  if (!one.checkVisibility() || !isText) continue;
  let size = parseFloat(getComputedStyle(one).fontSize);
  if (one.ownerSVGElement) size *= one.getBoundingClientRect().height / one.getBBox().height;
  if (size < 11.9) bad.push([one.textContent, size]);
}
return bad;
"""


# Pairs of tokens, text on ground, that have too little contrast (WCAG 2.2, 1.4.3 and 1.4.11).
CONTRAST = """
const probe = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
const light = (name) => {
  probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  probe.fillRect(0, 0, 1, 1);
  const linear = (one) => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4;
  const [r, g, b] = [...probe.getImageData(0, 0, 1, 1).data].map((one) => linear(one / 255));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const texts = ['text', 'dim', 'accent', 'good', 'warning', 'error', 'decision'];
const pairs = texts.flatMap((front) => [[front, 'back', 4.5], [front, 'pane', 4.5]]);
pairs.push(['on-accent', 'accent', 4.5], ['on-stop', 'stop', 4.5], ['edge', 'back', 3]);
for (const back of ['soft', 'decision-back']) pairs.push(...['text', 'dim', 'decision'].map((one) => [one, back, 4.5]));
return pairs.filter(([front, back, least]) => {
  const [x, y] = [light(`--${front}`), light(`--${back}`)].sort((p, q) => q - p);
  return (x + 0.05) / (y + 0.05) < least;
});
"""

NAMELESS = """
const named = (one) => one.getAttribute('aria-label') || one.getAttribute('aria-labelledby') || one.labels?.length;
return [...document.querySelectorAll('button, input, select, canvas, [tabindex], [role=button], a')]
  .filter((one) => one.checkVisibility() && !named(one) && !one.textContent.trim()).map((one) => one.outerHTML);
"""

# Nodes of a tree that are not whole in their pane, if it has room for two of them below each other.
OUTSIDE = """
const pane = document.querySelector('#trees .drawing').getBoundingClientRect(), bad = [];
for (const node of document.querySelectorAll(pane.height < 120 ? ':not(*)' : '#trees .node')) {
  const {left, top, right, bottom} = node.firstElementChild.getBoundingClientRect();
  if (left < pane.left || right > pane.right || top < pane.top || bottom > pane.bottom) {
    bad.push([node.id, left, top, right, bottom, pane.left, pane.top, pane.right, pane.bottom]);
  }
}
return bad;
"""

COUNT_WALLS = """
const canvas = document.getElementById('map');
const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
let count = 0;
for (let at = 0; at < data.length; at += 4) count += data[at] === 48 && data[at + 1] === 52 && data[at + 2] === 60;
return count;
"""

COLUMNS = """
const panels = (column) => [...column.querySelectorAll('.panel')].map((panel) => panel.id.slice(0, 3));
return [...document.querySelectorAll('.column')].map(panels);
"""


WHEEL = (
    'const map = document.getElementById("map"), box = map.getBoundingClientRect();'
    'map.dispatchEvent(new WheelEvent("wheel", {deltaY: -400, clientX: box.left + box.width / 2,'
    ' clientY: box.top + box.height / 2, bubbles: true, cancelable: true}))'
)

MIDDLE = (
    'arguments[0].scrollIntoView({block: "center"}); const box = arguments[0].getBoundingClientRect();'
    'return [box.left + box.width / 2, box.top + box.height / 2]'
)


def touch(browser: Browser, kind: str, *points: tuple[float, float]) -> None:
    fingers = [{'x': x, 'y': y, 'id': number} for number, (x, y) in enumerate(points)]
    browser.driver.execute_cdp_cmd('Input.dispatchTouchEvent', {'type': kind, 'touchPoints': fingers})


def slide(browser: Browser, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
    touch(browser, 'touchStart', *(start for start, _ in ways))
    for part in range(1, 9):
        touch(browser, 'touchMove', *((x + dx * part / 8, y + dy * part / 8) for (x, y), (dx, dy) in ways))
    touch(browser, 'touchEnd')


def drawn_robot() -> WebRobot:
    robot = WebRobot(is_drawn=True)
    robot.show(PLAN)
    return robot


def until_drawn(browser: Browser) -> None:
    browser.until_live()
    browser.until(
        lambda: browser.run('return document.querySelectorAll("#machine .choice, #trees .graph").length') >= 3
    )


@pytest.mark.parametrize('size', SIZES)
def test_nothing_is_cut_off_or_small_and_stop_is_seen(browser: Browser, size: str) -> None:
    with served({'robot': drawn_robot().station()}) as port:
        width, height = SIZES[size]
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        browser.run('for (const one of document.querySelectorAll("details")) one.open = arguments[0]', height > 1000)
        for media in ({}, {'prefers_color_scheme': 'dark'}, {'forced_colors': 'active'}, {'prefers_contrast': 'more'}):
            with browser.emulated(width, height, mobile=size in MOBILE, **media):
                browser.until(lambda: browser.run('return innerWidth') == width)
                browser.run('return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))')
                assert browser.run(CUT_OFF) == [], media
                assert browser.run(SMALL) == [], media
                assert size == 'least' or browser.run(OUTSIDE) == [], media  # the longest name is wider
                for y in (0, 10_000):
                    stop = browser.run(
                        'scrollTo(0, arguments[0]);'
                        'const box = document.getElementById("stop").getBoundingClientRect();'
                        'return [box.width, box.height, Math.round(innerWidth - box.right), Math.round(box.top),'
                        ' document.elementFromPoint(box.x + 5, box.y + 5).id]',
                        y,
                    )
                    assert stop == [96, 44, 8, 4, 'stop']
                if size == 'phone':  # the decision and the map come first
                    top = 'scrollTo(0, 0); return document.getElementById(arguments[0]).getBoundingClientRect().top'
                    assert browser.run(top, 'decision') < 250 and browser.run(top, 'map') < 500


def test_controls_have_names_colours_have_contrast_and_the_page_has_one_heading(browser: Browser) -> None:
    with served({'robot': drawn_robot().station()}) as port:
        for scheme, more in itertools.product(('light', 'dark'), ('no-preference', 'more')):
            with browser.emulated(1400, 800, prefers_color_scheme=scheme, prefers_contrast=more):
                browser.driver.get(f'http://127.0.0.1:{port}/')
                until_drawn(browser)
                assert browser.run(CONTRAST) == [], (scheme, more)
        assert browser.run(NAMELESS) == []
        count = 'return document.querySelectorAll(arguments[0]).length'
        assert [browser.run(count, one) for one in ('main', 'h1', 'body > header', 'nav')] == [1, 1, 1, 1]
        assert browser.run(count, '[aria-hidden=true] :is(button, [tabindex]), [aria-hidden=true][tabindex]') == 0
        ids = browser.run('return [...document.querySelectorAll("[id]")].map((one) => one.id)')
        assert len(ids) == len(set(ids))


def test_a_diagram_is_zoomed_and_moved_by_keys_wheel_and_drag(browser: Browser) -> None:
    view = 'return document.querySelector("#machine svg").getAttribute("viewBox").split(" ").map(Number)'
    with served({'robot': drawn_robot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        x, y, width, height = browser.run(view)
        left, top, right, bottom = browser.run(
            'const {x, y, width, height} = document.querySelector("#machine .graph").getBoundingClientRect();'
            'const pane = document.getElementById("machine").getBoundingClientRect();'
            'return [x - pane.x, y - pane.y, x + width - pane.right, y + height - pane.bottom]'
        )
        assert left >= 0 and top >= 0 and right <= 0 and bottom <= 0  # it fits
        browser.run('document.getElementById("machine").focus()')
        browser.press('+')
        closer = browser.run(view)
        assert closer[2] == pytest.approx(width / 1.25) and closer[3] == pytest.approx(height / 1.25)
        assert closer[0] + closer[2] / 2 == pytest.approx(x + width / 2)  # the middle stays
        browser.press(Keys.ARROW_RIGHT, Keys.ARROW_DOWN)
        moved = browser.run(view)
        assert moved[0] > closer[0] and moved[1] > closer[1] and moved[2] == closer[2]
        browser.press('-', '-')
        assert browser.run(view)[2] == pytest.approx(width * 1.25)
        browser.press('0')
        assert browser.run(view) == pytest.approx([x, y, width, height])
        pane = browser.driver.find_element(By.ID, 'machine')
        browser.run(
            'const box = arguments[0].getBoundingClientRect();'
            'arguments[0].dispatchEvent(new WheelEvent("wheel",'
            ' {deltaY: -200, clientX: box.left, clientY: box.top, bubbles: true, cancelable: true}))',
            pane,
        )
        wheeled = browser.run(view)
        assert wheeled[2] < width and wheeled[:2] == pytest.approx([x, y], abs=1.0)  # the point below the pointer stays
        ActionChains(browser.driver).move_to_element_with_offset(pane, -200, 60).click_and_hold().move_by_offset(
            50, 30
        ).release().perform()
        dragged = browser.run(view)
        assert dragged[0] < wheeled[0] and dragged[1] < wheeled[1]
        browser.driver.find_element(By.CSS_SELECTOR, '#machine .zoom button:nth-child(2)').click()
        assert browser.run(view) == pytest.approx([x, y, width, height])


def press_outcome(browser: Browser, transition: str, *keys: str) -> None:
    box = browser.driver.find_element(By.CSS_SELECTOR, f'#machine [id="{transition}"] rect')
    ActionChains(browser.driver).move_to_element(box).click().send_keys(*keys).perform()


def test_all_of_a_diagram_fits_however_large_it_is(browser: Browser) -> None:
    script = (
        'const {viewport} = await import("./viewport.js");'
        'const pane = document.body.appendChild(document.createElement("div"));'
        'const svg = pane.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "svg"));'
        'const view = viewport(svg);'
        'view.content({x: 0, y: 0, width: 1e6, height: 1e3});'
        'view.fit(true);'
        'return svg.getAttribute("viewBox").split(" ").map(Number)'
    )
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        left, _, width, _ = browser.run(script)
        assert left <= 0 and left + width >= 1e6


def test_what_is_followed_stays_in_view_in_a_pane_that_becomes_smaller(browser: Browser) -> None:
    script = (
        'const {viewport} = await import("./viewport.js");'
        'const of = (name) => document.createElementNS("http://www.w3.org/2000/svg", name);'
        'const pane = document.body.appendChild(document.createElement("div"));'
        'const svg = pane.appendChild(of("svg")), node = svg.appendChild(of("rect"));'
        'const sides = Object.entries({x: 240, y: 540, width: 40, height: 40});'
        'for (const [name, value] of sides) node.setAttribute(name, value);'
        'pane.id = "small";'
        'pane.style.cssText = "position: fixed; inset: 0 auto auto 0; width: 300px; height: 600px";'
        'svg.style.cssText = "width: 100%; height: 100%";'
        'const view = viewport(svg);'
        'view.content({x: 0, y: 0, width: 280, height: 580});'
        'view.reveal(node)'
    )
    smaller = 'Object.assign(document.getElementById("small").style, {width: arguments[0], height: arguments[1]})'
    outside = (
        'const of = (one) => document.querySelector(`#small ${one}`).getBoundingClientRect();'
        'const pane = of("svg"), node = of("rect");'
        'return [node.left < 0, node.top < 0, node.right > pane.right, node.bottom > pane.bottom]'
    )
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.run(script)
        for width, height in (('300px', '150px'), ('120px', '600px'), ('120px', '120px')):
            browser.run(smaller, width, height)
            browser.until(lambda: browser.run(outside) == 4 * [False])


def test_stop_stays_in_a_dialog_that_is_scrolled(browser: Browser) -> None:
    robot = WebRobot()
    with served({'robot': robot.station()}) as port, browser.emulated(1024, 480):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.press('?')
        browser.until_text('dialog-title', 'commands')
        browser.run('document.getElementById("dialog").scrollTop = 500')
        assert browser.run('return document.getElementById("dialog").scrollTop') > 300
        browser.driver.find_element(By.CSS_SELECTOR, '#dialog .stop').click()
        assert robot.wait_sent(1)[0].kind is CommandKind.STOP
        assert browser.run('return document.getElementById("dialog").scrollTop') > 300


def test_an_outcome_is_answered_or_forced_on_the_diagram(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, answers = drawn_robot(), threading.Event()
    monkeypatch.setattr(robot, 'userdata', lambda *_: (UserdataScope('/', ()),) if answers.wait(60.0) else ())
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        browser.until_it_may_be_answered()
        press_outcome(browser, 's1o0')
        (sent,) = robot.wait_sent(1)
        assert (sent.kind, sent.decision_id) == (CommandKind.CONFIRM, PLAN.id)
        browser.until_text('decision-line', 'No pending decision')
        assert browser.run('return document.querySelector("#machine .choice.wanted")') is None
        browser.press(':', 'userdata', Keys.ENTER)
        # Nothing waits: it is asked about; Enter comes sooner than anybody can have read it.
        press_outcome(browser, 's1o1', Keys.ENTER)
        browser.until_text('dialog-title', 'Leave /Drive by failed')
        browser.until_it_may_be_answered()
        assert len(robot.sent) == 1 and browser.run('return document.querySelector("dialog").open')
        answers.set()  # the answer to something else takes the place of no question
        browser.until_text('told', 'userdata:')
        assert browser.text('dialog-title') == 'Leave /Drive by failed'
        browser.press(Keys.ENTER)
        sent = robot.wait_sent(2)[1]
        assert (sent.kind, sent.path, sent.outcome) == (CommandKind.FORCE, '/Drive', 'failed')
        robot.show(PLAN, OTHER)  # by keys; an answer is for the decision that is in the bar
        browser.until_text('decision-line', '(+1 more)')
        browser.until_it_may_be_answered()
        browser.run('document.querySelector(`#machine [id="s1o1"]`).focus()')
        browser.press(Keys.ENTER)
        sent = robot.wait_sent(3)[2]
        assert (sent.kind, sent.outcome, sent.decision_id) == (CommandKind.FORCE, 'failed', PLAN.id)
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        browser.until(lambda: not browser.driver.find_element(By.ID, 'machine').is_displayed())
        assert len(robot.sent) == 3


def test_a_drag_over_an_outcome_sends_nothing(browser: Browser) -> None:
    robot = drawn_robot()
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        browser.until_it_may_be_answered()
        box = browser.driver.find_element(By.CSS_SELECTOR, '#machine [id="s1o0"] rect')
        drag = ActionChains(browser.driver).move_to_element(box).click_and_hold()
        drag.move_by_offset(0, 40).move_by_offset(0, -40).release().perform()
        browser.press('n', 'x', Keys.ENTER)  # what comes later has come
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.NOTE]


NESTED = Structure(
    'r1',
    'Patrol',
    (
        StateStructure('/', StateKind.MACHINE, 'Patrol', ('Drive', 'Watch'), ('finished',)),
        StateStructure('/Drive', StateKind.STATE, 'BtExecute', (), ('done',), ('/Watch',), (2,)),
        StateStructure('/Watch', StateKind.CONCURRENCY, 'Watch', ('Look', 'Listen'), ('seen',), ('=finished',), (0,)),
        StateStructure('/Watch/Look', StateKind.STATE, 'Look', (), ('done',), ('=seen',), (0,)),
        StateStructure('/Watch/Listen', StateKind.STATE, 'Listen', (), ('done',), ('=seen',), (0,)),
    ),
)


def test_containers_and_sub_trees_are_folded_and_stay_so(browser: Browser) -> None:
    robot = WebRobot()
    robot.mirror.receive_structure(NESTED)
    kinds = (MirroredNodeKind.CONTROL, MirroredNodeKind.SUBTREE, MirroredNodeKind.ACTION, MirroredNodeKind.ACTION)
    nodes = [MirroredNode(uid, (0, 1, 2, 1)[uid - 1], f'N{uid}', 'X', kind=kind) for uid, kind in enumerate(kinds, 1)]
    robot.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 1.0))
    robot.mirror.receive_tree_status(
        TreeReport('t', 1, [MirroredStatus.RUNNING] * 3, [], 5.0, finished=False, paused=False)
    )
    has = 'return arguments[0].map((id) => document.querySelector(`[id="${id}"]`) !== null)'
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.run(has, ['s3', 't0n2']) == [True, True])
        browser.driver.find_element(By.CSS_SELECTOR, '[id="m2in"] text').click()
        browser.run('document.querySelector(`[id="t0n1"]`).focus()')
        browser.press(Keys.ENTER)
        folded = ['s2', 's3', 't0n1', 't0n2', 't0n3']
        browser.until(lambda: browser.run(has, folded) == [True, False, True, False, True])
        assert browser.run('return document.activeElement.id') == 't0n1'
        browser.driver.refresh()
        browser.until_live()
        browser.until(lambda: browser.run(has, folded) == [True, False, True, False, True])
        browser.driver.find_element(By.CSS_SELECTOR, '[id="s2"] text').click()
        browser.driver.find_element(By.CSS_SELECTOR, '[id="t0n1"] text').click()
        browser.until(lambda: browser.run(has, folded) == [False, True, True, True, True])
        assert robot.sent == []


def test_what_changes_while_its_panel_is_folded_is_drawn_when_it_is_shown(browser: Browser) -> None:
    robot = drawn_robot()
    fold = 'for (const id of ["machine-pane", "trees-pane"]) document.querySelector(`#${id} .fold`).click()'
    away = (
        'const pane = document.querySelector("#machine").getBoundingClientRect();'
        'const near = (one, other) => Math.abs(one.x - other.x) < 40 && Math.abs(one.y - other.y) < 40;'
        'const box = (one) => one.getBoundingClientRect();'
        'const shown = [...document.querySelectorAll("#machine .choice > rect")].map(box), bad = [];'
        'for (const one of shown) if (one.width < 30 || one.bottom > pane.bottom) bad.push(one);'
        'for (const one of document.querySelectorAll("#trees .sign"))'
        ' if (!near(box(one), box(one.parentNode.firstElementChild))) bad.push(one.outerHTML);'
        'return [shown.length, document.querySelectorAll("#trees .sign").length, bad.length]'
    )
    with served({'robot': robot.station()}) as port, browser.emulated(1400, 800):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        browser.run(fold)
        browser.driver.refresh()
        browser.until_live()
        browser.until_text('decision-line', 'wants done')
        browser.run(fold)
        browser.until(lambda: browser.run(away) == [2, 3, 0])
        browser.run(fold)
        statuses = [MirroredStatus.RUNNING, MirroredStatus.FAILURE, MirroredStatus.RUNNING, MirroredStatus.SUCCESS]
        robot.mirror.receive_tree_status(TreeReport('t', 2, statuses, [], 6.0, finished=False, paused=False))
        robot.show(PLAN, message='later')
        browser.until_text('alarm', 'later')
        browser.run(fold)
        browser.until(lambda: browser.run(away) == [2, 4, 0])


def test_no_picture_of_another_machine_is_shown(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(drawings: Drawings, drawing: Drawing) -> str:
        raise ResourceError('dot', 'failed')

    robot = WebRobot(is_drawn=True)
    robot.show()
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        monkeypatch.setattr(Drawings, '_make', fail)
        robot.mirror.receive_structure(dataclasses.replace(NESTED, behavior='constructor', run_id='r2'))
        robot.show(run_id='r2', behavior='constructor')
        browser.until_text('told', 'no picture: dot')
        assert '/Watch/Listen' in browser.text('machine-text')
        assert not browser.driver.find_element(By.ID, 'machine').is_displayed()
        assert 'fold' not in browser.text('log')


def test_trees_of_any_shape_are_laid_out_in_order_and_apart(browser: Browser) -> None:
    draw = """
    const {drawTree} = await import('./drawing.js');
    const svg = document.querySelector('#machine svg');
    const [nodes, folded] = arguments;
    drawTree(svg, nodes, new Set(folded), () => {});
    const boxes = {};
    for (const node of svg.querySelectorAll('.node')) {
      const {x, y, width, height} = node.firstElementChild.getBBox();
      boxes[node.id.slice(3)] = [x, y, x + width, y + height];
    }
    return boxes;
    """

    @given(st.lists(st.tuples(st.integers(0, 60), st.integers(1, 30)), max_size=60), st.sets(st.integers(0, 60)))
    @settings(max_examples=60, deadline=None)
    def lay_out(others: list[tuple[int, int]], folded: set[int]) -> None:
        nodes: list[dict[str, Any]] = [{'lines': ['root'], 'kind': 'Control', 'parent': None}]
        for parent, length in others:
            kind = ('Action', 'Condition', 'SubTree', 'Decorator')[length % 4]
            nodes.append({'lines': ['x' * length, '(type)'], 'kind': kind, 'parent': parent % len(nodes)})
        boxes = {int(index): box for index, box in browser.run(draw, nodes, list(folded)).items()}
        inside = [nodes[index]['parent'] in folded for index in range(len(nodes))]
        for index in range(1, len(nodes)):
            inside[index] |= inside[nodes[index]['parent']]
        assert set(boxes) == {index for index in range(len(nodes)) if not inside[index]}
        for one, other in itertools.combinations(boxes.values(), 2):
            assert one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        isdown = all(boxes[index][1] >= boxes[nodes[index]['parent']][3] for index in boxes if index)
        isright = all(boxes[index][0] >= boxes[nodes[index]['parent']][2] for index in boxes if index)
        assert isdown or isright  # a child is behind its parent
        for first, second in itertools.combinations(sorted(boxes), 2):
            if first and nodes[first]['parent'] == nodes[second]['parent']:
                axis = 0 if isdown and not isright else 1
                assert boxes[first][axis + 2] <= boxes[second][axis]  # siblings are in their order

    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        lay_out()


def test_panels_are_arranged_by_keys_and_remembered(browser: Browser) -> None:
    grip = 'document.querySelector("#map-pane .grip").focus()'
    height = 'return document.getElementById("trees-pane").getBoundingClientRect().height'
    with served({'robot': drawn_robot().station()}) as port, browser.emulated(1400, 800):
        address = f'http://127.0.0.1:{port}/'
        browser.driver.get(address)
        until_drawn(browser)
        assert browser.run(COLUMNS) == [['mac', 'que', 'tim'], ['map', 'tre', 'log']]
        browser.run(grip)
        browser.press(Keys.ARROW_LEFT)
        assert browser.run(COLUMNS) == [['map', 'mac', 'que', 'tim'], ['tre', 'log']]
        browser.press(Keys.ARROW_DOWN)  # the focus has stayed
        assert browser.run(COLUMNS) == [['mac', 'map', 'que', 'tim'], ['tre', 'log']]
        before = browser.run(height)
        browser.run('document.querySelectorAll("[aria-orientation=horizontal]")[3].focus()')
        browser.press(Keys.ARROW_DOWN, Keys.ARROW_DOWN)
        larger = browser.run(height)
        assert larger > before + 50
        browser.driver.find_element(By.CSS_SELECTOR, '#log-pane .fold').click()
        assert not browser.driver.find_element(By.ID, 'log').is_displayed()
        browser.driver.refresh()
        until_drawn(browser)
        assert browser.run(COLUMNS) == [['mac', 'map', 'que', 'tim'], ['tre', 'log']]
        assert not browser.driver.find_element(By.ID, 'log').is_displayed()
        assert browser.run(CUT_OFF) == []
        browser.driver.find_element(By.CSS_SELECTOR, '#trees-pane .enlarge').click()
        assert not browser.driver.find_element(By.ID, 'map').is_displayed()
        assert browser.run(height) > 500
        browser.driver.find_element(By.CSS_SELECTOR, '#trees-pane .enlarge').click()
        browser.run('document.getElementById("reset").click()')
        assert browser.run(COLUMNS) == [['mac', 'que', 'tim'], ['map', 'tre', 'log']]
        for saved in ('{', '5', '{"columns": [["map-pane"]]}', '{"columns": [[], 3], "shares": 7, "folded": {}}'):
            browser.run('localStorage.setItem("flexbt-panels-wide", arguments[0])', saved)
            browser.driver.refresh()
            until_drawn(browser)
            assert browser.run(COLUMNS) == [['mac', 'que', 'tim'], ['map', 'tre', 'log']]


def test_a_panel_is_dragged_to_another_column(browser: Browser) -> None:
    with served({'robot': drawn_robot().station()}) as port, browser.emulated(1400, 800):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        start = browser.driver.find_element(By.CSS_SELECTOR, '#log-pane .grip')
        end = browser.driver.find_element(By.CSS_SELECTOR, '#machine-pane h2')
        ActionChains(browser.driver).click_and_hold(start).move_to_element(end).release().perform()
        browser.until(lambda: browser.run(COLUMNS) == [['log', 'mac', 'que', 'tim'], ['map', 'tre']])


def test_two_browsers_are_two_operators_and_each_is_asked_once(browser: Browser) -> None:
    robots = WebRobots({'robot': (robot := WebRobot()).station()})
    with served(robots, operator=lambda name: f'{name}@desk/page') as port:
        # Each address has a memory of its own, as each browser has.
        for number, (host, name) in enumerate((('127.0.0.1', 'ann'), ('localhost', 'bob'))):
            browser.driver.get(f'http://{host}:{port}/')
            browser.until_live()
            browser.until_text('holder', 'you: guest-')
            browser.press('!')  # a stop waits for no name
            assert robot.wait_sent(2 * number + 1)[-1].operator.startswith('guest-')
            browser.until(lambda: browser.driver.find_element(By.ID, 'your-name').is_displayed())
            browser.driver.find_element(By.ID, 'your-name').send_keys(name)
            for kind in ('pagehide', 'pageshow'):  # another connection changes nothing of it
                browser.run('dispatchEvent(new PageTransitionEvent(arguments[0], {persisted: true}))', kind)
            browser.until_live()
            browser.driver.find_element(By.ID, 'your-name').send_keys(Keys.ENTER)
            browser.until_text('holder', f'you: {name}')
            browser.until_live()
            browser.press('!')
            assert robot.wait_sent(2 * number + 2)[-1].operator == f'{name}@desk/page'
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('holder', 'you: ann')
        assert not browser.driver.find_element(By.ID, 'name-form').is_displayed()
        browser.until(lambda: [one for _, one in robots.present] == ['ann@desk/page'])
    browser.until_text('link', 'NO SERVER')  # a name that is given now is used when the server is back
    browser.run('document.getElementById("rename").click()')
    browser.driver.find_element(By.ID, 'your-name').send_keys('ie', Keys.ENTER)
    robots = WebRobots({'robot': robot.station()})
    with served(robots, operator=lambda name: f'{name}@desk/page', port=port):
        browser.until_text('holder', 'you: annie')
        browser.until_live()
        browser.until(lambda: [one for _, one in robots.present] == ['annie@desk/page'])
    with served({'robot': robot.station()}) as port:  # all are the operator of the server
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until_text('holder', 'you: ann')
        assert not browser.driver.find_element(By.ID, 'name-form').is_displayed()


def test_what_is_empty_says_what_to_do_and_what_was_sent_is_told_once(browser: Browser) -> None:
    robot = WebRobot()
    robot.mirror.receive_map(None)  # type: ignore[arg-type]
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        robot.show(state=ExecutiveState.IDLE, active_states=(), run_id='')
        browser.until_text('machine-pane', 'Press Start')
        browser.until_text('trees-pane', 'No tree is running')
        for number in range(3):
            robot.mirror.receive_log(LogLine('e', 2 + number, LogSeverity.INFO, f'line {number}', '', 'r1', 5.0))
        browser.press(':')
        browser.press('note hello', Keys.ENTER)
        browser.until_text('told', 'applied')
        seen = 'return document.body.innerText.split("\\n").filter((line) => line.includes("note hello")).length'
        assert browser.run(seen) == 1
        browser.press(':')
        browser.press('note again', Keys.ENTER)
        browser.until_text('told', 'again')
        browser.until_text('log', 'note hello')
        assert browser.run(seen) == 1


@pytest.mark.parametrize('size', ['laptop', 'tablet'])
def test_the_map_is_zoomed_and_moved_and_a_pose_is_pointed_at_there(browser: Browser, size: str) -> None:
    robot = WebRobot()
    with served({'robot': robot.station()}) as port, browser.emulated(*SIZES[size], mobile=size in MOBILE):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.until(lambda: browser.run(COUNT_WALLS) > 100)
        whole = browser.run(COUNT_WALLS)
        browser.press('g', '+', '+', '+', '+')
        browser.until(lambda: browser.run(COUNT_WALLS) != whole)
        browser.press('0')
        browser.until(lambda: browser.run(COUNT_WALLS) == whole)
        browser.run(WHEEL)
        canvas = browser.driver.find_element(By.ID, 'map')
        if size in MOBILE:
            slide(browser, (browser.run(MIDDLE, canvas), (60, 0)))
        else:
            mouse = ActionChains(browser.driver).move_to_element(canvas)
            mouse.click_and_hold().move_by_offset(60, 0).release().perform()
        robot.show(WHERE)
        browser.until_text('map-keys', 'Click')
        browser.until_it_may_be_answered()
        scale = browser.run(
            'const {clientWidth: w, clientHeight: h} = document.getElementById("map"); return Math.min(w / 4, h / 3)'
        )
        ActionChains(browser.driver).move_to_element(canvas).click().perform()
        where = json.loads(robot.wait_sent(1)[0].inputs[0].text)['pose']['position']
        assert where['x'] == pytest.approx(2.0 - 60 / (scale * math.e), abs=0.1)
        assert where['y'] == pytest.approx(1.5, abs=0.1)


def test_the_log_is_filtered(browser: Browser) -> None:
    robot = WebRobot()
    for number in range(3):
        robot.mirror.receive_log(LogLine('e', 2 + number, LogSeverity.INFO, f'line {number}', '', 'r1', 5.0))
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_text('log', 'line 2')
        browser.driver.find_element(By.ID, 'log-filter').send_keys('LINE 1')
        browser.until(lambda: 'line 1' in browser.text('log') and 'line 2' not in browser.text('log'))
        robot.mirror.receive_log(LogLine('e', 9, LogSeverity.INFO, 'late', '', 'r1', 5.0))
        robot.mirror.receive_log(LogLine('e', 10, LogSeverity.INFO, 'late line 1', '', 'r1', 5.0))
        browser.until_text('log', 'late line 1')
        assert [one.split('  ')[-1] for one in browser.text('log').split('\n') if one] == ['line 1', 'late line 1']


def test_the_log_follows_its_newest_line_until_somebody_scrolls_up(browser: Browser) -> None:
    robot = drawn_robot()
    numbers = itertools.count(2)

    def report() -> None:
        for number in itertools.islice(numbers, 60):
            robot.mirror.receive_log(LogLine('e', number, LogSeverity.INFO, f'line {number}', '', 'r1', 5.0))

    def below() -> int:
        script = 'const {scrollHeight, scrollTop, clientHeight} = document.getElementById("log");'
        return int(browser.run(f'{script} return scrollHeight - scrollTop - clientHeight'))

    report()
    with served({'robot': robot.station()}) as port, browser.emulated(1400, 800):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        browser.until(lambda: below() <= 1 and 'line 61' in browser.text('log'))
        for act in (
            'document.querySelector("#queue-pane .fold").click()',
            'const keys = {key: "ArrowLeft", bubbles: true};'
            'document.querySelector("#map-pane .grip").dispatchEvent(new KeyboardEvent("keydown", keys))',
            'document.getElementById("decision").style.minHeight = "300px"',
        ):
            browser.run(act)
            browser.until(lambda: below() <= 1)
        report()
        browser.until(lambda: 'line 121' in browser.text('log') and below() <= 1)
        browser.run('document.getElementById("log").scrollTop = 100')
        browser.until(lambda: below() > 100)
        report()
        browser.until_text('log', 'line 181')
        assert browser.run('return document.getElementById("log").scrollTop') == 100
        browser.run('document.querySelector("#queue-pane .fold").click()')
        assert browser.run('return document.getElementById("log").scrollTop') == 100


def test_on_a_phone_fingers_zoom_and_move_a_diagram_scroll_the_page_and_choose(browser: Browser) -> None:
    robot = drawn_robot()
    view = 'return document.querySelector("#machine svg").getAttribute("viewBox").split(" ").map(Number)'
    with served({'robot': robot.station()}) as port, browser.emulated(390, 844, mobile=True):
        browser.driver.get(f'http://127.0.0.1:{port}/')
        until_drawn(browser)
        x, y = browser.run(MIDDLE, browser.driver.find_element(By.ID, 'machine'))
        before = browser.run(view)
        slide(browser, ((x - 40, y), (-60, 0)), ((x + 40, y), (60, 0)))
        browser.until(lambda: browser.run(view)[2] < before[2] / 2)
        closer = browser.run(view)
        slide(browser, ((x, y), (-60, 0)))
        browser.until(lambda: browser.run(view)[0] > closer[0] + 1)
        scrolled = browser.run('addEventListener("scrollend", () => { window.rests = true; }); return scrollY')
        slide(browser, ((x, y), (0, -100)))
        browser.until(lambda: browser.run('return window.rests === true && scrollY') > scrolled + 20)
        assert robot.sent == []
        browser.run('document.querySelector("#machine .zoom button:nth-child(2)").click()')
        pill = browser.run(MIDDLE, browser.driver.find_element(By.CSS_SELECTOR, '#machine [id="s1o1"] rect'))
        touch(browser, 'touchStart', tuple(pill))
        touch(browser, 'touchEnd')
        assert [(one.kind, one.outcome) for one in robot.wait_sent(1)] == [(CommandKind.FORCE, 'failed')]
