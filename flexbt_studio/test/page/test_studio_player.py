# SPDX-License-Identifier: BSD-3-Clause
"""The player of the studio in a real browser: proofs, comparisons, dry runs, and what a robot does."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest
from studio_page import StudioPage, held, served

from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    BreakpointKind,
    ExecutiveSnapshot,
    ExecutiveState,
    TreeBreakpoint,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, StatusChange, TreeNodes, TreeReport
from flexbt_core.clock.clock import SteadyClock
from flexbt_studio.server.web_server import StudioServer
from flexbt_testing.browser import NEEDS_BROWSER
from flexbt_testing.waiting import DEADLINE

pytest.importorskip('selenium', reason='selenium drives the browser: pip install selenium')

ESCAPE, END, HOME, LEFT, RIGHT, DOWN = '\ue00c', '\ue010', '\ue011', '\ue012', '\ue014', '\ue015'
F9, F10, CONTROL, SHIFT, ALT = '\ue039', '\ue03a', '\ue009', '\ue008', '\ue00a'

pytestmark = NEEDS_BROWSER

INSPECT = """\
<root BTCPP_format="4" main_tree_to_execute="Inspect">
  <BehaviorTree ID="Inspect">
    <Sequence>
      <Fallback>
        <ComputePathToPose goal="{goal}" path="{path}"/>
        <Wait wait_duration="2.0"/>
      </Fallback>
      <Parallel success_count="2">
        <FollowPath path="{path}"/>
        <Spin spin_dist="6.28"/>
      </Parallel>
    </Sequence>
  </BehaviorTree>
</root>
"""
MENDED = INSPECT.replace('Parallel success_count="2"', 'Sequence').replace('Parallel', 'Sequence')
MENDED = MENDED.replace('        <Wait wait_duration="2.0"/>\n', '')
LONG = '\n'.join(
    [
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Parallel success_count="7">',
        *(f'<RetryUntilSuccessful num_attempts="9"><Wait name="w{one}"/></RetryUntilSuccessful>' for one in range(7)),
        '</Parallel></BehaviorTree></root>\n',
    ]
)
NEVER = """\
<root BTCPP_format="4" main_tree_to_execute="A">
  <BehaviorTree ID="A">
    <Fallback>
      <AlwaysSuccess/>
      <Wait name="late"/>
      <SubTree ID="B"/>
    </Fallback>
  </BehaviorTree>
  <BehaviorTree ID="B">
    <Sequence>
      <Wait/>
      <Spin/>
    </Sequence>
  </BehaviorTree>
</root>
"""
MACHINE = """\
machine:
  outcomes: [finished, failed]
  states:
    Drive:
      machine:
        outcomes: [done]
        states:
          Go: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: done}}
      transitions: {done: Rest}
    Rest: {state: WaitState, parameters: {wait_time: 2.0}, transitions: {done: finished}}
