# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool run``: mocks do what they are told, and what happens is printed."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.values.text import short_repr
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, Done, document, tool, without_marks
from flexbt_testing.behavior_trees.random_trees import wheel_case
from flexbt_tools.errors import ToolError
from flexbt_tools.mock_runs.mock_plan import read_plan
from flexbt_tools.mock_runs.mock_run import MockRun
from flexbt_tools.trees.outline import find_tree


class Drive(StatefulAction):
    """Needs a robot."""

    ports = {'to': input_port(STRING), 'speed': input_port(DOUBLE, default='0.5'), 'way': output_port(INT)}

    def on_start(self) -> NodeStatus:
        raise AssertionError

    on_running = on_start

    def on_halted(self) -> None:
        raise AssertionError


class Look(SyncAction):
    """Needs a camera, where it is not ``real``."""

    ports = {'seen': output_port(STRING)}

    def tick(self) -> NodeStatus:
        self.set_output('seen', 'a cup')
        return NodeStatus.SUCCESS


class Ask(SyncAction):
    """Asks a server, and has its answer within the tick, where it is ``real``."""

    def tick(self) -> NodeStatus:
        answered = WakeEvent()
        answered.set()
        self.wait_in_tick(answered, self.clock, math.inf)
        return NodeStatus.SUCCESS


class Near(Condition):
    def tick(self) -> NodeStatus:
        raise AssertionError


class Twice(Decorator):
    """A decorator of some package, which needs nothing."""

    def tick(self) -> NodeStatus:
        self.tick_child()
        return self.tick_child()


def registry() -> NodeRegistry:
    nodes = builtin_registry()
    nodes.register_classes((Drive, Look, Ask, Near, Twice))
    return nodes


