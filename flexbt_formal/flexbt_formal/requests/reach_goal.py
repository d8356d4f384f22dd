# SPDX-License-Identifier: BSD-3-Clause
"""The leaf that reaches a goal: it measures the world, plans, and executes the plan, repeatedly if necessary."""

from __future__ import annotations

import math
import posixpath
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

from flexbt_common.errors import ResourceError
from flexbt_core.behavior_tree.engine.leaf import ExpandingAction, Halted, LeafNode
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import DOUBLE, STRING, UNSIGNED, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import SkillError
from flexbt_core.skills.yaml_files import read_skills
from flexbt_core.values.text import pluralize, truncate_middle
from flexbt_formal.planning.missions import Measurement, Mission, check_start, read_mission, skill_problem
from flexbt_formal.planning.planner import Plan, plan
from flexbt_formal.planning.problem import PlanningError
from flexbt_formal.planning.search import SearchOutcome
from flexbt_formal.planning.tree_xml import FAILURE_ENTRY, failed_action, tree_entries, tree_xml
from flexbt_server.leaves import LeafServices

LONGEST_SEARCH: Final = 3600.0
"""Maximum of the port ``time_limit``, s."""

MOST_ATTEMPTS: Final = 1000

_MEASURING: Final = 'MeasureWorld'
_PLANNED: Final = 'PlannedTree'

T = TypeVar('T')
SearchClock = Callable[[], float]
"""The clock of a search, s; it raises Halted when the search is canceled."""


class _NoWayError(PlanningError):
    """The goal cannot be reached from the measured state."""


@dataclass(frozen=True, slots=True)
class _Goal:
    """A mission, and the facts of it that sensors can measure."""

    mission: Mission
    goal: str
    library: SkillLibrary
    measurement: Measurement
    measuring: TreeLibrary


