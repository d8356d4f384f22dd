# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of C++ libraries on a live server: the same statuses as in BehaviorTree.CPP, values of all types, and faults.

The nodes are in flexbt_plugin_host/test; they are built with that package where BehaviorTree.CPP is installed.
"""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import PackageNotFoundError
from geometry_msgs.msg import Point

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.clock.waiting import WakeEvent
from flexbt_msgs.action import BtExecute
from flexbt_server import cpp_nodes
from flexbt_server.bt_server import BtServer
from flexbt_server.cpp_nodes import PROGRAM, PluginHost, PluginHostError, host_command, register_nodes, start_hosts
from flexbt_testing.behavior_trees.random_trees import wheel_case
from flexbt_testing.nodes.server_world import ServerWorld, document, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

pytestmark = pytest.mark.dds('nodes in C++ are in a process of their own')

Result = BtExecute.Result
SUCCESS, FAILURE, RUNNING = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING


def built() -> Path:
    """Return the directory of the programs. Skip the test if they are not built."""
    try:
        directory = Path(host_command()[0]).parent
    except PluginHostError as error:
        pytest.skip(f'BehaviorTree.CPP is not installed: {error}')
    if not (directory / 'run_tree').exists():
        pytest.skip('BehaviorTree.CPP is not installed, or flexbt_plugin_host was built with -DBUILD_TESTING=OFF')
    return directory


@pytest.fixture(scope='module')
def library() -> str:
    return str(built() / 'libtest_nodes.so')


@pytest.fixture(scope='module')
def world(library: str) -> Iterator[ServerWorld]:
    """Yield a server that waits for the host, however busy the machine is."""
    with pytest.MonkeyPatch.context() as patch, open_server_world(plugins=[library], server_timeout=DEADLINE) as opened:
        patch.setattr(cpp_nodes, 'ANSWER_SECONDS', DEADLINE)
        yield opened


@pytest.fixture
def impatient(world: ServerWorld, monkeypatch: pytest.MonkeyPatch) -> ServerWorld:
    """Return the server, which soon stops to wait for nodes that never return."""
    monkeypatch.setattr(cpp_nodes, 'ANSWER_SECONDS', 0.2)
    monkeypatch.setitem(vars(world.server.goals._services), 'server_timeout', 0.5)
    return world


class Ran:
    """A tree of the server that the test ticks."""

    def __init__(self, world: ServerWorld, body: str, **values: Any) -> None:
        services = world.server.goals._services
        (report,) = services.trees.load([], document(body) if body[:5] != '<root' else body)
        assert not report.errors, report.errors
        self.board = Blackboard()
        for key, value in values.items():
            self.board.set(key, value)
        found = services.trees.find('Main')
        self.woken = WakeEvent()
        self.tree = Tree(
            found.library, 'Main', blackboard=self.board, services=services, on_wake=self.woken.set
        )  # fmt: skip
        self.host = host_of(world)
        self.steady = services.runtime.steady

    def __enter__(self) -> Ran:
        return self

    def __exit__(self, *_: object) -> None:
        self.host.end_session(self.tree.context)


def host_of(world: ServerWorld) -> PluginHost:
    (host,) = world.server._plugins
    assert isinstance(host, PluginHost)
    return host


def value_after(world: ServerWorld, body: str, key: str, **values: Any) -> Any:
    with Ran(world, body, **values) as ran:
        assert ran.tree.tick_exactly_once() is SUCCESS
        return ran.board.get(key)


# -- the same as in BehaviorTree.CPP -----------------------------------------------------------------------------------

ERROR = None


def statuses_of_ours(world: ServerWorld, case: dict[str, Any]) -> list[Any]:
    """Return what run_tree prints for this case."""
    steps: list[Any] = []
    with Ran(world, case['xml'], **case['bb']) as ran:
        tree = ran.tree
        try:
            for op, *rest in case['ops']:
                status = NodeStatus.IDLE
                if op == 'set':
                    ran.board.set(rest[0], rest[2])
                elif op == 'halt':
                    tree.halt()
                else:
                    status = tree.tick_exactly_once()
                    while op == 'once' and status is RUNNING and tree.take_wake():
                        status = tree.tick_exactly_once()
                steps.append([status.name, [node.stored_status.name for node in tree.nodes]])
        except NodeExecutionError:
            steps.append(ERROR)
    return steps


def cpp_case(seed: int) -> dict[str, Any]:
    """Return a random tree whose leaves are those of the library."""
    case = wheel_case(seed)
    case['xml'] = re.sub(r' _(write|read)="[^"]*"', '', case['xml']).replace(' _script="', ' script="')
    return case


def test_statuses_are_those_of_behaviortree_cpp(world: ServerWorld, library: str) -> None:
    """After each tick, for each node; with halts and changes of the blackboard in between."""
    cases = [case for seed in range(400) if '<Deco' not in (case := cpp_case(seed))['xml'] and '<Act' in case['xml']]
    assert len(cases) > 100
    lines = ''.join(f'{json.dumps(case)}\n' for case in cases)
    theirs = subprocess.run([built() / 'run_tree', library], input=lines, text=True, stdout=-1, check=True).stdout
    errors = 0
    for case, line in zip(cases, theirs.splitlines(), strict=True):
        expected = json.loads(line)
        errors += ERROR in expected
        assert statuses_of_ours(world, case) == expected, json.dumps(case)
    assert errors < len(cases) / 5  # else it would compare little


# -- values ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('type', 'text', 'value'),
    [
        ('bool', 'true', True),
        ('int8_t', '-128', -128),
        ('int16_t', '-32768', -32768),
        ('int', '-2147483648', -2147483648),
        ('int64_t', '-9223372036854775808', -(2**63)),
        ('uint8_t', '255', 255),
        ('uint16_t', '65535', 65535),
        ('unsigned', '4294967295', 2**32 - 1),
        ('uint64_t', '18446744073709551615', 2**64 - 1),
        ('float', '0.5', 0.5),
        ('double', '0.1', 0.1),
        ('string', 'ä "€" \\ 😀', 'ä "€" \\ 😀'),
        ('ints', '1;-2', [1, -2]),
        ('doubles', '1;2.5', [1.0, 2.5]),
        ('bools', 'true;false', [True, False]),
        ('strings', 'a;b c', ['a', 'b c']),
    ],
)
def test_values_cross_without_loss(world: ServerWorld, type: str, text: str, value: Any) -> None:
    """A literal, then the entry that the node has written, which another node reads."""
    attribute = text.replace('"', '&quot;')
    body = f'<Sequence><Echo_{type} in="{attribute}" out="{{x}}"/><Echo_{type} in="{{x}}" out="{{y}}"/></Sequence>'
    result = value_after(world, body, 'y')
    assert (result, result.__class__) == (value, value.__class__)


def test_numbers_that_json_lacks_cross(world: ServerWorld) -> None:
    for text in ('inf', '-inf', 'nan'):
        written = value_after(world, f'<Echo_double in="{text}" out="{{x}}"/>', 'x')
        read = value_after(world, '<Echo_double in="{x}" out="{y}"/>', 'y', x=written)
        assert str(read) == text == str(written)


def test_numbers_that_json_lacks_cross_in_lists_and_objects(world: ServerWorld) -> None:
    for name, value in (
        ('doubles', [math.nan, -math.inf, 1.0]),
        ('message', Point(x=math.nan, y=math.inf, z=-math.inf)),
    ):
        body = f'<Sequence><Echo_{name} in="{{x}}" out="{{y}}"/><Echo_{name} in="{{y}}" out="{{z}}"/></Sequence>'
        assert repr(value_after(world, body, 'z', x=value)) == repr(value)
    assert str(value_after(world, '<Echo_doubles in="nan;inf" out="{x}"/>', 'x')) == '[nan, inf]'


def test_a_large_value_crosses(world: ServerWorld) -> None:
    text = 'x\n' * 5_000_000
    assert value_after(world, '<Echo_string in="{x}" out="{y}"/>', 'y', x=text) == text


def test_an_enumeration_is_its_number_and_its_name_in_scripts(world: ServerWorld) -> None:
    body = '<Sequence><Echo_color in="Green" out="{x}"/><ScriptCondition code="x == Green"/></Sequence>'
    assert value_after(world, body, 'x') == 2


def test_types_of_the_library_cross(world: ServerWorld) -> None:
    """One with convertFromString as text; one with a JSON definition as an object."""
    assert value_after(world, '<Norm point="3,4" norm="{n}"/>', 'n') == 5.0
    assert value_after(world, '<Norm point="{p}" norm="{n}"/>', 'n', p='6,8') == 10.0
    literal = 'json:{&quot;name&quot;:&quot;b&quot;,&quot;size&quot;:[2]}'
    body = f'<Sequence><Echo_box in="{literal}" out="{{x}}"/><Grow box="{{x}}"/><Grow box="{{x}}"/></Sequence>'
    box = value_after(world, body, 'x')
    assert box.fields == {'name': 'b', 'size': [2.0, 1.0, 1.0]}
    assert value_after(world, '<Echo_box in="{x}" out="{y}"/>', 'y', x=box) == box
    assert repr(box) == "Box({'name': 'b', 'size': [2.0, 1.0, 1.0]})"


def test_a_message_is_that_of_python(world: ServerWorld) -> None:
    point = Point(x=1.0, y=-0.5)
    assert value_after(world, '<Echo_message in="{x}" out="{y}"/>', 'y', x=point) == point


@pytest.mark.parametrize(
    ('body', 'values', 'part'),
    [
        ('<Echo_int8_t in="{x}" out="{y}"/>', {'x': '300'}, 'Value out of bound when converting [300]'),
        ('<Echo_int in="{x}" out="{y}"/>', {'x': 'many'}, 'Can\'t convert string [many] to integer'),
        ('<Echo_int in="{x}" out="{y}"/>', {}, 'unable to find the key [in] remapped to [x]'),
        ('<Norm point="1" norm="{n}"/>', {}, 'a point has two numbers'),
        ('<Norm point="{p}" norm="{n}"/>', {'p': Point()}, 'port [point]: a value of type Point cannot be read'),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_an_error_of_the_node(
    world: ServerWorld, body: str, values: dict[str, Any], part: str
) -> None:
    with Ran(world, body, **values) as ran, pytest.raises(NodeExecutionError) as raised:
        ran.tree.tick_exactly_once()
    assert part in str(raised.value)
    assert value_after(world, '<Norm point="3,4" norm="{n}"/>', 'n') == 5.0


def test_an_entry_crosses_when_it_has_changed(world: ServerWorld) -> None:
    with Ran(world, '<Sequence><Add b="{x}" sum="{x}"/><Add sum="{z}"/></Sequence>', x=1, b=2) as ran:
        ran.tree.tick_exactly_once()
        ran.tree.tick_exactly_once()
        assert (ran.board.get('x'), ran.board.get('z')) == (81, 42)
        ran.board.set('b', 5)
        ran.tree.tick_exactly_once()
        assert ran.board.get('z') == 45
        ran.board.unset('b')
        with pytest.raises(NodeExecutionError):
            ran.tree.tick_exactly_once()


def test_what_a_node_only_reads_is_not_written(world: ServerWorld) -> None:
    """It reads and writes one entry by two ports, and it may change another in place."""
    with Ran(world, '<Keep in="{x}" out="{x}" point="{p}"/>', x=1, p=Point(x=0.5)) as ran:
        for key, changed in (('x', 2), ('p', Point()), ('y', 0)):
            before = {one: ran.board.entry(one).sequence for one in ('x', 'p')}  # type: ignore[union-attr]
            assert [ran.tree.tick_exactly_once() for _ in range(3)] == [RUNNING] * 3
            assert {one: ran.board.entry(one).sequence for one in ('x', 'p')} == before  # type: ignore[union-attr]
            ran.board.set(key, changed)


def test_a_node_wakes_its_tree(world: ServerWorld) -> None:
    with Ran(world, '<Wakes/>') as ran:
        while ran.tree.tick_exactly_once() is RUNNING:
            ran.woken.wait(ran.steady, ran.steady.now() + DEADLINE)
            assert ran.tree.wake_pending
            ran.tree.take_wake()
        assert ran.tree.status is SUCCESS


# -- faults ------------------------------------------------------------------------------------------------------------


def outcome(world: ServerWorld, body: str) -> Any:
    world.client.load_tree(body)
    return world.client.execute(outputs=['done']).result


def test_what_a_node_throws_is_the_error_of_its_run(world: ServerWorld) -> None:
    for body, reason in (
        ('<Faulty how="throw" done="{done}"/>', 'out of paint'),
        ('<Faulty how="throw a number"/>', 'the node threw something that is not a std::exception'),
        ('<Faulty name="in_constructor"/>', 'no such device'),
        ('<Faulty how="idle"/>', 'IDLE'),
    ):
        result = outcome(world, f'<Fallback>{body}<AlwaysSuccess/></Fallback>')
        assert (result.code, reason in result.message) == (Result.ERROR, True), result.message
        assert result.outputs or 'done' not in body


def test_a_crash_is_a_failed_leaf_and_the_next_start_is_in_a_new_process(world: ServerWorld) -> None:
    for how, reason in (('crash', 'bt_plugin_host was ended by SIGSEGV'), ('exit', 'ended with exit code 3')):
        result = outcome(world, f'<Faulty how="{how}"/>')
        assert result.code == Result.FAILURE
        assert reason in result.message
        result = outcome(world, f'<Fallback><Faulty how="{how}"/><Sync/></Fallback>')
        assert (result.code, result.message) == (Result.SUCCESS, '')


@pytest.mark.parametrize('signal_number', [signal.SIGKILL, signal.SIGSTOP])
def test_a_host_that_ends_or_stops_in_a_tick(impatient: ServerWorld, signal_number: signal.Signals) -> None:
    """The leaf fails with the reason, or is RUNNING until the tree is canceled; the next run has a new process."""
    impatient.client.load_tree('<Faulty how="hang" done="{done}"/>')
    goal = impatient.client.execute()
    wait_until(lambda: goal.feedback and goal.feedback[-1].active_nodes, 'the node hangs')
    os.kill(host_of(impatient)._process._process.pid, signal_number)
    if signal_number == signal.SIGKILL:
        assert (goal.result.code, 'SIGKILL' in goal.result.message) == (Result.FAILURE, True), goal.result.message
    else:
        goal.cancel()
        assert (goal.result.code, 'not halted in time' in goal.result.message) == (Result.ERROR, True)
    assert outcome(impatient, '<Sync/>').code == Result.SUCCESS


def test_a_node_that_hangs_is_late_as_any_leaf(impatient: ServerWorld) -> None:
    """A timeout ends its action; the tree ends as one whose goal cannot be canceled. A condition fails."""
    result = outcome(impatient, '<Timeout msec="100"><Faulty how="hang"/></Timeout>')
    assert result.code == Result.ERROR
    assert 'not halted in time: [Faulty' in result.message
    result = outcome(impatient, '<Fallback><HangingCondition/><AlwaysSuccess/></Fallback>')
    assert result.code == Result.SUCCESS
    result = outcome(impatient, '<HangingCondition/>')
    assert result.code == Result.FAILURE
    assert 'the host did not answer within 0.5 s' in result.message


def test_halt_writes_outputs_and_its_error_counts(world: ServerWorld) -> None:
    body = (
        '<ParallelAll max_failures="0"><Faulty how="{}" done="{{done}}"/><Delay delay_msec="1"><AlwaysFailure/></Delay>'
    )
    body = f'<Timeout msec="50">{body.split("<Delay")[0]}</ParallelAll></Timeout>'
    result = outcome(world, body.format('run'))
    assert (result.code, [entry.text or entry.data for entry in result.outputs] != []) == (Result.FAILURE, True)
    result = outcome(world, body.format('throw in halt'))
    assert (result.code, 'the brush sticks' in result.message) == (Result.ERROR, True)


def test_a_node_that_throws_anything_in_a_halt_costs_no_other_node(world: ServerWorld) -> None:
    """It throws again as it is destroyed."""
    process = host_of(world)._process._process
    result = outcome(world, '<Timeout msec="50"><Faulty how="throw a number in halt"/></Timeout>')
    assert (result.code, 'not a std::exception' in result.message) == (Result.ERROR, True)
    threads = Path(f'/proc/{process.pid}/task')
    wait_until(lambda: process.poll() is not None or len(list(threads.iterdir())) <= 2, 'the end of the node')
    assert process.poll() is None


def test_a_tick_that_ends_after_the_halt_counts(impatient: ServerWorld, tmp_path: Path) -> None:
    body = f'<Faulty how="{tmp_path}/go" done="{{done}}" late="{{late}}"/>'
    with Ran(impatient, body) as ran:
        assert ran.tree.tick_exactly_once() is RUNNING
        ran.tree.halt()
        (ending,) = ran.tree.unfinished
        assert ending == '[Faulty::1] is coming to its end in bt_plugin_host'
        (tmp_path / 'go').touch()
        while ran.tree.unfinished:
            ran.woken.wait(ran.steady, ran.steady.now() + DEADLINE)
            ran.tree.advance_unfinished()
        assert (ran.board.get('late'), ran.board.get('done')) == (1, 3)


@pytest.mark.parametrize('is_halted', [False, True])
def test_a_condition_that_comes_too_late_for_its_tick_has_written_its_outputs(
    impatient: ServerWorld, tmp_path: Path, is_halted: bool
) -> None:
    with Ran(impatient, f'<LateCondition file="{tmp_path}/go" late="{{late}}"/>') as ran:
        assert ran.tree.tick_exactly_once() is FAILURE
        if is_halted:
            ran.tree.halt()
        (tmp_path / 'go').touch()
        wait_until(lambda: ran.tree.tick_exactly_once() is SUCCESS, 'the condition')
        assert ran.board.get('late') == 1


def test_a_node_that_could_not_be_made_is_made_at_the_next_tick(world: ServerWorld) -> None:
    with Ran(world, '<Faulty name="in_constructor"/>') as ran:
        for _ in range(3):
            with pytest.raises(NodeExecutionError, match='no such device'):
                ran.tree.tick_exactly_once()
            ran.tree.halt()


def test_a_host_that_reads_no_more_is_ended(world: ServerWorld) -> None:
    """Its buffer is full: a send would block the tree."""
    with Ran(world, '<Echo_string in="{x}" out="{y}"/>', x='') as ran:
        assert ran.tree.tick_exactly_once() is SUCCESS
        os.kill(host_of(world)._process._process.pid, signal.SIGSTOP)
        ran.board.set('x', 'x' * 10_000_000)
        assert ran.tree.tick_exactly_once() is FAILURE
        assert 'did not read a request within 0.5 s, and was ended' in ran.tree.failure.steps[0].reason  # type: ignore[union-attr]
        assert ran.tree.tick_exactly_once() is SUCCESS


def test_a_crash_in_one_tree_fails_the_leaves_of_another(world: ServerWorld) -> None:
    world.client.load_tree('<Act script="R"/>', 'Other')
    other = world.client.execute('Other')
    wait_until(lambda: other.feedback, 'the other tree runs')
    assert outcome(world, '<Faulty how="crash"/>').code == Result.FAILURE
    assert (other.result.code, 'SIGSEGV' in other.result.message) == (Result.FAILURE, True)


def test_many_trees_at_once(world: ServerWorld) -> None:
    """Each with many ticks; the process serves them side by side, and forgets them at their ends."""
    body = '<Repeat num_cycles="300"><Sequence><Act script="S"/><Add a="1" b="{n}" sum="{n}"/></Sequence></Repeat>'
    goals = []
    for number in range(8):
        world.client.load_tree(f'<Sequence><Script code="n := 0"/>{body}</Sequence>', f'T{number}')
        goals.append(world.client.execute(f'T{number}', blackboard=f'b{number}', outputs=['n']))
    for goal in goals:
        assert goal.result.code == Result.SUCCESS, goal.result.message
    assert {world.client.get('n', blackboard=f'b{number}').entries[0].key for number in range(8)} == {'n'}
    host = host_of(world)
    assert not host._sessions
    threads = Path(f'/proc/{host._process._process.pid}/task')
    wait_until(lambda: len(list(threads.iterdir())) <= 2, 'the end of the threads')


# -- libraries ---------------------------------------------------------------------------------------------------------


def test_what_cannot_be_served_is_reported(world: ServerWorld, library: str) -> None:
    registry, reports = builtin_registry(), []
    register_nodes(registry, host_of(world), lambda what, why: reports.append(f'{what}: {why}'))
    assert sorted(reports) == [
        f'the node type [Echo_opaque] of {library}: the type Opaque of its port [in] cannot cross to the server: add '
        'convertFromString or BT::RegisterJsonDefinition',
        f'the node type [Twice] of {library}: it is a Decorator, and bt_plugin_host serves actions and conditions '
        'only: a node with children has to be written in Python',
    ]
    manifest = registry.get('Add')
    assert manifest is not None
    assert (manifest.ports['a'].default, manifest.ports['a'].type.name) == ('40', 'int')  # type: ignore[union-attr]
    again: list[str] = []
    register_nodes(registry, host_of(world), lambda what, why: again.append(f'{what}: {why}'))
    assert 'node ID [Act] is registered already' in ''.join(again)


def test_libraries_that_cannot_be_used(library: str, tmp_path: Path) -> None:
    """Each costs its own nodes only, and is named with the reason."""
    text = tmp_path / 'text.so'
    text.write_text('no library')
    reports: list[str] = []
    plugins = [
        '/nowhere/libx.so', 'no_such_package/libx.so', 'no_such_nodes', str(text), 'libm.so.6', str(tmp_path / 'no'),
        str(Path(library).parent), str(built() / 'libtest_nodes.so'),
    ]  # fmt: skip
    registry = builtin_registry()
    with NodeRuntime.open('bt_server') as runtime:
        start_hosts(runtime, plugins, registry, lambda what, why: reports.append(f'{what}: {why}'))
    assert 'Act' in registry
    for part in (
        'the nodes of /nowhere/libx.so: there is no /nowhere/libx.so',
        "the nodes of no_such_package/libx.so: there is no package 'no_such_package'",
        'libno_such_nodes.so: cannot open shared object file',
        'text.so: file too short',
        'libm.so.6 registers no nodes: it needs BT_REGISTER_NODES',
        'node ID [Act] is registered already',
    ):
        assert part in '\n'.join(reports)


def test_a_library_that_hangs_when_loaded(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TEST_NODES_HANG', '1')
    monkeypatch.setattr(cpp_nodes, 'LOAD_SECONDS', 0.5)
    with pytest.raises(PluginHostError, match=f'did not load {library} within 0.5 s, and was ended'):
        PluginHost('x', host_command(), [library], [])


HANGS = {'node': 1, 'op': 'tick', 'reset': True, 'in': {}}
HANGS['create'] = {'id': 'Faulty', 'name': 'f', 'path': 'f', 'uid': 1, 'ports': {'how': 'hang'}}


def test_a_process_ends_although_a_node_hangs(library: str) -> None:
    host = PluginHost('x', host_command(), [library], [])
    process, end = host.connect()
    with end:
        end.sendall(json.dumps(HANGS).encode() + b'\n')
        host.close()
    assert process._process.poll() is not None


def test_a_process_ends_when_its_server_is_killed(library: str) -> None:
    program = (
        'import sys, time; from flexbt_server.cpp_nodes import PluginHost, host_command;'
        'host = PluginHost("x", host_command(), sys.argv[1:], []); process, end = host.connect();'
        f"end.sendall(b'{json.dumps(HANGS)}\\n'); print(process._process.pid, flush=True); time.sleep(1000)"
    )
    with subprocess.Popen([sys.executable, '-c', program, library], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        place = Path('/proc', server.stdout.readline().strip())
        assert PROGRAM in (place / 'cmdline').read_text()
        server.kill()
    wait_until(lambda: not place.exists() or ' Z ' in (place / 'stat').read_text(), 'the end of the process')


def test_without_the_host_the_server_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """And runs on, without these nodes."""

    def prefix(package: str) -> str:
        raise PackageNotFoundError(package)

    monkeypatch.setattr(cpp_nodes, 'get_package_prefix', prefix)
    with NodeRuntime.open('bt_server_alone', parameters={'plugins': ['my_nodes']}) as runtime:
        BtServer(runtime)
    written = capfd.readouterr().err
    assert 'the nodes of my_nodes not added: C++ nodes need the package flexbt_plugin_host, which is not' in written
    assert 'install BehaviorTree.CPP (ros-jazzy-behaviortree-cpp), and build flexbt_plugin_host' in written
    monkeypatch.setattr(cpp_nodes, 'get_package_prefix', lambda package: str(tmp_path))
    with pytest.raises(PluginHostError, match='was built without BehaviorTree'):
        host_command()
