# SPDX-License-Identifier: BSD-3-Clause
"""The leaf that plans: it measures, plans, carries out, and plans anew where the world is not as it was to be."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry
from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.ports import STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_formal.planning.planner import Plan, plan
from flexbt_formal.planning.problem import PlanningProblem
from flexbt_formal.requests.reach_goal import ReachGoal
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import TreeStatus, TreeStructure
from flexbt_server.groot2.log_file import read_log
from flexbt_server.trees.tree_store import TreeStore
from flexbt_testing.nodes.server_world import open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

RUNNING, SUCCESS, FAILURE = NodeStatus.RUNNING, NodeStatus.SUCCESS, NodeStatus.FAILURE
GUIDE = Path(__file__).parents[3] / 'docs' / 'how_to' / 'goals.md'
SKILLS, MISSION, _, _ = re.findall(r'```yaml\n(.*?)```', GUIDE.read_text(), re.S)
FORESEEN = MISSION
UNFORESEEN = MISSION.split('disturbances:')[0]


@dataclass
class World:
    """The robot, the cup and the door, and what was done. ``broken`` are actions that fail, ``idle`` those that
    succeed and do nothing; ``meanwhile`` is called before each tick of an action."""

    robot: str = 'office'
    cup: str = 'kitchen'
    held: bool = False
    open: bool = True
    broken: set[str] = field(default_factory=set)
    idle: set[str] = field(default_factory=set)
    done: list[str] = field(default_factory=list)
    meanwhile: Callable[[World], None] = lambda world: None
    informed: bool = True
    """Whether the sensor of the cup has had its first message; until then it sees none."""

    def act(self, name: str, node: TreeNode) -> bool:
        self.meanwhile(self)
        self.done.append(name)
        if name in self.broken or (name == 'GoThrough' and not self.open):
            return False
        if name in self.idle:
            return True
        if name in ('GoTo', 'GoThrough'):
            self.robot = node.get_input('to')
        elif name == 'OpenDoor':
            self.open = True
        elif name == 'PickUpCup':
            self.held, self.cup = True, ''
        else:
            self.held, self.cup = False, self.robot
        return True


@dataclass
class Services:
    trees: TreeStore
    told: list[str] = field(default_factory=list)

    def warn_once(self, message: str) -> None:
        self.told.append(message)


class Bench:
    """Trees with the leaf, on a world of the mission of the guide."""

    def __init__(self, directory: Path) -> None:
        self.world = World()
        self.clock = ManualClock()
        self.directory = directory
        self.registry = builtin_registry()
        self.registry.register('ReachGoal', ReachGoal)
        tests: dict[str, Callable[[TreeNode], bool]] = {
            'IsAt': lambda node: self.world.robot == node.get_input('place'),
            'IsCupAt': lambda node: self.world.informed and self.world.cup == node.get_input('place'),
            'IsHoldingCup': lambda node: self.world.held,
            'IsDoorOpen': lambda node: self.world.open,
        }
        for name, test in tests.items():
            self._register(
                name,
                Condition,
                ('place', 'door'),
                tick=lambda node, test=test: SUCCESS if test(node) else FAILURE,
                is_informed=property(lambda node: self.world.informed or node.id != 'IsCupAt'),
            )
        for name in ('GoTo', 'GoThrough', 'OpenDoor', 'PickUpCup', 'PutDownCup'):
            self._register(
                name,
                StatefulAction,
                ('from', 'to', 'door', 'where'),
                on_start=lambda node: RUNNING,
                on_running=lambda node, name=name: SUCCESS if self.world.act(name, node) else node.fail('it jams'),
                on_halted=lambda node: None,
                goes_on='it drives',
            )
        self.services = Services(TreeStore(self.registry, [directory], 1_000_000, 100))
        self.bell = threading.Event()
        self.write(FORESEEN)

    def _register(self, name: str, base: type[Any], ports: tuple[str, ...], **members: Any) -> None:
        declared = {port: input_port(STRING, optional=True) for port in ports}
        self.registry.register(name, type(name, (base,), {'ports': declared, **members}))

    def write(self, mission: str, skills: str = SKILLS) -> None:
        (self.directory / 'cup.yaml').write_text(mission)
        (self.directory / 'cup_skills.yaml').write_text(skills)

    def tree(self, ports: str = '', board: Blackboard | None = None, body: str = '{leaf}') -> Tree:
        leaf = f'<ReachGoal name="reach" mission="{self.directory}/cup.yaml" plan="{{way}}" {ports}/>'
        xml = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body.format(leaf=leaf)}</BehaviorTree></root>'
        return Tree(
            TreeLibrary([load_xml(xml, 't.xml', self.registry)]),
            'T',
            blackboard=board,
            clock=self.clock,
            services=self.services,
            on_wake=self.bell.set,
        )

    def run(self, tree: Tree, most: int = 1000) -> NodeStatus:
        """Tick to the end."""
        for _ in range(most):
            status = tree.tick_once()
            if status is not RUNNING:
                return status
            if tree.active_nodes(leaves_only=True) == ['reach']:  # a search is on, or it waits for sensors
                if tree.next_wake is None:
                    assert self.bell.wait(DEADLINE)
                    self.bell.clear()
                else:
                    self.clock.advance(max(0.0, tree.next_wake - self.clock.now()))
        raise AssertionError(f'runs still: {tree.active_nodes()}, {self.world}')


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    yield Bench(tmp_path)


def once(when: int, change: Callable[[World], None]) -> Callable[[World], None]:
    """Do a change before the action of this number."""
    left = [when]

    def meanwhile(world: World) -> None:
        left[0] -= 1
        if left[0] == -1:
            change(world)

    return meanwhile


def test_the_goal_is_reached_from_where_the_robot_is(bench: Bench) -> None:
    bench.world.open = False  # the mission says open: what is measured counts
    board = Blackboard()
    tree = bench.tree(board=board)
    assert bench.run(tree) is SUCCESS
    assert bench.world.cup == 'office'
    assert bench.world.done == ['GoTo', 'OpenDoor', 'GoThrough', 'PickUpCup', 'GoThrough', 'GoTo', 'PutDownCup']
    assert str(board.get('way')).startswith('GoTo(office, hall), OpenDoor(kitchen_door, hall, kitchen), GoThrough(')
    assert 'plan_actions' not in board  # the entries of the plan are its own
    assert any(node.path == 'reach/GoTo(office, hall)' for node in tree.nodes)


def test_a_sensor_that_has_had_no_message_is_waited_for(bench: Bench) -> None:
    bench.world.informed = False
    tree = bench.tree()
    while 'reach/how the world is' not in [node.path for node in tree.nodes]:
        tree.tick_once()
    measuring = tree.nodes
    for _ in range(3):
        assert tree.tick_once() is RUNNING
    assert tree.nodes == measuring and tree.next_wake == tree.context.clock.now() + 5.0
    bench.world.informed = True
    assert bench.run(tree) is SUCCESS and bench.world.cup == 'office'

    bench.world = World(informed=False)
    tree = bench.tree('sensor_timeout="0"')
    assert bench.run(tree) is FAILURE
    assert tree.failure is not None and 'there is no plan' in tree.failure.reason


def test_sensors_may_tell_at_different_moments(bench: Bench) -> None:
    bench.world.cup = ''  # nobody sees it, and nobody holds it
    tree = bench.tree()
    begun = bench.clock.now()
    while tree.next_wake is None:
        tree.tick_once()
        assert bench.clock.now() == begun
    bench.world.held = True
    assert bench.run(tree) is SUCCESS and bench.world.cup == 'office'
    assert bench.world.done == ['PutDownCup'] and bench.clock.now() < begun + 5.0

    bench.world = World(cup='')
    tree = bench.tree()
    assert bench.run(tree) is FAILURE and bench.clock.now() >= begun + 5.0
    assert tree.failure is not None and 'there is no plan' in tree.failure.reason


def test_it_measures_again_also_after_a_long_search(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def plan_slowly(problem: PlanningProblem, **how: Any) -> Plan:
        bench.clock.advance(10.0)
        return plan(problem, **how)

    monkeypatch.setattr('flexbt_formal.requests.reach_goal.plan', plan_slowly)
    bench.world.cup = ''
    tree = bench.tree()
    while (status := tree.tick_once()) is RUNNING and tree.next_wake is None:
        assert bench.bell.wait(DEADLINE)
        bench.bell.clear()
    assert status is RUNNING
    bench.world.held = True
    assert bench.run(tree) is SUCCESS and bench.world.cup == 'office'


class Flapping(World):
    """Whoever looks at the door sees it otherwise than the one before."""

    seen = False

    @property
    def open(self) -> bool:
        self.seen = not self.seen
        return self.seen

    @open.setter
    def open(self, value: bool) -> None: ...


def test_sensors_that_tell_something_else_each_time_are_not_asked_for_ever(bench: Bench) -> None:
    bench.world = Flapping(cup='')
    tree = bench.tree()
    for _ in range(100):
        bench.clock.advance(0.5)
        if tree.tick_exactly_once() is not RUNNING:
            break
        if tree.next_wake is None and tree.active_nodes(leaves_only=True) == ['reach']:
            assert bench.bell.wait(DEADLINE)
            bench.bell.clear()
    assert tree.failure is not None and 'there is no plan' in tree.failure.reason


def shut(world: World) -> None:
    world.open = False


def test_what_the_plan_foresaw_needs_no_other_plan(bench: Bench) -> None:
    bench.world.meanwhile = once(1, shut)
    assert bench.run(bench.tree('attempts="1"')) is SUCCESS
    assert bench.world.cup == 'office' and 'OpenDoor' in bench.world.done


def test_what_it_did_not_foresee_is_planned_for_anew(bench: Bench) -> None:
    bench.write(UNFORESEEN)
    bench.world.meanwhile = once(1, shut)
    tree = bench.tree('attempts="1"')
    assert bench.run(tree) is FAILURE
    assert tree.failure is not None
    assert tree.failure.reason == 'gave up after 1 attempt: no way to the goal is planned from here'
    bench.world = World(meanwhile=once(1, shut))
    assert bench.run(bench.tree()) is SUCCESS
    assert bench.world.cup == 'office'


def test_an_action_that_failed_for_good_is_left_out(bench: Bench) -> None:
    bench.world.broken = {'PickUpCup'}
    tree = bench.tree()
    assert bench.run(tree) is FAILURE
    assert tree.failure is not None
    assert tree.failure.reason.startswith('there is no plan without PickUpCup(kitchen) (failed: it jams): ')
    assert bench.world.done.count('PickUpCup') == 3  # its retries, and once only
    tree = bench.tree('attempts="1"')
    assert bench.run(tree) is FAILURE and tree.failure is not None
    assert tree.failure.reason == 'gave up after 1 attempt: PickUpCup(kitchen) failed 3 times: it jams'


def test_an_action_without_effects_is_done_as_often_as_it_may_be_tried(bench: Bench) -> None:
    bench.world.idle = {'GoThrough'}
    tree = bench.tree()
    assert bench.run(tree) is FAILURE and tree.failure is not None
    named = 'GoThrough(kitchen_door, hall, kitchen)'
    assert tree.failure.reason.startswith(f'there is no plan without {named} (succeeded without its effects): ')
    assert bench.world.done.count('GoThrough') == 2  # once, and its retries
    tree = bench.tree('attempts="1"')
    assert bench.run(tree) is FAILURE and tree.failure is not None
    assert tree.failure.reason == f'gave up after 1 attempt: {named} succeeded without its effects 2 times'


@pytest.mark.parametrize('goal', ['cup_at(office)', '!joined(kitchen, office)', 'cup_at(hall) | kitchen != office'])
def test_it_succeeds_at_once_where_the_goal_holds(bench: Bench, goal: str) -> None:
    bench.world.cup = 'office'
    assert bench.run(bench.tree(f'goal="{goal}"')) is SUCCESS and bench.world.done == []


@pytest.mark.parametrize(
    ('ports', 'mission', 'reason'),
    [
        ('goal="cup_at(cellar)"', MISSION, "'cellar' is not an object"),
        ('goal="cup_at(office) &amp;"', MISSION, 'a literal, such as on(cup, table), is missing'),
        ('goal="cup_at(office) &amp; cup_at(hall)"', MISSION, 'can never hold at once'),
        ('', MISSION.replace('goal:', 'gaol:'), 'gaol'),
        ('', MISSION.replace('goal: cup_at(office)', ''), 'names no goal; add it there'),
        ('', MISSION.replace('start:', 'start:\n  - robot_at(hall)'), 'cannot hold at once (robot_at is exclusive)'),
        ('', MISSION.replace('cup_skills', 'other'), 'other.yaml: no such file'),
        ('', MISSION.replace('cup_skills', '../cup_skills'), 'lies outside the allowed directories'),
        ('', 'x' * 1_000_001, 'longer than 1000000 bytes'),
        ('time_limit="0"', MISSION, 'port time_limit: 0.0 is not a time above 0'),
        ('attempts="0"', MISSION, 'port attempts: 0 is not a number from 1'),
        ('sensor_timeout="-1"', MISSION, 'port sensor_timeout: -1.0 is not a time of 0 or more'),
        ('sensor_timeout="nan"', MISSION, 'port sensor_timeout: nan is not a time of 0 or more'),
        ('sensor_timeout="inf"', MISSION, 'port sensor_timeout: inf is not a time of 0 or more'),
    ],
)
def test_what_cannot_be_planned_is_a_failure_with_the_reason(
    bench: Bench, ports: str, mission: str, reason: str
) -> None:
    bench.write(mission)
    tree = bench.tree(ports)
    assert bench.run(tree) is FAILURE
    assert tree.failure is not None and reason in tree.failure.reason
    assert not tree.unfinished


WITHOUT_OPENING = re.sub('  OpenDoor:.*?(?=  PickUpCup:)', '', SKILLS, flags=re.S)


@pytest.mark.parametrize(
    ('goal', 'is_open', 'reason'),
    [
        ('robot_at(hall) &amp; !open(kitchen_door)', False, 'not open(kitchen_door) does not hold'),
        ('cup_at(office)', True, 'there is no plan'),
    ],
)
def test_what_no_action_changes_is_measured_all_the_same(bench: Bench, goal: str, is_open: bool, reason: str) -> None:
    """The door is opened, or shut, while the robot is on the way to it: it does not drive against it."""
    bench.write(UNFORESEEN, WITHOUT_OPENING)

    def change(world: World) -> None:
        world.open = not is_open

    bench.world.open = is_open
    bench.world.meanwhile = once(0, change)
    tree = bench.tree(f'goal="{goal}"')
    assert bench.run(tree) is FAILURE and bench.world.done == ['GoTo']
    assert tree.failure is not None and reason in tree.failure.reason


def test_nothing_is_done_to_measure(bench: Bench) -> None:
    """A predicate without a sensor is tested by the leaf of its name, and here that is one that acts."""
    sensor = ', sensor: {condition: IsDoorOpen, ports: {door: $what}}'
    names = [text.replace(' open(', ' OpenDoor(').replace('[open(', '[OpenDoor(') for text in (MISSION, SKILLS)]
    bench.write(
        names[0], names[1].replace(sensor, '').replace('  open: {parameters: {what:', '  OpenDoor: {parameters: {door:')
    )
    tree = bench.tree()
    assert bench.run(tree) is FAILURE and bench.world.done == []
    assert tree.failure is not None and 'OpenDoor is a leaf that acts, and would test' in tree.failure.reason


def test_a_halt_ends_the_search_and_the_tree_can_begin_again(bench: Bench) -> None:
    tree = bench.tree()
    for ticks in range(12):  # in each of its phases
        for _ in range(ticks):
            tree.tick_exactly_once()
        tree.halt()
        while tree.unfinished:
            assert bench.bell.wait(DEADLINE), tree.unfinished
            bench.bell.clear()
    bench.world = World()
    assert bench.run(tree) is SUCCESS


def test_a_pause_is_told_by_the_leaves_of_the_plan(bench: Bench) -> None:
    tree = bench.tree()
    while 'reach/GoTo(office, hall)' not in tree.active_nodes():
        assert tree.tick_once() is RUNNING
    assert tree.pause() == ('reach/GoTo(office, hall): it drives',)


def test_an_error_of_a_leaf_names_it(bench: Bench) -> None:
    def drop(world: World) -> None:
        raise OSError('the arm is off')

    bench.world.meanwhile = drop
    tree = bench.tree()
    with pytest.raises(NodeExecutionError, match='the arm is off') as raised:
        bench.run(tree)
    assert raised.value.node_path == 'reach/GoTo(office, hall)'


def test_two_at_once_keep_what_they_count_apart(bench: Bench) -> None:
    other = f'<ReachGoal name="other" mission="{bench.directory}/cup.yaml"/>'
    tree = bench.tree(body=f'<Parallel success_count="2">{{leaf}}{other}</Parallel>')
    for _ in range(5000):
        status = tree.tick_once()
        if status is not RUNNING:
            break
        acting = set(tree.active_nodes(leaves_only=True))
        if acting and acting <= {'reach', 'other'}:
            assert bench.bell.wait(DEADLINE)
            bench.bell.clear()
    assert status is SUCCESS and bench.world.cup == 'office'


DOOR_SKILLS = """
objects: {front: door, back: door}
predicates:
  open: {parameters: {what: door}, sensor: {blackboard: open_$what == 1}}
  closed: {parameters: {what: door}, sensor: {blackboard: open_$what == 0}}