class ReachGoal(ExpandingAction):
    """Reaches the goal of a mission file: measures the world, plans the cheapest way, and executes the plan.

    ``docs/how_to/goals.md`` lists its steps. The plan's tree runs below this leaf and shares the blackboard
    around it, except for private entries.

    SUCCESS when the goal holds. FAILURE, with the reason, when no plan exists or the last of the ``attempts`` fails.
    A halt ends the search or the tree.
    """

    __slots__ = (
        '_board',
        '_goal',
        '_hopeless',
        '_left_out',
        '_next',
        '_sensors_by',
        '_start',
        '_thought',
        '_timeout',
        '_tried',
        '_why',
    )

    ports = {
        'mission': input_port(STRING, description='mission file: package/relative/path, or a path where trees may be'),
        'goal': input_port(STRING, default='', description="replaces the mission's goal"),
        'time_limit': input_port(
            DOUBLE, default='5.0', description='time for each search, s; the best plan until then is used'
        ),
        'attempts': input_port(UNSIGNED, default='3', description='maximum number of plans'),
        'sensor_timeout': input_port(DOUBLE, default='5.0', description='time to wait for missing sensor values, s'),
        'plan': output_port(STRING, description='the actions of the running plan, in order'),
    }
    example = Example(
        '<ReachGoal mission="flexbt_demo_behaviors/goals/cup.yaml" goal="thing_in(cup, office)" plan="{plan}"/>'
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._next: Callable[[], NodeStatus] = self._measure
        self._thought: _Thought[Any] | None = None
        self._left_out: dict[str, str] = {}
        self._tried = 0
        self._start: list[str] = []
        self._hopeless: list[str] | None = None
        self._why = ''

    @property
    def host(self) -> LeafServices:
        """Services of the BT server."""
        services: LeafServices = self.services
        return services

    def on_start(self) -> NodeStatus:
        limit, attempts = self.get_input('time_limit'), self.get_input('attempts')
        if not 0.0 < limit <= LONGEST_SEARCH:
            return self.fail(f'port time_limit: {limit!r} is not a time above 0 and up to {LONGEST_SEARCH:g} s')
        if not 0 < attempts <= MOST_ATTEMPTS:
            return self.fail(f'port attempts: {attempts!r} is not a number from 1 to {MOST_ATTEMPTS}')
        self._timeout = float(self.get_input('sensor_timeout'))
        if not 0.0 <= self._timeout < math.inf:
            return self.fail(f'port sensor_timeout: {self._timeout!r} is not a time of 0 or more, s')
        self._left_out.clear()
        self._tried = 0
        file, goal = str(self.get_input('mission')), str(self.get_input('goal'))
        return self._think(lambda clock: _read(self.host, file, goal), self._begin)

    def on_running(self) -> NodeStatus:
        try:
            return self._next()
        except _NoWayError as error:
            if self._hopeless is None:
                self._sensors_by = self.clock.now() + self._timeout
            self._hopeless = self._start
            self._why = str(error)
            self._next = self._await_measured
            return self._await_measured()
        except (PlanningError, SkillError, TreeLoadError, ResourceError) as error:
            return self.fail(str(error))

    def on_halted(self) -> None:
        if self._thought is not None:
            self._thought.stop()

    # -- one step after the other ------------------------------------------------------------------------------------

    def _begin(self, goal: _Goal) -> NodeStatus:
        self._goal = goal
        return self._measure()

    def _measure(self) -> NodeStatus:
        self._hopeless = None
        self._sensors_by = self.clock.now() + self._timeout
        self._next = self._await_measured
        return self._expand(self._goal.measuring, _MEASURING, ())

    def _await_measured(self) -> NodeStatus:
        status = self.tick_tree()
        if status is NodeStatus.RUNNING:
            return status
        if self.clock.now() < self._sensors_by and not all(leaf.is_informed for leaf in _leaves(self)):
            self.wake_at(self._sensors_by)  # a message for a sensor also wakes the tree
            return NodeStatus.RUNNING
        goal, limit, left_out = self._goal, float(self.get_input('time_limit')), dict(self._left_out)
        start = goal.measurement.start(goal.mission.start, lambda entry: self._board.get_or(entry, False) == 1)
        if self._hopeless is not None and self.clock.now() >= self._sensors_by:
            return self.fail(self._why)
        if start == self._hopeless:  # sensors may report one event at different times
            self.wake_at(self._sensors_by)
            return NodeStatus.RUNNING
        self.cancel_wake()
        self._start = start
        return self._think(lambda clock: _search(self.host, goal, start, left_out, limit, clock), self._carry_out)

    def _carry_out(self, found: tuple[Plan, TreeLibrary]) -> NodeStatus:
        planned, library = found
        self.set_output('plan', ', '.join(planned.actions))
        self._next = lambda: self._await_reached(planned)
        return self._expand(library, _PLANNED, tree_entries(planned))

    def _await_reached(self, planned: Plan) -> NodeStatus:
        status = self.tick_tree()
        if status is NodeStatus.RUNNING or status is NodeStatus.SUCCESS:
            return status
        why = str(self._board.get_or(FAILURE_ENTRY, ''))
        failed = failed_action(planned.problem, why)
        if failed is not None:
            action, what = failed
            told = truncate_middle(next(_reasons(self, action), ''))
            self._left_out[action] = what + (told and f': {told}')
            why += told and f': {told}'
        self._tried += 1
        if self._tried >= self.get_input('attempts'):
            return self.fail(f'gave up after {pluralize(self._tried, "attempt")}: {why}')
        return self._measure()

    def _expand(self, library: TreeLibrary, tree_id: str, own: tuple[str, ...]) -> NodeStatus:
        board = self._board = Blackboard(self.blackboard)
        for entry in own:
            board.declare(entry, None)  # private to this tree, even if another tree has the same name
        board.enable_autoremap()
        return self.expand(library, tree_id, board)

    def _think(self, work: Callable[[SearchClock], T], then: Callable[[T], NodeStatus]) -> NodeStatus:
        """Run ``work`` in a thread, and call ``then`` with its result."""
        thought = _Thought(self, work)
        self._thought = thought
        self._next = lambda: then(thought.result()) if thought.done() else NodeStatus.RUNNING
        return NodeStatus.RUNNING


class _Thought(Future[T]):
    """Work in a separate thread that wakes the node when it ends."""

    def __init__(self, node: ReachGoal, work: Callable[[SearchClock], T]) -> None:
        super().__init__()
        self._node = node
        self._stopped = False
        threading.Thread(target=self._run, args=(work,), name=f'plan {node.path}', daemon=True).start()

    def stop(self) -> None:
        """Cancel the work. Until the thread ends, the tree counts it as unfinished work."""
        self._stopped = True
        if not self.done():
            unfinished = self._node.context.add_unfinished(f'[{self._node.path}] ends its search')
            self.add_done_callback(lambda _: unfinished.done())

    def _clock(self) -> float:
        if self._stopped:
            raise Halted
        return time.perf_counter()

    def _run(self, work: Callable[[SearchClock], T]) -> None:
        try:
            self.set_result(work(self._clock))
        except BaseException as error:
            self.set_exception(error)
        if not self._stopped:
            self._node.wake()


def _leaves(above: TreeNode) -> Iterator[LeafNode]:
    """Yield the leaves below a node."""
    for node in above.attached:
        if isinstance(node, LeafNode):
            yield node
        yield from _leaves(node)


def _reasons(above: TreeNode, action: str) -> Iterator[str]:
    """Yield the last failure reasons that the leaves of an action reported."""
    for leaf in _leaves(above):
        reason = leaf.failure_reason()
        if leaf.name == action and reason != TreeNode.failure_reason(leaf):
            yield reason


def _read(host: LeafServices, file: str, goal: str) -> _Goal:
    """Return the goal of a mission file. Raises PlanningError, SkillError, ResourceError, TreeLoadError."""
    store = host.trees
    mission = read_mission(store.read_text(file), file)
    if mission.robots:
        raise PlanningError(f'{file} is for several robots; let bt_tool plan write its trees, and run those')
    library = node_skills(store.registry, host.warn_once)
    for name in mission.skills:
        beside = name if name.startswith('/') else posixpath.normpath(posixpath.join(posixpath.dirname(file), name))
        library = read_skills(store.read_text(beside), beside, library)
    check_start(library, mission.start)
    goal = goal or mission.goal
    if not goal:
        raise PlanningError(f'{file} names no goal; add it there (goal: ...), or give the port goal')
    measurement = Measurement.of(library, goal, store.registry.__contains__)
    return _Goal(mission, goal, library, measurement, _loaded(host, measurement.tree_xml(_MEASURING)))


def _search(
    host: LeafServices, goal: _Goal, start: list[str], left_out: Mapping[str, str], limit: float, clock: SearchClock
) -> tuple[Plan, TreeLibrary]:
    """Plan without the actions ``left_out``, each with its failure reason. Raises PlanningError, SkillError,
    TreeLoadError."""
    problem = skill_problem(goal.library, start, goal.goal, goal.mission.disturbances)
    problem = replace(problem, actions=tuple(action for action in problem.actions if action.name not in left_out))
    found = plan(problem, time_limit=limit, clock=clock)
    if found.policy is None:
        failed = (f'{name} ({why})' for name, why in sorted(left_out.items()))
        without = f' without {", ".join(failed)}' if left_out else ''
        if found.outcome is SearchOutcome.TIME_LIMIT:
            bound = '' if math.isinf(found.bound) else f'; none costs less than {found.bound:g}'
            raise PlanningError(f'no plan{without} was found within {limit:g} s{bound}')
        raise _NoWayError(f'there is no plan{without}: {found.reason}')
    return found, _loaded(host, tree_xml(found, _PLANNED))


def _loaded(host: LeafServices, text: str) -> TreeLibrary:
    return TreeLibrary([load_xml(text, '<plan>', host.trees.registry)])


def register(registry: NodeRegistry) -> None:
    """Add the leaf to a registry; see :data:`ENTRY_POINTS`."""
    registry.register_classes([ReachGoal])
