# SPDX-License-Identifier: BSD-3-Clause
"""``console run-tree``: a tree on a real BT server from a file, with inputs, outputs, reasons and a cancel."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_console.errors import ExitCode
from flexbt_console.ui.line.tree_run import _main_tree
from flexbt_testing.nodes.server_world import ServerWorld, document, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until


@pytest.fixture(scope='module')
def world() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as opened:
        yield opened


def run(file: str | Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = ['console', 'run-tree', str(file), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=DEADLINE)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    file = tmp_path / 'count.xml'
    body = (
        '<Sequence><ComputePathToPose goal="{goal}" path="{path}"/><Script code="n := n + 1"/>'
        '<ScriptCondition code="n &lt; 10"/></Sequence>'
    )
    file.write_text(document(body))
    return file


@pytest.mark.usefixtures('world')
def test_a_tree_runs_with_goal_inputs_and_outputs(tree: Path) -> None:
    ran = run(tree, '--goal', '4.0 4.5 0', '--input', 'n=int64:4', '--output', 'n')
    assert (ran.returncode, ran.stdout) == (ExitCode.OK, 'SUCCESS\n  n = 5\n'), ran.stderr


@pytest.mark.usefixtures('world')
def test_a_failure_has_its_reasons_and_exit_code(tree: Path) -> None:
    ran = run(tree, '--goal', '4.0 4.5 0', '--input', 'n=int64:9', '--json')
    report = json.loads(ran.stdout)
    assert (ran.returncode, report['result'], len(report['reasons'])) == (ExitCode.REFUSED, 'FAILURE', 2)


def test_the_main_tree_is_that_of_the_root() -> None:
    tree = '<BehaviorTree ID="{}"><AlwaysSuccess/></BehaviorTree>'
    text = (
        '<!-- main_tree_to_execute="Old" --><root BTCPP_format="4" main_tree_to_execute="Bob\'s &amp; Co">'
        f'{tree.format("Old")}{tree.format("Bob&apos;s &amp; Co")}</root>'
    )
    assert _main_tree(text, ['Old', "Bob's & Co"]) == "Bob's & Co"


def test_an_interrupt_cancels_the_tree(world: ServerWorld, tree: Path) -> None:
    world.navigation.hold.add('compute_path_to_pose')
    planner = world.navigation.actions['compute_path_to_pose']
    planner.forget()
    command = ['console', 'run-tree', str(tree), '--goal', '1 1 0', '--input', 'n=int64:1']
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        watchdog = threading.Timer(DEADLINE, process.kill)
        watchdog.start()
        wait_until(lambda: planner.goals, 'the goal')
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
        watchdog.cancel()
    world.navigation.hold.clear()
    assert (process.returncode, planner.cancels) == (ExitCode.INTERRUPTED, 1), err
    assert out.startswith('CANCELED'), out


@pytest.mark.usefixtures('world')
@pytest.mark.parametrize(('file', 'options', 'code', 'text'), [
    ('none.xml', (), ExitCode.USAGE, 'no such file on this computer'),
    ('bad.xml', (), ExitCode.REFUSED, 'node type [Sequenc] is not registered; did you mean Sequence'),
    ('two.xml', (), ExitCode.USAGE, 'does not name its main tree; choose one by --tree: A, B'),
    ('bad.xml', ('--input', 'n=int64:x'), ExitCode.REFUSED, 'int64'),
    ('bad.xml', ('--input', 'n'), ExitCode.USAGE, 'expected key=type:value'),
])  # fmt: skip
def test_mistakes_are_reported(tmp_path: Path, file: str, options: tuple[str, ...], code: ExitCode, text: str) -> None:
    (tmp_path / 'bad.xml').write_text(document('<Sequenc/>'))
    trees = ''.join(f'<BehaviorTree ID="{id}"><AlwaysSuccess/></BehaviorTree>' for id in 'AB')
    (tmp_path / 'two.xml').write_text(f'<root BTCPP_format="4">{trees}</root>')
    ran = run(tmp_path / file, *options)
    assert (ran.returncode, text in ran.stderr) == (code, True), ran.stderr
