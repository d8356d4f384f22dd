# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool`` as a program: without ROS, in pipes, and as its page of the reference has it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import NoReturn

import pytest

from flexbt_testing.behavior_trees.bt_tool import document, tool
from flexbt_tools.cli.bt_tool import COMMANDS, EXIT_CODES, main
from flexbt_tools.cli.command import ENTRY_POINTS
from flexbt_tools.errors import ExitCode
from flexbt_tools.tree_checks.diagnostics import RULES

PAGE = (Path(__file__).parents[3] / 'docs' / 'reference' / 'bt_tool.md').read_text(encoding='utf-8')

WITHOUT_ROS = """
import sys

class Guard:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {'rclpy', 'builtin_interfaces', 'geometry_msgs', 'ament_index_python'}:
            raise ModuleNotFoundError(f'No module named {name!r}')

sys.meta_path.insert(0, Guard())
from flexbt_tools.cli.bt_tool import main
sys.exit(main(sys.argv[1:]))
"""


LOADED = """
import sys
from flexbt_tools.cli.bt_tool import main
main(sys.argv[1:])
print('\\n'.join(sys.modules))
"""


def write(directory: Path, tree: str) -> str:
    file = directory / 'tree.xml'
    file.write_text(document(f'Main: {tree}'), encoding='utf-8')
    return str(file)


