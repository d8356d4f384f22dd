# SPDX-License-Identifier: BSD-3-Clause
"""Whether the memory of the studio stays flat: its page is used for minutes at a robot that runs, in headless Chromium.

A machine and a tree run in a real executive and BT server. The page watches them and shows their past, goes through
graphs and files, edits and undoes, proves, compares and runs dry. Each minute prints the heap of the page after a
garbage collection (MB), its DOM nodes and listeners, and the memory of the server and its workers (MB).

Usage: python3 benchmarks studio_memory [--minutes N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from _figures import write_figures

from flexbt_testing.browser import CHROMIUM, DRIVER, Browser, started_browser
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import run_console, start_console

TREE: Final = """\
<root BTCPP_format="4" main_tree_to_execute="Count">
  <BehaviorTree ID="Count">
    <Sequence>
      <Script code="attempt := 0"/>
      <Repeat num_cycles="20">
        <Fallback>
          <Sequence>
            <Script name="Add" code="attempt := attempt + 1"/>
            <Sleep name="Rest" msec="150"/>
            <AlwaysFailure name="Fails"/>
          </Sequence>
          <Sleep name="Mend" msec="50"/>
        </Fallback>
      </Repeat>
    </Sequence>
  </BehaviorTree>
</root>
"""
MACHINE: Final = """\
behavior: {name: Counting}
machine:
  outcomes: [finished, failed]
  states:
    Load:
      state: BtLoaderState
      parameters: {filepaths: [FOLDER/count.xml]}
      transitions: {done: Run, failed: failed}
    Run:
      state: BtExecuteState
      parameters: {bt_file: FOLDER/count.xml}
      transitions: {done: Rest, canceled: finished, failed: failed}
    Rest:
      state: WaitState
      parameters: {wait_time: 0.5}
      transitions: {done: Run}