def mock_run(
    *trees: str,
    mocks: str | list[str],
    values: tuple[str, ...] = (),
    directory: Path | None = None,
    read_inputs: bool = False,
) -> tuple[MockRun, list[str]]:
    """Return a tree with mocks (words of the command line, or the text of a file), and the list that its trace goes
    to."""
    if isinstance(mocks, str):
        assert directory is not None
        (directory / 'mocks.yaml').write_text(mocks, encoding='utf-8')
        mocks = [str(directory / 'mocks.yaml')]
    trace: list[str] = []

    def note(time: float, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        if not node.path.startswith(('Sequence', 'Fallback')):
            trace.append(f'{time:g} {node.path} {after.name}')

    library = TreeLibrary([load_xml(document(*trees), 'tree.xml', registry())])
    plan = read_plan(mocks, list(values))
    return MockRun(library, find_tree(library, 'Main'), plan, on_status=note, read_inputs=read_inputs), trace


def test_steps_are_followed_one_for_each_activation(tmp_path: Path) -> None:
    mocks = """
    mocks:
      Drive:
        - {gives: FAILURE, after: 0.25, reason: stuck}
        - SKIPPED
        - {gives: SUCCESS, after: 1, outputs: {way: 7}}
    """
    tree = '<RetryUntilSuccessful num_attempts="3"><Drive name="d" to="x" way="{w}"/></RetryUntilSuccessful>'
    made, trace = mock_run(f'Main: {tree}', mocks=mocks, directory=tmp_path)
    assert made.run(10.0) is NodeStatus.SKIPPED
    assert made.run(10.0) is NodeStatus.SUCCESS
    assert [line for line in trace if ' d ' in line] == [
        '0 d RUNNING', '0.25 d FAILURE', '0.25 d IDLE', '0.25 d RUNNING', '1.25 d SUCCESS', '1.25 d IDLE',
    ]  # fmt: skip
    assert made.tree.blackboard.get('w') == 7
    assert made.run(10.0) is NodeStatus.SUCCESS, 'the last step is repeated'


def test_a_step_that_is_halted_is_used_up() -> None:
    made, trace = mock_run(
        'Main: <Fallback><Timeout msec="500"><Drive name="d" to="x"/></Timeout><Drive name="d" to="x"/></Fallback>',
        mocks=['d=RUNNING,SUCCESS'],
    )
    assert made.run(1.0) is NodeStatus.RUNNING
    assert [line for line in trace if ' d ' in line] == ['0 d RUNNING', '0.5 d IDLE', '0.5 d RUNNING']
    limited = '<ForceSuccess><Timeout msec="500"><Drive to="x"/></Timeout></ForceSuccess>'
    again, _ = mock_run(f'Main: <Repeat num_cycles="2">{limited}</Repeat>', mocks=['Drive=RUNNING,SUCCESS'])
    assert again.run(10.0) is NodeStatus.SUCCESS
    assert again.time == 0.5


def test_a_synchronous_leaf_is_activated_by_every_tick() -> None:
    made, _ = mock_run('Main: <Twice><Near/></Twice>', mocks=['Near=SUCCESS,FAILURE'])
    assert made.run(1.0) is NodeStatus.FAILURE
    stateful, _ = mock_run('Main: <Twice><Drive to="x"/></Twice>', mocks=['Drive=SUCCESS,FAILURE'])
    assert stateful.run(1.0) is NodeStatus.SUCCESS, 'the result of an action that has completed stands'


@pytest.mark.parametrize(
    ('mocks', 'expected'),
    [
        (['*=SUCCESS', 'Drive=FAILURE'], 'FF'),
        (['Drive=FAILURE', 'left/go=SUCCESS'], 'SF'),
        (['go=FAILURE', 'left/*=SUCCESS'], 'FF'),  # a name in full counts more
        (['*ight/*=FAILURE', '*=SUCCESS'], 'SF'),
        (['left=SUCCESS', 'go=FAILURE'], 'SF'),
        (['Arm=SUCCESS'], 'SS'),
        (['*[t]/go=FAILURE', '*=SUCCESS'], 'SS'),  # brackets stand for themselves
    ],
)
def test_names_types_paths_and_wildcards(mocks: list[str], expected: str) -> None:
    made, _ = mock_run(
        'Main: <Sequence><ForceSuccess><SubTree ID="Arm" name="left"/></ForceSuccess>'
        '<SubTree ID="Arm" name="right"/></Sequence>',
        'Arm: <Sequence name="go"><AlwaysSuccess/><Drive name="go" to="x"/></Sequence>',
        mocks=mocks,
    )
    results: dict[str, str] = {}

    def note(node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        results[f'{node.path} {after.name}'] = after.name

    made.tree.observe(note)
    made.run(1.0)
    shown = ''.join('S' if f'{arm} SUCCESS' in results else 'F' for arm in ('left', 'right'))
    assert shown == expected


def test_controls_and_the_leaves_of_the_engine_run_as_they_are() -> None:
    """Also when a rule has the name of a control, as in Nav2's trees."""
    tree = '<Sequence name="Drive"><Drive to="x"/><AlwaysFailure/></Sequence>'
    made, _ = mock_run(f'Main: {tree}', mocks=['Drive=SUCCESS', '*=SUCCESS'])
    assert made.run(1.0) is NodeStatus.FAILURE
    made, _ = mock_run('Main: <Sequence><AlwaysFailure name="x"/></Sequence>', mocks=['x=SUCCESS'])
    assert made.run(1.0) is NodeStatus.SUCCESS


def test_an_installed_leaf_may_run_itself() -> None:
    made, _ = mock_run('Main: <Look seen="{s}"/>', mocks=['Look=real'])
    assert made.run(1.0) is NodeStatus.SUCCESS
    assert made.tree.blackboard.get('s') == 'a cup'


def test_a_tree_that_is_woken_after_a_leaf_has_waited_goes_on() -> None:
    made, _ = mock_run('Main: <AsyncSequence><Ask/><Ask/></AsyncSequence>', mocks=['Ask=real'])
    assert made.run(1.0) is NodeStatus.SUCCESS


def test_a_sub_tree_that_is_mocked_writes_its_outputs(tmp_path: Path) -> None:
    made, _ = mock_run(
        'Main: <Sequence><SubTree ID="Arm" found="{cup}" speed="1"/><Script code="seen := cup"/></Sequence>',
        'Arm: <Look seen="{found}"/>',
        mocks='mocks: {Arm: {gives: SUCCESS, outputs: {found: a mug}}}',
        directory=tmp_path,
    )
    assert made.run(1.0) is NodeStatus.SUCCESS
    assert made.tree.blackboard.get('seen') == 'a mug'


@pytest.mark.parametrize(
    'model', ['', '<TreeNodesModel><Action ID="Move"><input_port name="to"/></Action></TreeNodesModel>']
)
@pytest.mark.parametrize('words', [('run', '--mock', '*=SUCCESS'), ('prove', '--quiet')])
def test_a_port_of_which_only_the_name_is_known_says_nothing_of_its_entry(
    tmp_path: Path, words: tuple[str, ...], model: str
) -> None:
    text = '<SetBlackboard output_key="pose" value="1;2"/><Move to="{pose}"/>'
    (tmp_path / 'tree.xml').write_text(document(f'Main: <Sequence>{text}{text}</Sequence>'), encoding='utf-8')
    (tmp_path / 'model.xml').write_text(f'<root BTCPP_format="4">{model}</root>', encoding='utf-8')
    done = tool(*words, '--models', str(tmp_path / 'model.xml'), str(tmp_path / 'tree.xml'))
    assert done.code == 0, done


def test_leaves_of_which_only_the_ports_names_are_known_are_not_said_to_write_at_once(tmp_path: Path) -> None:
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/>'
    both = '<Parallel><Move to="{goal}"/><Look at="{goal}"/></Parallel>'
    (tmp_path / 'tree.xml').write_text(document(f'Main: <Sequence>{plan}{both}</Sequence>'), encoding='utf-8')
    done = tool('prove', '--quiet', str(tmp_path / 'tree.xml'))
    assert done.code == 0, done


def test_the_blackboard_has_the_types_of_the_ports() -> None:
    made, _ = mock_run(
        'Main: <Sequence><Drive to="{goal}" speed="{v}"/><Script code="{code}"/></Sequence>',
        mocks=['Drive=SUCCESS'],
        values=('v=1', 'goal=kitchen', 'code=x := 2', 'list=[1, 2.5]'),
        read_inputs=True,
    )
    assert made.run(1.0) is NodeStatus.SUCCESS
    assert {key: made.tree.blackboard.get(key) for key in ('v', 'x', 'list')} == {'v': 1.0, 'x': 2, 'list': [1, 2.5]}


# (file of mocks with a ^ at the place of each error, the errors)
WRONG_PLANS: list[tuple[str, list[str]]] = [
    ('mocks: {Drive: ^SUCESS}', ["'SUCESS' is not a status; did you mean 'SUCCESS'?"]),
    ('mocks: {Drive: ^IDLE}', ["'IDLE' is not a status; expected one of RUNNING, SUCCESS, FAILURE, SKIPPED"]),
    ('mocks:\n  Drive: ^[]', ["'Drive' has no step; write a status, or a list of them"]),
    ('mocks: {Drive: ^{after: 1}}', ["a step of 'Drive' does not say what it gives: gives: SUCCESS"]),
    (
        'mocks: {Drive: [{gives: SUCCESS, after: ^-1, outputs: ^3}]}',
        ['-1 is not a duration in seconds', "outputs has to be a mapping, not '3'"],
    ),
    (
        f'mocks: {{Drive: {{gives: SUCCESS, after: ^{10**400}}}}}',
        [f'{short_repr(10**400)} is not a duration in seconds'],
    ),
    (
        'mocks: {Drive: {gives: SUCCESS, delay: ^1}}',
        ["'delay' means nothing in a step; expected gives, after, outputs, reason"],
    ),
    ('^- Drive', ['the file has to be a mapping, not a list']),
    ('mock: ^{Drive: SUCCESS}', ["'mock' means nothing here; expected mocks or blackboard"]),
    ('mocks: {^[a, b]: SUCCESS}', ['a name in mocks has to be a name, not a list']),
    ('^', ['the file is empty; expected mocks: {PATTERN: STATUS}']),
    ('blackboard: {x: ^2001-99-99}', ["blackboard: 'x' is not a plain value: '2001-99-99' is not a valid timestamp"]),
    (
        'blackboard: {x: ^!!python/object:os.system []}',
        ["blackboard: 'x' is not a plain value: could not determine a constructor for the tag"],
    ),
    ('blackboard: &x {x: ^*x}', ['*x is in what it stands for']),
    ('blackboard: {x: ^!!bool perhaps}', ["blackboard: 'x' is not a plain value: 'perhaps' is not a valid bool"]),
    ('x: ' + '[' * 99 + '^' + '[' * 100_000, ['nested more than 100 levels deep']),
    ('mocks: {Drive: SUCCESS^', ["no YAML: expected ',' or '}', but got '<stream end>'"]),
    (
        'mocks: {Drive: ^^{gives: SUCCESS, outputs: {to: 1, ways: 2}}}',
        [
            "the mock 'Drive' of <Drive>: there is no output 'to'; its outputs are: way",
            "the mock 'Drive' of <Drive>: there is no output 'ways'; its outputs are: way",
        ],
    ),
    (
        'mocks: {Drive: SUCCESS, Near: ^{gives: SUCCESS, after: 1}, Look: ^RUNNING}',
        [
            "the mock 'Near' of <Near>: it answers within one tick: give it a mock that is never RUNNING",
            "the mock 'Look' of <Look>: it answers within one tick: give it a mock that is never RUNNING",
        ],
    ),
    (
        'mocks: {Drive: SUCCESS, Dirve: ^SUCCESS}',
        ["the mock 'Dirve' means no node of this tree; did you mean 'Drive'?"],
    ),
    (
        'mocks: {All of them: ^SUCCESS, Drive: real}',
        ["the mock 'All of them' means no node of this tree; give the type, the name or the path of a leaf"],
    ),
]


@pytest.mark.parametrize(('mocks', 'expected'), WRONG_PLANS, ids=[expected[0][:40] for _, expected in WRONG_PLANS])
def test_wrong_plans_are_refused_with_their_places(tmp_path: Path, mocks: str, expected: list[str]) -> None:
    text, places = without_marks(mocks)
    with pytest.raises(ToolError) as caught:
        others = '<Near/><Look/>' if 'Near' in mocks else ''
        mock_run(f'Main: <Sequence><Drive to="x"/>{others}</Sequence>', mocks=text, directory=tmp_path)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(expected), lines
    for line, place, words in zip(lines, places, expected, strict=True):
        assert line.startswith(f'{tmp_path / "mocks.yaml"}:{place}: {words}'), line


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (
            ['--mock', 'Drive=OK'],
            "--mock Drive=OK: 'OK' is not a status; expected one of RUNNING, SUCCESS, FAILURE, SKIPPED",
        ),
        (['--mock', 'nowhere.yaml'], 'nowhere.yaml:1:1: cannot be read: '),
        (['--set', 'x'], '--set x: expected KEY=VALUE'),
        (['--set', 'x={'], '--set x={: no YAML: '),
    ],
)
def test_wrong_words_are_refused(tmp_path: Path, words: list[str], message: str) -> None:
    done = run(tmp_path, document('Main: <AlwaysSuccess/>'), *words)
    assert done.code in (2, 3)
    assert done.out == ''
    assert done.err.startswith(message)