def without_ros(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-c', WITHOUT_ROS, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_it_works_where_there_is_no_ros(tmp_path: Path) -> None:
    note = r"(note: without the nodes of flexbt_[^\n]+: No module named '\w+'\n)+"
    tree = write(tmp_path, '<Sequence><RateController hz="1"><AlwaysSuccess/></RateController><Wait/></Sequence>')
    done = without_ros('check', tree)
    assert done.returncode == 1
    assert re.fullmatch(f'{note}1 file: 1 error\n', done.stderr), done.stderr
    assert 'node type [Wait] is not registered' in done.stdout
    assert without_ros('show', tree).stdout.splitlines()[1:] == [
        'Sequence',
        '├─ RateController  hz=1',
        '│  └─ AlwaysSuccess',
        '└─ Wait',
    ]
    assert without_ros('run', tree, '--mock', 'Wait=SUCCESS', '--quiet').stdout == 'SUCCESS after 0.000 s and 1 tick\n'
    models = tmp_path / 'models.xml'
    models.write_text(tool('model').out)
    clean = without_ros('check', '--models', str(models), tree).stderr
    assert re.fullmatch(f'{note}1 file: no problems found\n', clean), clean


def test_commands_of_another_package_are_loaded_only_to_be_run(tmp_path: Path) -> None:
    command = [sys.executable, '-c', LOADED, 'show', write(tmp_path, '<AlwaysSuccess/>')]
    loaded = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout.splitlines()
    assert 'flexbt_tools.cli.bt_tool' in loaded
    assert not [name for name in loaded if name.startswith('flexbt_formal.cli')]


def test_ctrl_c_while_such_a_command_is_loaded_ends_it_quietly(monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(EntryPoint):
        def load(self) -> NoReturn:
            raise KeyboardInterrupt

    added = [Interrupted('bt_tool.prove', 'flexbt_formal.cli.prove_tree', ENTRY_POINTS)]
    monkeypatch.setattr('flexbt_tools.cli.command.entry_points', lambda group: added)
    assert tool('prove', 'any.xml') == (ExitCode.INTERRUPTED, '', '')


def test_an_include_from_a_package_needs_ros(tmp_path: Path) -> None:
    file = tmp_path / 'tree.xml'
    file.write_text(document('Main: <AlwaysSuccess/>').replace('<Beh', '<include ros_pkg="a" path="b.xml"/>\n<Beh'))
    done = without_ros('check', str(file))
    assert f"{file}:2:22: error: <include>: 'b.xml' cannot be included: packages are found by ROS" in done.stdout
    here = tool('check', str(file)).out
    assert f"{file}:2:22: error: <include>: 'b.xml' cannot be included: a/b.xml: no installed package 'a'" in here


@pytest.mark.parametrize('is_pipe', [True, False])
def test_a_pipe_or_device_is_refused_by_every_command(tmp_path: Path, is_pipe: bool) -> None:
    tree = write(tmp_path, '<AlwaysSuccess/>')
    file = str(tmp_path / 'pipe') if is_pipe else '/dev/zero'
    if is_pipe:
        os.mkfifo(file)  # opening it would wait for ever
    (tmp_path / 'scene.actions.jsonl.gz').symlink_to(file)
    (tmp_path / 'including.xml').write_text(f'<root BTCPP_format="4"><include path="{file}"/></root>')
    for words in (
        ('check', file),
        ('check', str(tmp_path / 'including.xml')),
        ('check', tree, '--models', file),
        ('check', tree, '--skills', file),
        ('draw', file),
        ('log', file),
        ('plan', file),
        ('plan', str(tmp_path / 'scene.json'), '--goal', 'held'),
        ('prove', file),
        ('prove', tree, '--against', file),
        ('prove', tree, '--requirements', file),
        ('run', file),
        ('run', tree, '--blackboard', file),
        ('run', tree, '--mock', file),
        ('show', file),
        ('skills', file),
    ):
        done = tool(*words)
        assert done.code != 0, words
        assert 'it is a pipe or device; give a regular file' in done.out + done.err, (words, done)


def program(*words: str) -> list[str]:
    return [sys.executable, '-m', 'flexbt_tools.cli.bt_tool', *words]


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    tree = write(tmp_path, f'<Sequence>{"<AlwaysSuccess/>" * 20_000}</Sequence>')
    with subprocess.Popen(program('show', tree), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline().startswith('Main')
        process.stdout.close()
        assert process.stderr.read() == ''
    assert process.returncode == 0


def test_an_output_that_does_not_fit_onto_its_disk_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    tree = write(tmp_path, '<AlwaysSuccess/>')
    with open('/dev/full', 'w') as full:  # noqa: PTH123
        monkeypatch.setattr(sys, 'stdout', full)
        assert main(['show', tree]) == ExitCode.USAGE
    assert capfd.readouterr().err == 'bt_tool: the output is not whole: No space left on device\n'


def test_it_reads_from_a_pipe_and_writes_to_one_that_is_not_utf_8() -> None:
    done = subprocess.run(
        program('show', '-'),
        input=document('Main: <Inverter><AlwaysSuccess name="é"/></Inverter>').encode(),
        capture_output=True,
        env=os.environ | {'PYTHONIOENCODING': 'ascii'},
        timeout=60,
        check=True,
    )
    assert done.stdout.splitlines()[1:] == [b'Inverter', b'\\u2514\\u2500 AlwaysSuccess "\\xe9"']
    assert done.stderr == b''


def test_many_deep_sub_trees_can_be_shown_drawn_and_checked(tmp_path: Path) -> None:
    """Deeper than Python's recursion goes."""
    depth = 3000
    trees = [f'T{i}: <Inverter><SubTree ID="T{i + 1}" _autoremap="true"/></Inverter>' for i in range(depth)]
    file = tmp_path / 'deep.xml'
    file.write_text(document(*trees, f'T{depth}: <AlwaysSuccess/>', main='T0'), encoding='utf-8')
    assert tool('check', '--strict', str(file)).code == 0
    assert tool('show', '--expand', str(file)).out.count('SubTree') == depth
    assert tool('show', '--expand', '--json', str(file)).code == 0
    assert tool('draw', '--expand', '--format', 'mermaid', str(file)).out.count(' --> ') == 2 * depth
    assert tool('run', '--quiet', str(file)).code == 0


@pytest.mark.parametrize('command', [command.name for command in COMMANDS])
def test_each_command_has_help_and_is_on_the_page(command: str) -> None:
    done = tool(command, '--help')
    assert done.code == 0
    assert re.search(rf'^\| `{command}[ `]', PAGE, re.MULTILINE)
    documented = set(re.findall(r'--[a-z-]+', PAGE))
    options = set(re.findall(r'--[a-z-]+', done.out)) - {'--help'}
    assert options <= documented, options - documented


def test_the_page_has_the_rules_and_the_exit_codes() -> None:
    for rule in RULES:
        assert f'| `{rule.name}` | {rule.severity.value} | {rule.summary} |' in PAGE
    for code, meaning in EXIT_CODES:
        assert f'| {code} | {meaning} |' in PAGE


def test_the_mocks_of_the_page_are_understood(tmp_path: Path) -> None:
    [text] = re.findall('```yaml\n(.*?)```', PAGE, re.DOTALL)
    (tmp_path / 'mocks.yaml').write_text(text)
    leaves = '<ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/><PathShorterThan/>'
    tree = write(tmp_path, f'<DistanceController><Sequence>{leaves}<Spin/></Sequence></DistanceController>')
    done = tool('run', '--mock', str(tmp_path / 'mocks.yaml'), '--mock', 'PathShorterThan=SUCCESS', tree)
    assert done.code == 1
    assert 'FAILURE after 0.500 s' in done.out
    assert '  reason: [ComputePathToPose::3] no path\n' in done.out
