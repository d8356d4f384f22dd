# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool run`` begins with a blackboard from a file, and leaves one."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes
from flexbt_testing.behavior_trees.bt_tool import Done, document, tool
from flexbt_tools.errors import UsageError
from flexbt_tools.mock_runs.mock_run import save_blackboard

COUNTING = document(
    'Main: <Sequence><Sleep msec="{wait}"/><Script code="n := n + 1; last := text"/>'
    '<SubTree ID="Inner" q="{q}"/></Sequence>',
    'Inner: <LoopDouble queue="{q}" value="{v}"><Script code="sum := v"/></LoopDouble>',
)


def run(directory: Path, tree: str, before: Any, *words: str) -> Done:
    (directory / 'tree.xml').write_text(tree)
    (directory / 'in.json').write_text(before if isinstance(before, str) else json.dumps(before))
    files = ['--blackboard', str(directory / 'in.json'), '--save-blackboard', str(directory / 'out.json')]
    return tool('run', str(directory / 'tree.xml'), '--quiet', *files, *words)


def saved(directory: Path) -> Any:
    return json.loads((directory / 'out.json').read_text())


def test_what_one_run_saves_the_next_begins_with(tmp_path: Path) -> None:
    before = {
        'n': 1,
        'text': 'hello',
        'wait': 5,
        'q': '1.5;2.5',
        'later': None,
        'level': {'type': 'uint8_t', 'value': 7},
    }
    assert run(tmp_path, COUNTING, before).code == 0
    after = saved(tmp_path)
    assert after == {
        **before,
        'n': 2,
        'last': 'hello',
        # The type of the port stays.
        'wait': {'type': 'unsigned int', 'value': 5},
    }
    assert run(tmp_path, COUNTING, after).code == 0
    assert saved(tmp_path) == after | {'n': 3}
    # What the command line says counts more.
    assert run(tmp_path, COUNTING, after, '--set', 'n=40').code == 0
    assert saved(tmp_path)['n'] == {'type': 'int', 'value': 41}  # as --set has made it


def test_a_script_from_the_file_is_what_a_tree_is_made_of(tmp_path: Path) -> None:
    done = run(tmp_path, document('Main: <Script code="{code}"/>'), {'code': 'x := 6 * 7'})
    assert done.code == 0
    assert saved(tmp_path) == {'code': 'x := 6 * 7', 'x': 42}


def test_messages_are_read_and_written(tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    pose = {'__type': 'geometry_msgs/msg/PoseStamped', 'header': {'frame_id': 'map'}}
    assert run(tmp_path, document('Main: <AlwaysSuccess/>'), {'goal': pose}).code == 0
    goal = saved(tmp_path)['goal']
    assert (goal['__type'], goal['header']['frame_id'], goal['pose']['orientation']['w']) == (
        'geometry_msgs/msg/PoseStamped', 'map', 1.0
    )  # fmt: skip


@pytest.mark.parametrize(
    ('before', 'fragment'),
    [
        ('{', 'Expecting property name'),
        ('[1]', 'expected an object'),
        ({'x': {'a': 1}}, 'entry [x]'),
        ({'wait': 'soon', 'n': 0, 'q': '', 'text': ''}, 'soon'),
        ({'wait': {'type': 'Nothing'}}, "'Nothing' is not known"),
        ('[' * 100_000, 'nested'),
    ],
)
def test_a_file_that_does_not_fit_is_a_usage_error_that_names_it(tmp_path: Path, before: Any, fragment: str) -> None:
    done = run(tmp_path, COUNTING, before)
    assert done.code in (2, 4), done
    assert fragment in done.err + done.out
    assert done.code == 4 or 'in.json' in done.err


def test_files_that_cannot_be_read_or_written_are_named(tmp_path: Path) -> None:
    tree = tmp_path / 'tree.xml'
    tree.write_text(document('Main: <AlwaysSuccess/>'))
    done = tool('run', str(tree), '--blackboard', str(tmp_path / 'none.json'))
    assert (done.code, 'none.json' in done.err) == (2, True)
    done = tool('run', str(tree), '--save-blackboard', str(tmp_path / 'no' / 'out.json'))
    assert (done.code, 'out.json' in done.err) == (2, True)


def test_a_failed_run_saves_as_well_and_what_cannot_be_saved_is_told(tmp_path: Path) -> None:
    (tmp_path / 'tree.xml').write_text(document('Main: <Sequence><Script code="x := 1"/><AlwaysFailure/></Sequence>'))
    done = tool(
        'run', str(tmp_path / 'tree.xml'), '--save-blackboard', str(tmp_path / 'out.json'), '--set', 'd=2020-01-01'
    )
    assert done.code == 1
    assert saved(tmp_path) == {'x': 1}
    assert 'not saved: entry [d]: a date has no JSON form' in done.err


def test_a_blackboard_that_does_not_fit_onto_the_disk_leaves_the_file_that_was_there(tmp_path: Path) -> None:
    file, board = tmp_path / 'out.json', Blackboard()
    file.write_text('{}')
    board.set('text', 'x' * 200_000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(UsageError, match=r'--save-blackboard .*out\.json: .*File too large'):
            save_blackboard(board, str(file), JsonTypes())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert saved(tmp_path) == {}


def test_without_ros_all_but_messages_works(tmp_path: Path) -> None:
    (tmp_path / 'tree.xml').write_text(document('Main: <Script code="x := 1"/>'))
    program = (
        "import sys; sys.modules['rclpy'] = None\n"
        'from flexbt_tools.cli.bt_tool import main\n'
        f"sys.exit(main(['run', {str(tmp_path / 'tree.xml')!r}, '--save-blackboard', {str(tmp_path / 'out.json')!r}]))"
    )
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert saved(tmp_path) == {'x': 1}