"""
_STATUSES = (
    'return Object.fromEntries([...document.querySelectorAll("#picture [data-path]")].flatMap((one) => '
    '[...one.classList].filter((name) => name.startsWith("st-")).map((name) => [one.dataset.path, name.slice(3)])))'
)
_SPOKEN = (
    'return Object.fromEntries([...document.querySelectorAll("#picture [aria-description]")].map((one) => '
    '[one.dataset.path, one.getAttribute("aria-description")]))'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    texts = {'inspect.xml': INSPECT, 'long.xml': LONG, 'never.xml': NEVER, 'drive.yaml': MACHINE}
    for file, text in texts.items():
        (tmp_path / file).write_text(text)
    return tmp_path


def tool(*words: str, name: str = 'bt_tool') -> list[str]:
    """Return the lines that a command of the tools prints."""
    call = f'import sys; from flexbt_tools.executables import {name}; sys.exit({name}())'
    command = [sys.executable, '-P', '-c', call, *words]
    return subprocess.run(command, check=False, capture_output=True, text=True).stdout.splitlines()


def shown(page: StudioPage) -> dict[str, str]:
    """Return the statuses on the graph by path."""
    found: dict[str, str] = page.run(_STATUSES)
    return found


def expected(page: StudioPage, statuses: dict[str, str]) -> dict[str, str]:
    """Return the statuses of a run by the paths of the graph: the engine numbers the nodes as the graph orders them."""
    paths = page.run('return [...document.querySelectorAll("#picture .node")].map((one) => one.dataset.path)')
    nodes = [path for path in paths if '/' in path]
    return {nodes[int(path.partition('::')[2]) - 1]: status.lower() for path, status in statuses.items()}


def rewrite(page: StudioPage, text: str) -> None:
    """Put another text into the plain text pane, as if it was pasted."""
    page.run(
        'const field = document.querySelector("#text textarea"); field.value = arguments[0];'
        'field.dispatchEvent(new Event("input", {bubbles: true}))',
        text,
    )


def set_field(page: StudioPage, id: str, value: str, event: str = 'change') -> None:
    """Fill in a field."""
    page.run(
        'const [id, value, kind] = arguments, field = document.getElementById(id);'
        'field.value = value; field.dispatchEvent(new Event(kind))',
        id,
        value,
        event,
    )


def play(page: StudioPage, text: str) -> None:
    """Press the button with this text in the panel of proofs and runs, and wait for the player."""
    page.run(
        '[...document.querySelectorAll("#runs button")].find((one) => one.textContent.includes(arguments[0])).click()',
        text,
    )
    page.until(lambda: page.focused == 'player-line')


def children() -> list[str]:
    """Return the processes of jobs that this process has started and that are still there."""
    found = []
    for tasks in Path('/proc/self/task').glob('*/children'):
        with contextlib.suppress(OSError):  # a thread or a process that has just ended
            for child in tasks.read_text().split():
                found += [child] if b'flexbt_tools' in Path('/proc', child, 'cmdline').read_bytes() else []
    return found


def test_a_proof_is_told_played_and_repeated_on_save(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        page.press(F9)
        page.until_text('proof', 'not proven: 2 wrong')
        proof = json.loads(tool('prove', str(folder / 'inspect.xml'), '--json')[0])['proofs'][0]
        for one in proof['wrong']:
            play(page, one['text'])
            for number, step in enumerate(one['steps']):
                page.until_text('player-told', step['step'])
                assert shown(page) == expected(page, step['statuses']), number
                assert all(line in page.text('player-told') for line in step['lines'])
                page.press(RIGHT)
            assert one['text'] in page.text('player-told')
            first = 'return document.querySelector("#picture [class*=st-]").getAttribute("aria-description")'
            assert page.run(first) == one['steps'][-1]['statuses']['Sequence::1'].replace('IDLE', 'HALTED')
            page.press(HOME, '.', ',', '.')
            page.until_text('player-count', '2 of')
            page.press(ESCAPE)
            assert shown(page) == {}
        play(page, proof['wrong'][0]['text'])
        rewrite(page, MENDED)  # what is played is not of this text any more
        page.until_text('proof', 'not proved since the change')
        assert shown(page) == {} and page.run('return document.getElementById("player").hidden')
        page.chord(CONTROL, 's')
        page.until_text('proof', 'proved: nothing wrong (')
        assert '(6 of 6 reached)' in page.text('proof')


MOMENTS = """
const {Player} = await import('./player.js');
const player = new Player({follow() {}, paint() {}, name: () => ''});
const moment = (time) => ({title: '', lines: [], time, statuses: () => new Map()});
player.play('', [0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(moment), {isLive: true, owner: {}});
const shown = [];
for (const [at, later] of [[8, 306], [0, 400]]) {
  player.go(at);
  player.push(moment(later));
  shown.push(player.moments[player.at].time);
}
return shown;
"""


def test_who_looks_at_an_earlier_moment_goes_on_to_do_so(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        assert page.run(MOMENTS) == [8, 306], 'of a moment that is gone, the first that is kept'


def test_a_change_of_another_file_that_a_proof_has_read_makes_it_old(
    page: StudioPage, other: StudioPage, folder: Path
) -> None:
    tree = '<root BTCPP_format="4" main_tree_to_execute="{0}"><BehaviorTree ID="{0}">{1}</BehaviorTree>{2}</root>'
    far = tree.format('Far', '<AlwaysSuccess/>', '')
    more = '<BehaviorTree ID="Other"><SubTree ID="Far"/></BehaviorTree>'
    (folder / 'far.xml').write_text(far)
    (folder / 'two.xml').write_text(tree.format('Two', '<AlwaysSuccess/>', more))
    with served(folder, None) as port:
        page.open(port, 'two.xml')
        set_field(page, 'requirements', 'never =FAILURE')
        page.press(F9)
        page.until_text('proof', 'proved: nothing wrong (')
        fresh = folder / 'fresh'
        for text, verdict in ((far.replace('Success', 'Failure'), 'not proven'), (far, 'proved: nothing wrong (')):
            fresh.write_text(text)  # another program
            fresh.replace(folder / 'far.xml')
            page.until_text('proof', 'not proved since the change')
            page.press(F9)
            page.until_text('proof', verdict)
        other.open(port, 'far.xml')  # which this page has not opened
        rewrite(other, far := far.replace('</root>', '<!-- other --></root>'))
        page.until_text('proof', 'not proved since the change')
        page.press(F9)
        page.until_text('proof', 'proved: nothing wrong (')
        page.go('far.xml')
        page.until(lambda: page.shown_text == far)
        rewrite(page, far.replace('</root>', '<!-- changed --></root>'))
        page.go('two.xml')
        page.until_text('proof', 'not proved since the change')


def test_an_edit_ends_a_proof_with_its_process(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'long.xml')
        for _ in range(2):  # the second proof replaces the first
            page.press(F9)
            page.until(lambda: len(children()) == 1)
        assert page.text('proof') == 'proving…'
        rewrite(page, LONG + '<!-- more -->')
        page.until(lambda: page.text('proof') == 'Prove')
        page.until(lambda: children() == [])
        page.press(F9)
        page.until(lambda: len(children()) == 1)
        page.run('document.getElementById("proof-cancel").click()')
        page.until(lambda: page.text('proof') == 'Prove')
        page.until(lambda: children() == [])


def test_an_edit_ends_the_proofs_that_read_the_file_and_no_others(page: StudioPage, folder: Path) -> None:
    far = '<root BTCPP_format="4"><BehaviorTree ID="Far"><AlwaysSuccess/></BehaviorTree></root>'
    long = LONG.replace('</Parallel>', '<SubTree ID="Far"/></Parallel>')
    (folder / 'far.xml').write_text(far)
    (folder / 'long.xml').write_text(long)
    with served(folder, None) as port:
        page.open(port, 'long.xml')
        page.press(F9)
        page.until(lambda: len(children()) == 1)
        for file, text, is_read in (('never.xml', NEVER, False), ('far.xml', far, True)):
            page.go(file)
            page.until(lambda: page.shown_text == text)  # noqa: B023
            rewrite(page, text + '<!-- more -->')
            page.go('long.xml')
            page.until(lambda: page.shown_text == long)
            assert (page.text('proof') == 'Prove') is is_read
        page.until(lambda: children() == [])


def test_a_requirement_of_a_machine_is_proved_and_played(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'drive.yaml')
        set_field(page, 'requirements', 'never =finished')
        page.press(F9)
        page.until_text('proof', 'not proven: 1 wrong')
        play(page, '=finished')
        page.press(RIGHT)
        page.until_text('player-count', '2 of')
        page.until(lambda: shown(page) == {'/': 'running', '/Drive': 'running', '/Drive/Go': 'running'})
        page.press(ESCAPE)
        set_field(page, 'requirements', 'never =other')
        page.until_text('proof', 'not proved since the change')
        set_field(page, 'requirements', 'never =finished')
        page.driver.refresh()
        page.until(lambda: page.run('return document.getElementById("requirements").value') == 'never =finished')
    # A file of the same name of another project, at the same address, has its own.
    other = folder.with_name('other')
    shutil.copytree(folder, other)
    with served(other, None, port):
        page.open(port, 'drive.yaml')
        assert page.run('return document.getElementById("requirements").value') == ''


def test_what_is_never_reached_is_tinted_and_folded_parts_show_what_is_in_them(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'never.xml')
        page.press(F9)
        page.until_text('proof-told', 'never: 5')
        never = dict.fromkeys(('A/0/1', 'A/0/2', 'B/0', 'B/0/0', 'B/0/1'), 'never')
        assert shown(page) == never
        page.run('document.getElementById("tint-never").click()')
        assert shown(page) == {}
        page.press(F10)
        page.until(lambda: page.focused == 'player-line')
        page.until_text('run-told', '1 run reached 2 of 7 nodes')
        page.press(ESCAPE)
        page.run('document.getElementById("tint-dry").click()')
        assert shown(page) == never
        page.click('A/0')
        page.press(' ', F10)
        page.until(lambda: page.focused == 'player-line')
        page.press(END)
        description = 'return document.querySelector("#picture [data-path=\'A/0\']").getAttribute("aria-description")'
        page.until(lambda: page.run(description) == 'SUCCESS · inside 1 ')


def test_a_dry_run_is_that_of_the_tool_and_its_time_is_a_line(page: StudioPage, folder: Path) -> None:
    plan = folder / 'plan.yaml'
    fails = '{gives: FAILURE, after: 1.5, reason: ""}'
    plan.write_text(
        f'mocks:\n  ComputePathToPose: [{fails}]\n  Wait: [{{gives: SUCCESS, after: 0.25}}]\n'
        '  Spin: [{gives: SUCCESS, after: 60}]\n  FollowPath: FAILURE\nblackboard: {speed: 0.5}\n'
    )
    printed = tool('run', str(folder / 'inspect.xml'), '--mock', str(plan))
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        page.run('document.getElementById("run-job").open = true')
        page.until(lambda: page.run('return document.querySelectorAll(".mock").length') == 4)
        for row, does, seconds in ((0, 'fails', 1.5), (1, 'succeeds', 0.25), (2, 'fails', 0), (3, 'succeeds', 60)):
            page.run(
                'const [row, does, seconds] = arguments, line = document.querySelectorAll(".mock")[row];'
                'const set = (one, value) => { one.value = value; one.dispatchEvent(new Event("change")); };'
                'set(line.querySelector("select"), does); set(line.querySelector("span > input"), seconds)',
                row,
                does,
                seconds,
            )
        set_field(page, 'board', 'speed: 0.5')
        page.press(F10)
        page.until(lambda: page.focused == 'player-line')
        lines = page.run('return [...document.querySelectorAll("#run-lines > li")].map((one) => one.textContent)')
        end = next(number for number, line in enumerate(printed) if line.startswith('blackboard'))
        assert lines == printed[:end] and end > 10
        # The line is of seconds: a place on it is the last moment before.
        set_field(page, 'player-line', '1.6', 'input')
        page.until_text('player-count', '1.500 s')
        assert shown(page)['Inspect/0/0/0'] == 'failure' and shown(page)['Inspect/0/0/1'] == 'running'
        page.press(END)
        page.until_text('player-told', 'speed = 0.5')
        assert printed[end - 1].strip() in page.text('player-told')
        assert shown(page)['Inspect/0/0'] == 'success' and shown(page)['Inspect/0'] == 'failure'
        set_field(page, 'board', '[wrong')
        page.press(F10)
        page.until_text('run-told', 'mocks.yaml')


def test_a_dry_run_waits_for_what_its_tree_needs(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        page.run('document.getElementById("run-job").open = true')
        page.until(lambda: page.run('return document.querySelectorAll(".mock").length') == 4)
        with held(monkeypatch, 'mocks') as asked:
            page.go('never.xml')
            assert asked.wait(DEADLINE)
            page.until_selected('A')
            page.press(F10)
        page.until(lambda: page.focused == 'player-line')
        page.until_text('run-told', '1 run reached')


def test_statuses_and_the_use_of_a_key_are_spoken_together(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        page.press(F10)
        page.until(lambda: page.focused == 'player-line')
        page.press(END)
        statuses = page.run(_SPOKEN)
        assert statuses['Inspect/0/0/0'] == 'SUCCESS'
        page.click('Inspect/0/0/0')
        page.press('k')
        page.until(lambda: 'goal' in page.text('flow'))
        assert page.run(_SPOKEN) == statuses
        page.press(DOWN)
        page.until(lambda: page.run(_SPOKEN) == statuses | {'Inspect/0/0/0': 'SUCCESS · reads key goal'})
        page.click('Inspect/0/0/0')
        page.press('k')
        assert page.run(_SPOKEN) == statuses


def test_a_comparison_tells_what_a_change_does_until_it_is_saved(
    page: StudioPage, other: StudioPage, folder: Path
) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        page.click('Inspect/0/0')
        page.press('w')
        page.until(lambda: page.focused == 'choice-field')
        page.press('Sequence', '\ue007')
        page.until_told('wrapped in')
        page.chord(CONTROL, SHIFT, 'S')
        page.until_sheet('tree Inspect: behaves the same')
        page.press(ESCAPE)
        page.press('u')
        page.until_told('its children took its place')
        page.click('Inspect/0/0/0')
        page.chord(ALT, DOWN)
        page.until_selected('Inspect/0/0/1')
        page.chord(SHIFT, F9)
        page.until_text('compare-told', 'difference')
        page.chord(CONTROL, SHIFT, 'S')
        page.until_sheet('Wait begins')
        page.run('document.querySelector("#sheet-change button").click()')
        page.until(lambda: page.focused == 'player-line')
        page.press(END)
        page.until_text('player-told', '✗ on disk: ComputePathToPose begins')
        assert shown(page) == {'Inspect/0': 'running', 'Inspect/0/0': 'running', 'Inspect/0/0/0': 'running'}
        other.open(port, 'inspect.xml')
        other.chord(CONTROL, 's')  # of the change of the other page
        page.until_text('compare-told', 'that on disk, has changed')
        assert shown(page) == {}
        page.chord(SHIFT, F9)
        page.until_text('compare-told', 'behaves the same')
        page.chord(CONTROL, 's')
        page.until_text('compare-told', 'that on disk, has changed')
        rewrite(page, f'{page.shown_text}<!-- unsaved -->')
        page.until(page.has_changes)
        page.chord(SHIFT, F9)
        page.until_text('compare-told', 'behaves the same')
        (folder / 'inspect.xml').write_text(MENDED)
        page.until_text('compare-told', 'that on disk, has changed')


def choose(page: StudioPage, node: str) -> None:
    """Click the name of a node beside its lane."""
    exceptions = pytest.importorskip('selenium.common.exceptions')

    def is_clicked() -> bool:
        rows = page.driver.find_elements('css selector', '#player-lanes .row-name')
        try:
            next(row for row in rows if node in (row.get_attribute('textContent') or '')).click()
        except exceptions.StaleElementReferenceException:  # the lanes were drawn again
            return False
        return True

    page.until(is_clicked)


class Robots:
    """One robot, whose messages are those of the test; what LiveRobots uses of FleetLink."""

    def __init__(self) -> None:
        self.mirror = Mirror(SteadyClock())
        self.fleet = Fleet()
        self.fleet.add('base', self.mirror)
        self.own = 'base'
        self._sequence = 0
        self._names: list[str] = []
        self._structure = 0

    def open(self, name: str, operator: str = '') -> None:
        """Watch the robot."""

    close = open

    def robot(self, name: str) -> list[Any]:
        """Return its mirror."""
        return [self.mirror]

    def show(self, statuses: dict[str, int], *, active: str = '/Rest', point: str = '') -> None:
        """Send a tree with these nodes, an active state of the machine, and a breakpoint at a node."""
        self._sequence += 1
        if [*statuses] != self._names:
            self._names, self._structure = [*statuses], self._structure + 1
            nodes = [MirroredNode(uid, 0, path, '', path) for uid, path in enumerate(statuses, 1)]
            self.mirror.receive_tree_structure(TreeNodes('run', 'Inspect', nodes, 0.0, self._structure))
        values = [*map(MirroredStatus, statuses.values())]
        changes = [StatusChange(0.0, uid, value) for uid, value in enumerate(values, 1)]
        report = TreeReport('run', self._sequence, values, changes, 0.0, False, False, self._structure)
        self.mirror.receive_tree_status(report)
        told = ExecutiveSnapshot('id', 0, 10.0, ExecutiveState.RUNNING, behavior='drive')
        points = (TreeBreakpoint(BreakpointKind.BREAK, 'Inspect', point),) * bool(point)
        told = replace(told, active_states=(ActiveState(active),), tree_breakpoints=points)
        for number in (2 * self._sequence, 2 * self._sequence + 1):  # of one alone the age is not known
            self.mirror.receive_snapshot(replace(told, sequence=number))


def test_a_robot_is_watched_and_its_past_is_kept(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots = Robots()
    monkeypatch.setattr('studio_page.StudioServer', partial(StudioServer, robots=cast(Any, robots)))
    names = (
        *('Sequence::1', 'Fallback::2', 'ComputePathToPose::3', 'Wait::4'),
        *('Parallel::5', 'FollowPath::6', 'Spin::7'),
    )
    begin = dict(zip(names, (1, 1, 1, 0, 0, 0, 0), strict=True))
    later = dict(zip(names, (1, 1, 3, 1, 0, 0, 0), strict=True))
    with served(folder, None) as port:
        page.open(port, 'drive.yaml')
        page.run('document.getElementById("live").click()')
        page.until_text('player-title', 'Robot base')
        robots.show(begin, active='/Drive/Go')
        page.until(lambda: shown(page) == {'/': 'running', '/Drive': 'running', '/Drive/Go': 'running'})
        page.run(
            '[...document.querySelectorAll("#files button")].find((one) => one.textContent === "inspect.xml").click()'
        )
        page.until(lambda: shown(page) == dict.fromkeys(('Inspect/0', 'Inspect/0/0', 'Inspect/0/0/0'), 'running'))
        robots.show(later)
        page.until(lambda: shown(page).get('Inspect/0/0/1') == 'running' and shown(page)['Inspect/0/0/0'] == 'failure')
        robots.show(later, point='Wait::4')
        marks = 'return document.querySelectorAll("#picture .debug-mark").length'
        page.until(lambda: page.run(marks) == 1)
        # Back in time, while the robot goes on: to where the node failed, and to the change before.
        page.until(lambda: page.run('return document.querySelectorAll("#player-lanes .entry.error").length') == 1)
        page.run('document.querySelector("#player-lanes .timeline-body").focus()')
        choose(page, 'ComputePathToPose::3')
        page.press('[')
        page.until_text('player-count', 'PAST')
        page.until(lambda: shown(page).get('Inspect/0/0/0') == 'failure')
        page.press(LEFT)
        page.until(lambda: shown(page).get('Inspect/0/0/0') == 'running')
        assert page.run(marks) == 0  # nothing was set then
        choose(page, 'ComputePathToPose::3')
        robots.show({**later, 'Wait::4': 2})
        page.until(lambda: page.run('return document.getElementById("live").className') == 'good')
        robots.mirror.sender_gone()
        page.until(lambda: page.run('return document.getElementById("live").className') == 'warning')
        assert shown(page)['Inspect/0/0/0'] == 'running'
        page.press(END)
        page.until_text('player-told', 'NO LINK')
        assert shown(page)['Inspect/0/0/1'] == 'success'
        # Another version of the tree is shown nowhere.
        robots.show({**later, 'Spin::8': 1})
        page.until_text('player-told', 'the robot runs another version of the tree Inspect')
        assert shown(page) == {}
        robots.show(later)
        page.until(lambda: shown(page).get('Inspect/0/0/1') == 'running')
        rewrite(page, MENDED)
        page.until_text('player-told', 'another version of the tree')
        page.press(ESCAPE)
        page.until(lambda: page.run('return document.getElementById("live").getAttribute("aria-pressed")') == 'false')


def lanes(page: StudioPage) -> list[str]:
    """Return what is on the lanes."""
    script = 'return [...document.querySelectorAll("#player-lanes .entry title")].map((one) => one.textContent)'
    return [title.split()[1] for title in page.run(script)]


def test_a_robot_that_a_new_server_has_not_found_yet_is_shown_as_old(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots = Robots()
    monkeypatch.setattr('studio_page.StudioServer', partial(StudioServer, robots=cast(Any, robots)))
    with served(folder, None) as port:
        page.open(port, 'drive.yaml')
        page.run('document.getElementById("live").click()')
        page.until_text('player-title', 'Robot base')
        robots.show({'Sequence::1': 1}, active='/Drive/Go')
        page.until(lambda: shown(page).get('/Drive/Go') == 'running')
        page.until(lambda: 'Go' in lanes(page))
    page.until_text('player-told', 'NO LINK')
    again = Robots()
    again.fleet = Fleet()
    monkeypatch.setattr('studio_page.StudioServer', partial(StudioServer, robots=cast(Any, again)))
    with served(folder, None, port):
        page.until_text('player-told', "NO LINK, last known state (no robot 'base' was found")
        again.fleet.add('base', again.mirror)
        again.show({'Sequence::1': 1}, active='/Drive')
        page.until(lambda: shown(page) == {'/': 'running', '/Drive': 'running'})
        assert 'NO LINK' not in page.text('player-told')
        page.until(lambda: 'Sequence::1' in lanes(page) and 'Go' not in lanes(page))  # of the new server


def test_what_was_asked_about_one_recording_is_not_shown_of_the_next(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        titles, entries = page.run("""
            const {Player} = await import('./player.js'), later = [];
            const at = {begin: 0, end: 1, word: '', tone: '', text: '', count: 1};
            const entry = (key) => ({...at, number: 1, lane: 'states', key, label: key});
            const lanes = (name) => ({entries: [entry(name)], revision: 1, begin: 0, end: 9, wall: null, live: false});
            const moment = (title) => ({title, lines: [], time: 0, statuses: () => new Map()});
            let name = 'first';
            const answer = (make, own = make(name)) => new Promise((done) => later.push(() => done(own)));
            const owner = {lanes: () => answer(lanes), at: () => answer(moment)};  // one for all, as in the studio
            const player = new Player({follow() {}, paint() {}, name: () => ''});
            const play = () => player.play(name, [moment(name)], {isLive: true, owner});
            const arrive = async (asked) => { for (const one of asked) { one(); await new Promise(setTimeout); } };
            play();
            await arrive(later.splice(0));  // its lanes; then its first moment is asked for
            player.askLanes();
            const slow = later.splice(0);
            name = 'last';
            player.end();
            play();
            await arrive(later.splice(0));
            await arrive(later.splice(0));
            await arrive(slow);
            const shown = [player.past?.title, [...player.timeline.entries.values()].map((one) => one.label)];
            player.end();
            return shown;
        """)
        assert (titles, entries) == ('last', ['last'])


def test_a_pause_that_comes_just_after_one_does_not_let_the_robot_go_on(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        sent, told = page.run("""
            const {Debugger} = await import('./debugger.js'), sent = [], told = [];
            const studio = {file: {view: {states: []}}}, known = {};
            const on = {draw() {}, do: (line) => sent.push(line), told: (text) => told.push(text)};
            const one = Object.assign(Object.create(Debugger.prototype), {studio, known, turned: -Infinity, ...on});
            for (const line of ['pause', 'resume']) {
              one.takeParts({actions: {pause: {lines: [line]}}});
              await one.pause();
            }
            return [sent, told];
        """)
        assert sent == ['pause'] and 'just come to mean "resume"' in told[0]


def test_what_is_answered_about_one_robot_or_tree_is_sent_to_no_other(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'inspect.xml')
        sent, told = page.run("""
            const {Debugger} = await import('./debugger.js'), sent = [], told = [];
            const on = {draw() {}, do: (line) => sent.push(line), told: (text) => told.push(text)};
            const trees = [{run: 'r1', tree: 'A', running: true}, {run: 'r2', tree: 'B', running: true}];
            const event = {points: [], holds: [{run: 'r1', tree: 'A'}], trees}, live = {places: () => ({nodes: {}})};
            const known = {decisions: [{path: '/A'}, {path: '/B'}]};
            const one = Object.assign(Object.create(Debugger.prototype), {studio: {}, live, event, known, ...on});
            one.target = async () => ({tree: 'A', path: 'Go', run: 'r1'});
            const field = document.getElementById('choice-field'), turn = () => new Promise((done) => setTimeout(done));
            const answered = async (text, ask, meanwhile) => {
              const done = ask();
              while (!field.onkeydown) await turn();
              meanwhile();
              field.value = text;
              field.oninput();
              field.onkeydown(new KeyboardEvent('keydown', {key: 'Enter'}));
              await done;
            };
            const asks = [() => one.toggle(true), () => one.give('force'), () => one.change()];
            const choices = [() => one.pause(), async () => { if (await one.decision()) sent.push('a decision'); }];
            for (const ask of [...asks, ...choices]) {
              one.robot = 'base';
              await answered(choices.includes(ask) ? 'A' : 'SUCCESS', ask, () => { one.robot = 'simulation'; });
            }
            const other = {...event, holds: [{run: 'r2', tree: 'B'}]};
            await answered('x:=1', () => one.change(), () => { one.event = other; });
            return [sent, told];
        """)
        assert sent == ['tree set x:=1 --run r1']
        assert told == ['base is not watched any more; nothing was sent'] * 5