def run(directory: Path, text: str, *words: str) -> Done:
    file = directory / 'tree.xml'
    file.write_text(text, encoding='utf-8')
    return tool('run', str(file), *words)


def test_what_is_printed(tmp_path: Path) -> None:
    text = document(
        'Main: <Sequence name="all"><SubTree ID="S" name="s" k="{k}" c="3"/></Sequence>', 'S: <Gone name="g" to="{k}"/>'
    )
    (tmp_path / 'mocks.yaml').write_text(
        'mocks: {Gone: [{gives: FAILURE, after: 0.5, reason: no\x20way, outputs: {to: .inf}}]}', encoding='utf-8'
    )
    words = ('--mock', str(tmp_path / 'mocks.yaml'))
    assert run(tmp_path, text, *words) == (
        1,
        '     0.000  IDLE    -> RUNNING  all\n'
        '     0.000  IDLE    -> RUNNING  s\n'
        '     0.000  IDLE    -> RUNNING  s/g\n'
        '     0.500  RUNNING -> FAILURE  s/g\n'
        '     0.500  FAILURE -> IDLE     s/g\n'
        '     0.500  RUNNING -> FAILURE  s\n'
        '     0.500  FAILURE -> IDLE     s\n'
        '     0.500  RUNNING -> FAILURE  all\n'
        '     0.500  FAILURE -> IDLE     all\n'
        'FAILURE after 0.500 s and 6 ticks\n'
        '  reason: [s/g] no way\n'
        '  so s: the tree [S] failed\n'
        '  so all: Sequence: child 1 of 1 failed\n'
        'blackboard:\n'
        '  k = inf\n'
        'blackboard of s:\n'
        "  c = '3'\n",
        '',
    )
    *transitions, result = map(json.loads, run(tmp_path, text, *words, '--json').out.splitlines())
    assert transitions[3] == {
        'event': 'transition', 'time': 0.5, 'path': 's/g', 'type': 'Gone', 'before': 'RUNNING', 'after': 'FAILURE',
    }  # fmt: skip
    assert result == {
        'event': 'result',
        'result': 'FAILURE',
        'time': 0.5,
        'ticks': 6,
        'reason': '[s/g] no way',
        'reasons': ['s/g: no way', 's: the tree [S] failed', 'all: Sequence: child 1 of 1 failed'],
        'blackboard': {'': {'k': 'inf'}, 's': {'c': '3'}},
    }
    quiet = run(tmp_path, text, '--mock', 'g=SUCCESS', '--quiet')
    assert quiet == (0, "SUCCESS after 0.000 s and 1 tick\nblackboard of s:\n  c = '3'\n", '')