skills:
  SetBlackboard:
    parameters: {what: door}
    preconditions: [closed(what)]
    outcomes: {SUCCESS: [open(what), not closed(what)]}
    arguments: {value: '{one}', output_key: open_$what}
"""
DOOR_MISSION = 'skills: [door_skills.yaml]\ngoal: open(front) & open(back)\n'


def test_who_watches_the_server_sees_the_nodes_of_the_plan(tmp_path: Path) -> None:
    (tmp_path / 'door.yaml').write_text(DOOR_MISSION)
    (tmp_path / 'door_skills.yaml').write_text(DOOR_SKILLS)
    logs = tmp_path / 'logs'
    received: list[Any] = []
    with (
        open_server_world(allowed_directories=[str(tmp_path)], btlog_directory=str(logs)) as world,
        NodeRuntime.open('monitor') as monitor,
    ):

        def subscribe() -> None:
            for kind, name in ((TreeStructure, names.TREE_STRUCTURE), (TreeStatus, names.TREE_STATUS)):
                monitor.node.create_subscription(kind, name, received.append, names.transient_local_qos(100))

        monitor.call(subscribe)
        world.client.load_tree(f'<ReachGoal name="reach" mission="{tmp_path}/door.yaml" plan="{{plan}}"/>')
        result = world.client.execute(inputs={'open_front': 0.0, 'open_back': 1.0, 'one': 1.0}, outputs=['plan']).result
        assert result.code == BtExecute.Result.SUCCESS, result.message
        assert [from_entry(entry) for entry in result.outputs] == ['SetBlackboard(front)']
        wait_until(lambda: any(isinstance(one, TreeStatus) and one.finished for one in received), 'the end of the run')
        wait_until(lambda: any(isinstance(one, TreeStructure) and one.number == 3 for one in received), 'the nodes')
    structures = [one for one in list(received) if isinstance(one, TreeStructure)]
    assert all(node.parent < node.uid for one in structures for node in one.nodes)  # the console takes nothing else
    paths = {one.number: [node.path for node in one.nodes] for one in structures}
    assert sorted(paths) == [1, 2, 3]  # the leaf, what measures, the plan
    done: list[str] = []
    for message in received:
        if isinstance(message, TreeStatus):
            known = paths[message.structure]
            assert len(message.statuses) == len(known)
            done += [known[change.uid - 1] for change in message.changes if change.status == TreeStatus.SUCCESS]
    assert [path for path in done if 'SetBlackboard' in path] == ['reach/SetBlackboard(front)']
    assert {'reach/open(back)', 'reach'} < set(done)
    written = [read_log(file) for file in sorted(logs.iterdir())]
    assert [len(log.nodes) for log in written] == [len(paths[number]) for number in (1, 2, 3)]
    assert 'reach/SetBlackboard(front)' in {written[2].nodes[one.uid].path for one in written[2].transitions}
