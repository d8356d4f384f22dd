# SPDX-License-Identifier: BSD-3-Clause
"""Debugging trees of a live server: breakpoints, steps, forced results, dummies, writers of blackboards."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import pytest
from nav2_msgs.msg import BehaviorTreeLog, BehaviorTreeStatusChange
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import TreeBreakpoint, TreeDebugging, TreeStatus
from flexbt_msgs.srv import ControlTree, GetTreeBlackboard
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.server_world import ServerWorld, install_nodes, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

Request, Result = ControlTree.Request, BtExecute.Result
SUCCESS, FAILURE = TreeStatus.SUCCESS, TreeStatus.FAILURE
STEPS = (
    '<Sequence name="all"><Script code="x := 1" name="one"/><Script code="y := x + 1" name="two"/>'
    '<Spin name="turn"/><AlwaysSuccess name="last"/></Sequence>'
)
COUNTING = '<KeepRunningUntilFailure><Counts key="ticks" name="count"/></KeepRunningUntilFailure>'


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=200.0, feedback_rate=50.0) as opened:
        yield opened


class Debugger:
    """A client of the services, and a witness of the topic."""

    def __init__(self, runtime: NodeRuntime, operator: str = 'ann') -> None:
        self._runtime = runtime
        self._operator = operator
        self._control = ServiceLinks(runtime).link(ControlTree, names.CONTROL_TREE)
        self._blackboard = ServiceLinks(runtime).link(GetTreeBlackboard, names.GET_TREE_BLACKBOARD)
        self.shown = TreeDebugging()
        runtime.call(
            lambda: runtime.node.create_subscription(
                TreeDebugging, names.TREE_DEBUGGING, self._on_shown, names.transient_local_qos()
            )
        )
        wait_until(self._control.is_ready, 'control_tree')
        wait_until(self._blackboard.is_ready, 'get_tree_blackboard')

    def _on_shown(self, message: TreeDebugging) -> None:
        self.shown = message

    def send(self, command: int, node: str = '', **fields: Any) -> Any:
        request = Request(command=command, node=node, **{'operator_id': self._operator} | fields)
        return self._runtime.call(lambda: self._control.client.call_async(request))

    def ask(self, command: int, node: str = '', **fields: Any) -> str:
        """'' when it had its effect, otherwise why not."""
        future = self.send(command, node, **fields)
        wait_until(future.done, 'the response')
        assert future.result().success is not bool(future.result().message)
        return str(future.result().message)

    def blackboard(self, *keys: str) -> Any:
        request = GetTreeBlackboard.Request(keys=list(keys))
        future = self._runtime.call(lambda: self._blackboard.client.call_async(request))
        wait_until(future.done, 'the response')
        return future.result()

    def held_at(self, path: str) -> Any:
        """Wait until the tree is held there, and return that hold."""
        wait_until(lambda: [hold.path for hold in self.shown.holds] == [path], f'held at {path!r}')
        return self.shown.holds[0]

    def goes(self) -> None:
        wait_until(lambda: not self.shown.holds, 'nothing held')

    @property
    def points(self) -> list[tuple[int, str]]:
        return [(point.kind, point.path) for point in self.shown.breakpoints]


@pytest.fixture
def debugger(world: ServerWorld) -> Debugger:
    return Debugger(world.client.runtime)


def value(world: ServerWorld, key: str) -> Any:
    entries = world.client.get().entries
    return next((from_entry(entry) for entry in entries if entry.key == key), None)


def test_a_tree_is_held_before_the_tick_of_a_node_steps_and_goes_on(world: ServerWorld, debugger: Debugger) -> None:
    world.client.load_tree(STEPS, 'Steps')
    assert debugger.ask(Request.BREAK, 'two', behavior_tree='Steps') == ''
    wait_until(lambda: debugger.points == [(TreeBreakpoint.BREAK, 'two')])
    goal = world.client.execute('Steps')
    hold = debugger.held_at('two')
    assert (hold.behavior_tree, hold.operator_id, hold.reason) == ('Steps', 'ann', 'breakpoint')
    assert (value(world, 'x'), value(world, 'y')) == (1, None)  # before its tick, and after that of the one before
    assert world.navigation.count(names.SPIN) == 0
    world.navigation.hold.add(names.SPIN)
    assert debugger.ask(Request.STEP) == ''
    assert debugger.held_at('').reason == 'paused'
    assert value(world, 'y') == 2
    assert not goal.ended
    assert debugger.ask(Request.STEP) == ''
    assert debugger.ask(Request.CONTINUE) == ''
    debugger.goes()
    wait_until(lambda: world.navigation.actions[names.SPIN].running)
    world.navigation.actions[names.SPIN].end(world.navigation.count(names.SPIN) - 1)
    assert goal.result.code == Result.SUCCESS
    assert debugger.points == [(TreeBreakpoint.BREAK, 'two')]  # for the next run
    again = world.client.execute('Steps')
    debugger.held_at('two')
    assert debugger.shown.breakpoints[0].hits == 2
    assert debugger.ask(Request.CLEAR, 'two') == ''
    debugger.held_at('two')  # clearing it does not move the robot
    again.call.cancel(DEADLINE)
    assert again.result.code == Result.CANCELED
    debugger.goes()
    assert debugger.points == []


def test_a_stop_works_at_a_breakpoint_and_the_goals_of_leaves_are_held_there(
    world: ServerWorld, debugger: Debugger
) -> None:
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree(
        '<Parallel success_count="2"><Spin name="turn"/><Sequence><Sleep msec="30"/>'
        '<AlwaysSuccess name="other"/></Sequence></Parallel>'
    )
    goal_tree = world.client.execute()
    spin = world.navigation.actions[names.SPIN]
    wait_until(lambda: spin.running)
    assert debugger.ask(Request.BREAK, 'turn') == ''  # each tick of a running node
    assert debugger.held_at('turn').not_paused == []
    wait_until(lambda: spin.statuses.get(0) == 'canceled', 'the goal of the leaf canceled while the tree is held')
    assert debugger.ask(Request.PAUSE) == ''  # it stands already, and is paused afterwards
    assert debugger.ask(Request.RESUME) == ''
    assert debugger.held_at('turn')  # a resume is not a continue
    goal_tree.call.cancel(DEADLINE)
    assert goal_tree.result.code == Result.CANCELED
    debugger.goes()


def test_results_are_forced_once_and_dummies_give_them_always(world: ServerWorld, debugger: Debugger) -> None:
    world.client.load_tree('<Fallback><Spin name="turn"/><Wait name="wait"/></Fallback>', 'Main')
    assert debugger.ask(Request.DUMMY, 'wait', behavior_tree='Main', status=SUCCESS) == ''
    assert debugger.ask(Request.FORCE, 'turn', behavior_tree='Main', status=FAILURE) == ''
    wait_until(lambda: len(debugger.points) == 2)
    assert world.client.execute('Main').result.code == Result.SUCCESS
    assert (world.navigation.count(names.SPIN), world.navigation.count(names.WAIT)) == (0, 0)
    wait_until(lambda: debugger.points == [(TreeBreakpoint.DUMMY, 'wait')])
    assert world.client.execute('Main').result.code == Result.SUCCESS
    assert (world.navigation.count(names.SPIN), world.navigation.count(names.WAIT)) == (1, 0)
    world.navigation.hold.add(names.SPIN)
    goal = world.client.execute('Main')
    wait_until(lambda: world.navigation.actions[names.SPIN].running)
    assert debugger.ask(Request.FORCE, 'turn', status=FAILURE) == ''  # a running node is halted
    assert goal.result.code == Result.SUCCESS
    assert 'SUCCESS (2) or FAILURE (3)' in debugger.ask(Request.DUMMY, 'wait', behavior_tree='Main', status=1)


def test_conditions_hold_only_while_they_are_true_and_errors_hold_and_are_told(
    world: ServerWorld, debugger: Debugger
) -> None:
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    wait_until(lambda: (value(world, 'ticks') or 0) > 2)
    target = value(world, 'ticks') + 200
    assert debugger.ask(Request.BREAK, 'count', condition=f'ticks > {target}') == ''
    assert debugger.held_at('count').reason == f'breakpoint if ticks > {target}'
    assert value(world, 'ticks') == target + 1
    assert debugger.ask(Request.BREAK, 'count', condition='tocks > 5') == ''
    assert debugger.ask(Request.CONTINUE) == ''
    wait_until(lambda: debugger.shown.holds and 'tocks' in debugger.shown.holds[0].reason)
    assert 'tocks' in debugger.shown.breakpoints[0].problem
    assert 'not a script' in debugger.ask(Request.BREAK, 'count', condition='ticks >')
    assert 'change the blackboard' in debugger.ask(Request.BREAK, 'count', condition='ticks := 0')
    assert 'change the blackboard' in debugger.ask(Request.BREAK, 'count', condition='ticks > 1; ticks := 0')
    assert 'change the blackboard' in debugger.ask(Request.BREAK, 'count', condition='(ticks := 0) == 0')
    assert 'at most 1000' in debugger.ask(Request.BREAK, 'count', condition='ticks > 1 || ' * 80 + 'true')
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_run_to_a_node_holds_there_once(world: ServerWorld, debugger: Debugger) -> None:
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    wait_until(lambda: (value(world, 'ticks') or 0) > 2)
    assert 'neither held' in debugger.ask(Request.RUN_TO, 'count')
    assert 'neither held' in debugger.ask(Request.CONTINUE)
    assert debugger.ask(Request.PAUSE) == ''
    assert debugger.held_at('').operator_id == 'ann'
    before = value(world, 'ticks') or 0

    def counted(number: int) -> bool:
        return bool(value(world, 'ticks') == number)

    assert debugger.ask(Request.RUN_TO, 'count') == ''
    debugger.held_at('count')
    assert debugger.points == []
    for number in range(2):
        assert value(world, 'ticks') == before + number
        assert debugger.ask(Request.RUN_TO, 'count') == ''
        wait_until(functools.partial(counted, before + number + 1))
        debugger.held_at('count')
    assert debugger.ask(Request.CONTINUE) == ''
    wait_until(lambda: (value(world, 'ticks') or 0) > before + 10)
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_who_keeps_a_tree_paused_is_shown_when_it_changes(world: ServerWorld, debugger: Debugger) -> None:
    world.client.load_tree(COUNTING, 'Counting')
    world.client.execute('Counting')
    wait_until(lambda: world.server.goals.running.all() and world.server.goals.running.all()[0].run.tree, 'the tree')
    (running,) = world.server.goals.running.all()

    def shown(operator: str, reason: str) -> None:
        wait_until(
            lambda: (
                [(one.path, one.operator_id, one.reason) for one in debugger.shown.holds] == [('', operator, reason)]
            ),
            lambda: f'{operator!r}, {reason!r}; {debugger.shown.holds}',
        )

    assert 'is not a node name' in debugger.ask(Request.PAUSE, owner='no name', operator_id='bob')
    running.run.hold('the owner is late')
    shown('', 'the owner is late')
    since = debugger.shown.holds[0].since
    assert debugger.ask(Request.PAUSE) == ''
    shown('ann', 'the owner is late; also a pause')
    running.run.hold('')
    shown('ann', 'paused')
    running.run.hold('the owner is late again')
    shown('ann', 'the owner is late again; also a pause')
    assert debugger.ask(Request.RESUME) == ''
    shown('', 'the owner is late again')
    assert debugger.shown.holds[0].since == since  # it was held all the time
    running.run.hold('')
    debugger.goes()


def test_a_command_for_a_hold_that_is_over_does_not_let_the_tree_go_from_the_next_one(
    world: ServerWorld, debugger: Debugger
) -> None:
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    wait_until(lambda: (value(world, 'ticks') or 0) > 2)
    assert debugger.ask(Request.BREAK, 'count') == ''

    def name(hold: Any) -> str:
        return f'{hold.run_id}@{hold.since.sec * 10**6 + hold.since.nanosec // 1000}'

    first = debugger.held_at('count')
    ticks = value(world, 'ticks')
    assert debugger.ask(Request.CONTINUE, run_id=name(first)) == ''
    wait_until(lambda: debugger.shown.holds and debugger.shown.holds[0].since != first.since, 'the next hold')
    for command, fields in ((Request.CONTINUE, {}), (Request.STEP, {}), (Request.SET, {'condition': 'ticks := 0'})):
        assert 'gone on meanwhile' in debugger.ask(command, run_id=name(first), **fields)
    assert 'gone on meanwhile' in debugger.ask(Request.RUN_TO, 'count', run_id=name(first))
    assert 'gone on meanwhile' in debugger.ask(Request.CONTINUE, run_id=f'{first.run_id}@x')
    assert value(world, 'ticks') == ticks + 1
    assert debugger.ask(Request.CONTINUE, run_id=name(debugger.held_at('count'))) == ''
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_nodes_that_do_not_exist_are_refused_with_the_one_that_was_meant(
    world: ServerWorld, debugger: Debugger
) -> None:
    world.client.load_tree('<Sequence><Spin name="turn"/><Spin/><Spin/></Sequence>', 'Main')
    message = debugger.ask(Request.BREAK, 'trun', behavior_tree='Main')
    assert "no node 'trun'; did you mean 'turn'?" in message
    assert 'Spin::3, Spin::4' in debugger.ask(Request.BREAK, 'Spin', behavior_tree='Main')
    assert 'Mian' in debugger.ask(Request.BREAK, 'turn', behavior_tree='Mian')
    assert debugger.ask(Request.BREAK, 'turn') == 'no tree is running'
    assert 'nothing is set' in debugger.ask(Request.CLEAR)
    assert debugger.ask(Request.BREAK, 'Spin::4', behavior_tree='Main') == ''
    assert "'turn'" in debugger.ask(Request.CLEAR, 'turn', behavior_tree='Main')
    assert 'characters' in debugger.ask(Request.BREAK, 'x' * 100_000, behavior_tree='Main')
    assert debugger.ask(Request.CLEAR) == ''
    wait_until(lambda: debugger.points == [])


def test_who_wrote_what_is_recorded_in_all_scopes(world: ServerWorld, debugger: Debugger) -> None:
    world.navigation.hold.add(names.SPIN)
    world.client.load(
        xml='<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>'
        '<Script code="x := 1" name="one"/><SubTree ID="Inner" name="inner" in="{x}"/>'
        '<Spin name="turn"/></Sequence></BehaviorTree><BehaviorTree ID="Inner"><Sequence name="both">'
        '<Script code="y := in + 1" name="two" _onSuccess="done := true"/><Sleep msec="1" name="nap"/>'
        '</Sequence></BehaviorTree></root>'
    )
    assert debugger.ask(Request.RECORD, behavior_tree='Main') == ''
    goal = world.client.execute('Main')
    wait_until(lambda: world.navigation.actions[names.SPIN].running)
    shown = debugger.blackboard()
    assert shown.success and shown.recorded
    known = {(entry.scope, entry.key): entry for entry in shown.entries}
    assert (known['', 'x'].text, known['', 'x'].writers, known['', 'x'].count) == ('1', ['one'], 1)
    own = known['inner', 'y'], known['inner', 'done']
    assert [(entry.text, entry.writers) for entry in own] == [
        ('2.0', ['inner/two']),
        ('1.0', ['inner/two (_onSuccess)']),
    ]
    world.client.set(to_entry('x', 5))
    after = debugger.blackboard('x').entries[0]
    assert (after.text, after.writers, after.values, after.count) == ('5', ['', 'one'], ['5', '1'], 2)
    assert "no entry 'xx'" in debugger.blackboard('xx').message
    assert [entry.key for entry in debugger.blackboard('x').entries] == ['x']
    assert debugger.ask(Request.CLEAR) == ''
    assert not debugger.blackboard().recorded
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_the_blackboard_of_a_held_tree_is_changed_by_a_script(world: ServerWorld, debugger: Debugger) -> None:
    world.client.load_tree(STEPS, 'Main')
    assert debugger.ask(Request.BREAK, behavior_tree='Main', node='two') == ''
    assert 'no tree' in debugger.ask(Request.SET, condition='x := 5')
    goal = world.client.execute('Main', outputs=['x', 'y'])
    debugger.held_at('two')
    for script, reason in (('x :=', 'cannot be run'), ("x := 'text'", 'cannot be run')):
        assert reason in debugger.ask(Request.SET, condition=script), script
    assert "no node 'tow'" in debugger.ask(Request.SET, condition='x := 5', node='tow')
    assert debugger.ask(Request.SET, condition='x := 5; z := x * 2', node='two') == ''
    written = debugger.blackboard('x').entries[0]
    assert (written.text, written.writers) == ('5', ['operator ann', 'one'])
    assert debugger.ask(Request.CLEAR, behavior_tree='Main') == debugger.ask(Request.CONTINUE) == ''
    assert [from_entry(one) for one in goal.result.outputs] == [5, 6]


def test_panels_of_foxglove_get_the_xml_and_the_changes_by_the_same_uids(world: ServerWorld) -> None:
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree(STEPS, 'Steps')
    runtime = world.client.runtime
    documents: list[str] = []
    changes: list[BehaviorTreeStatusChange] = []

    def listen() -> None:
        node, qos = runtime.node, names.transient_local_qos()
        node.create_subscription(String, names.BEHAVIOR_TREE_XML, lambda message: documents.append(message.data), qos)
        node.create_subscription(
            BehaviorTreeLog, names.BEHAVIOR_TREE_LOG, lambda message: changes.extend(message.event_log), 100
        )

    first = world.client.execute('Steps')
    wait_until(lambda: world.navigation.actions[names.SPIN].running)
    world.client.load_tree('<AlwaysSuccess/>', 'Short')
    assert world.client.execute('Short').result.code == Result.SUCCESS
    runtime.call(listen)
    wait_until(lambda: documents, 'the XML of a tree that runs already')
    assert 'ID="Steps"' in documents[0]
    first.call.cancel(DEADLINE)
    assert first.result.code == Result.CANCELED
    count = len(documents)
    assert not changes  # nobody listened when it began
    again = world.client.execute('Steps')
    wait_until(lambda: len(documents) > count and any(change.node_name == 'turn' for change in changes))
    nodes = ElementTree.fromstring(documents[-1]).iter()  # noqa: S314
    uids = {node.get('name'): int(node.get('_uid', '')) for node in nodes if node.get('_uid')}
    told = next(change for change in changes if change.node_name == 'turn')
    assert (told.uid, told.current_status) == (uids['turn'], 'RUNNING')
    again.call.cancel(DEADLINE)
    assert again.result.code == Result.CANCELED


def test_a_flood_and_long_fields_leave_the_server_and_its_breakpoints_as_they_are(
    world: ServerWorld, debugger: Debugger
) -> None:
    world.client.load_tree(STEPS, 'Steps')
    other = Debugger(world.navigation_runtime, 'bob')
    for field in ('node', 'condition', 'behavior_tree', 'run_id', 'operator_id', 'owner'):
        long: dict[str, Any] = {'node': 'two', 'behavior_tree': 'Steps', field: 'x' * 10_000_000}
        assert field in debugger.ask(Request.BREAK, **long)
    assert debugger.ask(Request.BREAK, 'two', behavior_tree='Steps') == ''
    goal = world.client.execute('Steps')
    debugger.held_at('two')
    flood = [
        one.send(command, 'two', behavior_tree='Steps', status=SUCCESS)
        for _ in range(50)
        for one in (debugger, other)
        for command in (Request.PAUSE, Request.RESUME, Request.BREAK, Request.DUMMY, Request.RECORD)
    ]
    wait_until(lambda: all(future.done() for future in flood))
    assert all(future.result().success for future in flood)
    debugger.held_at('two')  # none of them is a continue
    assert len(debugger.points) == 3
    assert debugger.ask(Request.CONTINUE) == ''
    assert goal.result.code == Result.SUCCESS
    assert value(world, 'y') is None  # the dummy
    names_of = [f'n{number}' for number in range(120)]
    world.client.load_tree(
        f'<Sequence>{"".join(f"<AlwaysSuccess name={name!r}/>" for name in names_of)}</Sequence>', 'Many'
    )
    answers = [debugger.ask(Request.BREAK, name, behavior_tree='Many') for name in names_of]
    assert answers.count('') == 97 and 'clear one first' in answers[-1]
    assert debugger.ask(Request.CLEAR, behavior_tree='Many') == ''
    wait_until(lambda: len(debugger.points) == 3)


def test_a_fault_of_the_server_is_told_to_the_client(
    world: ServerWorld, debugger: Debugger, monkeypatch: pytest.MonkeyPatch
) -> None:
    control = world.server.control

    def fail(_name: str) -> Any:
        raise OSError('scripted')

    monkeypatch.setattr(control._store, 'find', fail)
    told = debugger.ask(Request.BREAK, 'leaf', behavior_tree='Any')
    assert 'fault in the BT server: OSError' in told, told
    monkeypatch.setattr(control._goals.running, 'find', fail)
    told = debugger.blackboard().message
    assert 'fault in the BT server: OSError' in told, told