@pytest.mark.parametrize(
    ('tree', 'words', 'code', 'said'),
    [
        ('<AlwaysSuccess/>', [], 0, 'SUCCESS after 0.000 s'),
        ('<AlwaysFailure/>', [], 1, 'FAILURE after 0.000 s'),
        ('<AlwaysFailure _skipIf="true"/>', [], 1, 'SKIPPED after 0.000 s'),
        ('<Sleep msec="700000"/>', [], 5, 'TIMEOUT after 600.000 s and 6001 ticks\n  reason: still RUNNING: Sleep::1'),
        ('<Sleep msec="700000"/>', ['--timeout', '1000', '--rate', '0.01'], 0, 'SUCCESS after 700.000 s and 8 ticks'),
        ('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>', ['--quiet'], 5, 'the tree wakes itself without end'),
        ('<Sequence><Script code="a := b"/></Sequence>', [], 4, 'ERROR after 0.000 s and 1 tick\n  reason: exception'),
        ('<Gone/>', [], 3, "<Gone>: it needs a robot; give it a mock, such as --mock 'Gone=SUCCESS'"),
        ('<Gone><AlwaysFailure/></Gone>', ['--mock', 'Gone=SUCCESS'], 0, 'SUCCESS after 0.000 s'),
        ('<Gone><AlwaysFailure/></Gone>', ['--mock', 'Gone=pass'], 1, 'FAILURE after 0.000 s'),
        ('<Gone><AlwaysFailure/></Gone>', ['--mock', '*=SUCCESS'], 3, "such as --mock 'Gone=pass'"),
        ('<Gone/>', ['--mock', 'Gone=pass'], 3, "the mock 'Gone' of <Gone>: only a node with one child can pass"),
        ('<Gone><Wait/><Wait/></Gone>', ['--mock', 'Gone=pass'], 3, 'only a node with one child can pass'),
        ('<Gone/>', ['--mock', 'Gone=real'], 3, 'it is not installed here, so it cannot be real'),
        ('<DistanceController><AlwaysFailure/></DistanceController>', [], 3, "--mock 'DistanceController=pass'"),
        ('<Wait/>', ['--mock', 'Wait=SUCCESS'], 0, 'SUCCESS after 0.000 s'),
        ('<Spin spin_dist="{a}"/>', ['--mock', 'Spin=SUCCESS', '--read-inputs'], 4, 'the entry was never written'),
        ('<Spin spin_dist="{a}"/>', ['--mock', 'Spin=SUCCESS', '--read-inputs', '--set', 'a=1'], 0, '  a = 1.0'),
        ('<Sleep msec="1"/>', ['--real-time'], 0, 'SUCCESS after 0.'),
        ('<AlwaysSuccess/>', ['--tree', 'Mian'], 2, "there is no tree 'Mian'; did you mean 'Main'?"),
        ('<AlwaysSuccess/>', ['--timeout', '-1'], 2, "--timeout: '-1' is not a number above 0"),
    ],
)  # fmt: skip
def test_exit_codes(tmp_path: Path, tree: str, words: list[str], code: int, said: str) -> None:
    done = run(tmp_path, document(f'Main: {tree}'), *words)
    assert (done.code, said in done.out + done.err) == (code, True), done


