# SPDX-License-Identifier: BSD-3-Clause
"""How fast the studio's page is: opening, moving, typing and panning in trees of many nodes, in headless Chromium.

Times are medians of the page's own clock, ms. ``open`` is from the click on a file to its graph, ``draw`` the part of
it that the page needs for layout and elements, ``move`` from Alt+Down to the moved node, ``typed`` from a letter in the
text field to the graph that has it, ``frame`` the time between two frames while the graph is panned.

Usage: python3 benchmarks studio_speed [--nodes N...] [--trials N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any, Final

from _figures import write_figures

from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.server import serving
from flexbt_studio.server.web_server import StudioServer, editor_folder
from flexbt_studio.server.workbench import Workbench
from flexbt_testing.browser import CHROMIUM, DRIVER, Browser, started_browser

_WAIT: Final = """
const done = arguments[arguments.length - 1], until = (condition, begin) => {
  const look = () => {
    if (!condition()) return;
    observer.disconnect();
    done(performance.now() - begin);
  };
  const observer = new MutationObserver(look);
  observer.observe(document.getElementById('picture'), {subtree: true, childList: true, attributes: true});
  look();
};
const press = (key) => {
  document.activeElement.dispatchEvent(new KeyboardEvent('keydown', {bubbles: true, cancelable: true, ...key}));
};
const nodes = () => document.querySelectorAll('#picture .node').length;
"""
_OPEN: Final = """
const count = arguments[0], file = arguments[1], begin = performance.now();
[...document.querySelectorAll('#files button')].find((one) => one.textContent.endsWith(file)).click();
until(() => nodes() === count && document.title && document.querySelector('#picture [aria-selected=true]'), begin);
"""
_DRAW: Final = """
const {drawTrees} = await import('./tree_drawing.js');
const view = arguments[0], begin = performance.now();
const made = drawTrees(view, new Set());
const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
svg.append(...made.parts);
document.body.append(svg);
svg.getBoundingClientRect();
const took = performance.now() - begin;
svg.remove();
return took;
"""
_CLICK: Final = """
const box = document.querySelector(`#picture [data-path="${arguments[0]}"] > .box`);
box.dispatchEvent(new MouseEvent('click', {bubbles: true}));
"""
_MOVE: Final = """
const path = document.activeElement.dataset.path, begin = performance.now();
press({key: 'ArrowDown', altKey: true});
until(() => document.activeElement.dataset.path && document.activeElement.dataset.path !== path, begin);
"""
_TYPED: Final = """
const begin = performance.now(), letter = arguments[0];
const place = document.getElementById('text'), at = place.querySelector('textarea');
const where = /name="[^"]*n2"/.exec(at.value).index + 6;
at.setRangeText(letter, where, where, 'end');
at.dispatchEvent(new InputEvent('input', {bubbles: true}));
const name = at.value.slice(where, where + letter.length + 2);
until(() => [...document.querySelectorAll('#picture .type')].some((one) => one.textContent.includes(name)), begin);
"""
_PAN: Final = """
const done = arguments[arguments.length - 1], pane = document.getElementById('graph-body'), times = [];
let last = performance.now();
const step = (now) => {
  times.push(now - last);
  last = now;
  if (times.length > 60) { done(times.slice(1)); return; }
  const deltaY = times.length % 20 < 10 ? 25 : -25;
  pane.dispatchEvent(new WheelEvent('wheel', {bubbles: true, cancelable: true, shiftKey: true, deltaY}));
  requestAnimationFrame(step);
};
requestAnimationFrame(step);
"""


def tree(nodes: int) -> str:
    """Return the XML of a tree of this many nodes: three leaves, or controls, below each control."""
    children: dict[int, list[int]] = {}
    for number in range(1, nodes):
        children.setdefault((number - 1) // 3, []).append(number)
    lines: list[str] = []
    waiting = [(0, False)]
    while waiting:
        number, is_end = waiting.pop()
        depth = 2
        above = number
        while above:
            above, depth = (above - 1) // 3, depth + 1
        indentation = '  ' * depth
        if number not in children:
            lines.append(f'{indentation}<Wait name="n{number}" wait_duration="1.0"/>')
        elif is_end:
            lines.append(f'{indentation}</Sequence>')
        else:
            lines.append(f'{indentation}<Sequence name="n{number}">')
            waiting += [(number, True), *((child, False) for child in reversed(children[number]))]
    text = '\n'.join(lines)
    return f'<root BTCPP_format="4">\n  <BehaviorTree ID="Big">\n{text}\n  </BehaviorTree>\n</root>\n'


def measure(browser: Browser, address: str, nodes: int, trials: int) -> dict[str, float]:
    """Return the medians for a file of this many nodes."""
    found: dict[str, list[float]] = {name: [] for name in ('open', 'draw', 'move', 'typed', 'frame')}
    file = f'tree_{nodes}.xml'
    for trial in range(trials):
        browser.driver.get('about:blank')
        browser.driver.get(address)
        browser.until(lambda: file in browser.text('files'))
        found['open'].append(browser.driver.execute_async_script(_WAIT + _OPEN, nodes + 1, file))
        view = browser.driver.execute_async_script(
            'const socket = new WebSocket(`ws://${location.host}/session`), done = arguments[arguments.length - 1];'
            'socket.onopen = () => { socket.send(JSON.stringify({hello: ""})); socket.send(JSON.stringify('
            '{id: 1, method: "model", arguments: {file: arguments[0]}})); };'
            'socket.onmessage = (message) => { const answer = JSON.parse(message.data);'
            ' if (answer.id) { socket.close(); done(answer.result.view); } };',
            file,
        )
        found['draw'].append(browser.run(_DRAW, view))
        browser.run(_CLICK, 'Big/0/0')
        found['move'].append(browser.driver.execute_async_script(_WAIT + _MOVE))
        if browser.run('return document.querySelector("#text > textarea") !== null'):
            found['typed'].append(browser.driver.execute_async_script(_WAIT + _TYPED, f't{trial}_'))
        found['frame'].append(statistics.median(browser.driver.execute_async_script(_PAN)))
        browser.driver.get('about:blank')
    return {name: round(statistics.median(times), 1) for name, times in found.items() if times}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition('\n')[0])
    parser.add_argument('--nodes', type=int, nargs='+', default=[100, 500], help='nodes of the trees')
    parser.add_argument('--trials', type=int, default=7, help='times that each is done')
    parser.add_argument('--output', type=Path, help='file for the figures')
    options = parser.parse_args()
    if not (CHROMIUM and DRIVER):
        sys.exit('no Chromium with its driver: apt install chromium chromium-driver')
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, 'mission')
        folder.mkdir()
        for nodes in options.nodes:
            (folder / f'tree_{nodes}.xml').write_text(tree(nodes))
        loop = asyncio.new_event_loop()
        threading.Thread(target=loop.run_forever, daemon=True).start()
        for name, editor in (('CodeMirror', editor_folder()), ('text field', None)):
            if name == 'CodeMirror' and editor is None:
                continue
            server = serving(StudioServer(Workbench(folder), Access(), editor).application(), '127.0.0.1', 0)
            port = asyncio.run_coroutine_threadsafe(server.__aenter__(), loop).result()
            with started_browser(Path(place, name)) as driver:
                driver.set_script_timeout(60)
                for nodes in options.nodes:
                    found = measure(Browser(driver), f'http://127.0.0.1:{port}/', nodes, options.trials)
                    figures[f'{name}, {nodes} nodes'] = found
                    shown = ', '.join(f'{key} {value:g} ms' for key, value in found.items())
                    print(f'{name}, {nodes} nodes: {shown}', flush=True)
            asyncio.run_coroutine_threadsafe(server.__aexit__(None, None, None), loop).result()
    if options.output is not None:
        write_figures(options.output, figures)


if __name__ == '__main__':
    main()