"""
_CLICK: Final = 'document.getElementById(arguments[0]).click()'
_SELECT: Final = (
    'document.querySelector(`[data-path="${arguments[0]}"] > .box`)'
    '.dispatchEvent(new MouseEvent("click", {bubbles: true}))'
)
_GO: Final = (
    '[...document.querySelectorAll("#files button")].find((one) => one.textContent.endsWith(arguments[0])).click()'
)


def mission(place: Path) -> tuple[Path, dict[str, str]]:
    """Write a package with the machine and its tree; return its folder and the environment in which it is installed."""
    folder, about = place / 'site' / 'counting', place / 'site' / 'counting-1.0.dist-info'
    for one in (folder, about):
        one.mkdir(parents=True)
    (folder / '__init__.py').touch()
    (folder / 'count.xml').write_text(TREE)
    (folder / 'counting.yaml').write_text(MACHINE.replace('FOLDER', str(folder)))
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: counting\nVersion: 1.0\n')
    (about / 'entry_points.txt').write_text('[flexbt.behaviors]\ncounting = counting:counting.yaml\n')
    return folder, {'PYTHONPATH': os.pathsep.join([str(place / 'site'), os.environ.get('PYTHONPATH', '')])}


class Page(Browser):
    """The page. Its scripts give values: what they would give otherwise the driver keeps for as long as the page."""

    def run(self, script: str, *arguments: Any) -> Any:
        """Run a script, and return what it returns."""
        call = f'(function () {{ {script} }}).apply(null, {json.dumps(arguments)})'
        answer = self.driver.execute_cdp_cmd('Runtime.evaluate', {'expression': call, 'returnByValue': True})
        if 'exceptionDetails' in answer:
            raise ValueError(f'{script}: {answer["exceptionDetails"]}')
        return answer['result'].get('value')


def use(page: Browser, turn: int) -> None:
    """Use the page for some seconds: what is done depends on the turn."""
    file = ('count.xml', 'counting.yaml')[turn % 2]
    page.run(_GO, file)
    page.until(lambda: page.run('return document.title') and file in page.text('tabs'))
    page.run('document.querySelector("#picture [tabindex=\\"0\\"]")?.focus()')
    for _ in range(5):
        page.press('\ue015', '\ue015', '\ue013')  # through the graph
    if file == 'count.xml':
        page.run(_SELECT, 'Count/0/1/0/0/0')
        page.press('c', 'v')
        page.until_text('difference', 'Unsaved changes')
        page.run(_CLICK, ('prove', 'compare', 'run')[turn // 2 % 3])
        page.run(_CLICK, 'undo')
        page.until_text('difference', 'No changes')
        page.run(_CLICK, 'run')
        page.until_text('player-title', 'Dry run')
        page.press('\ue011', '.', '.', '\ue00c')
    page.run('if (document.getElementById("live").ariaPressed === "false") document.getElementById("live").click()')
    page.until(lambda: page.run('return document.getElementById("live").ariaPressed') == 'true')
    page.run('document.querySelector("#player-lanes .timeline-body").focus()')
    page.press('[', '[', '\ue012', '-', '+', '\ue00c')
    page.press('?', '\ue00c')


def figures(page: Browser, server: int) -> dict[str, float]:
    """Return what is measured now: MB, and numbers of nodes and listeners."""
    driver: Any = page.driver
    driver.execute_cdp_cmd('HeapProfiler.collectGarbage', {})
    found = {one['name']: one['value'] for one in driver.execute_cdp_cmd('Performance.getMetrics', {})['metrics']}
    workers = [server, *children(server)]
    return {
        'heap': round(found['JSHeapUsedSize'] / 1e6, 2),
        'nodes': found['Nodes'],
        'listeners': found['JSEventListeners'],
        'server': round(resident(server), 1),
        'workers': round(sum(resident(one) for one in workers[1:]), 1),
        'processes': len(workers),
    }


def children(process: int) -> list[int]:
    """Return the processes that a process has started, and theirs."""
    try:
        threads = Path(f'/proc/{process}/task').iterdir()
        own = [int(word) for thread in threads for word in (thread / 'children').read_text().split()]
    except OSError:
        return []
    return [*own, *(other for one in own for other in children(one))]


def resident(process: int) -> float:
    """Return the resident memory of a process, MB; 0 if it has ended."""
    try:
        found = re.search(r'VmRSS:\s+(\d+)', Path(f'/proc/{process}/status').read_text())
    except OSError:
        return 0.0
    return int(found[1]) / 1000 if found else 0.0


def main() -> None:
    """Use the page, print and write."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition('\n')[0])
    parser.add_argument('--minutes', type=float, default=10.0, help='how long (default: %(default)g)')
    parser.add_argument('--output', type=Path, help='file for the figures')
    options = parser.parse_args()
    if not (CHROMIUM and DRIVER):
        sys.exit('no Chromium with its driver: apt install chromium chromium-driver')
    rows: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as place, Stack(Path(place)) as stack:
        folder, environment = mission(Path(place))
        stack.start('bt_server', {'use_sim_time': 'false', 'allowed_directories': f"['{folder}']"})
        stack.start('onboard_executive', {'use_sim_time': 'false', 'authority_timeout': '600.0'}, environment)
        done = run_console('--timeout', '60', 'start', 'Counting')
        if done.returncode:
            sys.exit(done.stderr)
        with (
            start_console('web', '--port', '0', '--timeout', '60', '--studio', str(folder)) as web,
            started_browser(Path(place, 'profile')) as driver,
        ):
            try:
                assert web.stdout is not None
                found = re.search(r'(http://127\.0\.0\.1:\d+/)#(token=\S+)', web.stdout.readline())
                assert found is not None
                page, turn, begin = Page(driver), 0, time.monotonic()
                driver.execute_cdp_cmd('Performance.enable', {})
                driver.get(f'{found[1]}studio/#{found[2]}&file=count.xml')
                page.until(lambda: page.run('return document.querySelectorAll("#picture .node").length') > 5)
                while time.monotonic() - begin < 60.0 * options.minutes:
                    use(page, turn)
                    turn += 1
                    if time.monotonic() - begin >= 60.0 * len(rows):
                        row = {'minute': len(rows), 'turns': turn, **figures(page, web.pid)}
                        rows.append(row)
                        print('  '.join(f'{name} {value:g}' for name, value in row.items()), flush=True)
                complaints = [one for one in driver.get_log('browser') if one['level'] == 'SEVERE']
                print('complaints of the page:', complaints)
            finally:
                web.kill()
    if options.output is not None:
        write_figures(options.output, {'minutes': rows})


if __name__ == '__main__':
    main()