@pytest.mark.parametrize(
    ('path', 'code', 'said'),
    [
        ('{header: {frame_id: map}}', 0, "frame_id='map'"),
        ("'json:{}'", 0, 'poses=[]'),
        ('{header: {frame: map}}', 3, "output 'path': "),
        ('{header: 2001-01-01}', 3, 'Object of type date is not JSON serializable'),
    ],
)
def test_messages_are_written_as_mappings(tmp_path: Path, path: str, code: int, said: str) -> None:
    mocks = tmp_path / 'mocks.yaml'
    mocks.write_text(f'mocks: {{ComputePathToPose: {{gives: SUCCESS, outputs: {{path: {path}}}}}}}')
    done = run(tmp_path, document('Main: <ComputePathToPose goal="{g}" path="{p}"/>'), '--mock', str(mocks))
    assert (done.code, said in done.out + done.err) == (code, True), done


def test_a_file_without_a_main_tree_needs_a_name(tmp_path: Path) -> None:
    text = document('A: <AlwaysSuccess/>', 'B: <AlwaysFailure/>', main=None)
    assert run(tmp_path, text).err.endswith('does not name its main tree; say --tree ID, one of: A, B\n')
    assert run(tmp_path, text, '--tree', 'B').code == 1


@pytest.mark.parametrize('tree', STOCK_TREES, ids=lambda tree: tree.stem)
def test_the_trees_of_nav2_run(tree: Path) -> None:
    words = ['--mock', '*=SUCCESS']
    for decorator in ('DistanceController', 'SpeedController', 'GoalUpdater'):
        words += ['--mock', f'{decorator}=pass'] if f'<{decorator}' in tree.read_text(encoding='utf-8') else []
    done = tool('run', str(tree), *words, '--quiet', '--timeout', '60')
    # Following a point never ends by itself.
    assert done.code == (5 if tree.stem == 'follow_point' else 0), done


STATUSES = st.lists(st.sampled_from(['SUCCESS', 'FAILURE', 'SKIPPED', 'RUNNING']), min_size=1, max_size=4).map(','.join)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), STATUSES, STATUSES)
def test_a_run_is_the_same_each_time_and_its_trace_has_no_gaps(
    tmp_path_factory: pytest.TempPathFactory, seed: int, some: str, others: str
) -> None:
    text = wheel_case(seed)['xml']
    words = ['--mock', f'*={others}', '--json', '--timeout', '20', '--set', 'a=1', '--set', 's=x']
    for type, result in (('Act', some), ('Cond', 'FAILURE,SUCCESS'), ('Deco', 'pass')):
        words += ['--mock', f'{type}={result}'] if f'<{type} ' in text or f'ID="{type}"' in text else []
    done = run(tmp_path_factory.getbasetemp(), text, *words)
    assert done.code in (0, 1, 4, 5), done
    assert run(tmp_path_factory.getbasetemp(), text, *words) == done
    events = [json.loads(line) for line in done.out.splitlines()]
    statuses: dict[str, str] = {}
    times = []
    for event in events[:-1]:
        assert event['before'] == statuses.get(event['path'], 'IDLE') != event['after']
        statuses[event['path']] = event['after']
        times.append(event['time'])
    assert times == sorted(times)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_damaged_plans_are_refused_or_read(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    text, _ = without_marks(data.draw(st.sampled_from([text for text, _ in WRONG_PLANS])))
    for _ in range(data.draw(st.integers(1, 3))):
        position = data.draw(st.integers(0, len(text)))
        damage = data.draw(st.text(st.sampled_from('{}[]:,- !&*<|>\'"#%@`\n\t\x00\ud800.0e9~?'), max_size=5))
        text = text[:position] + damage + text[position + data.draw(st.integers(0, 6)) :]
    file = tmp_path_factory.getbasetemp() / 'damaged.yaml'
    file.write_bytes(text.encode('utf-8', 'surrogatepass'))
    with contextlib.suppress(ToolError):
        mock_run('Main: <Drive to="x"/>', mocks=[str(file)])[0].run(1.0)


def test_a_leaf_that_runs_itself_may_use_rclpy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    is_ok: list[bool] = []

    def run_of_leaves(_run: MockRun, _timeout: float) -> NodeStatus:
        is_ok.append(rclpy.ok())
        return NodeStatus.SUCCESS

    monkeypatch.setattr(MockRun, 'run', run_of_leaves)
    assert run(tmp_path, document('Main: <AlwaysSuccess/>')).code == 0
    assert (is_ok, rclpy.ok()) == ([True], False)
