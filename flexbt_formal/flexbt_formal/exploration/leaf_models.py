# SPDX-License-Identifier: BSD-3-Clause
"""Models of the leaves of a tree in an exploration: they show every behavior that the real ones may show.

An action is RUNNING until the environment returns its result. After a halt it continues until the environment confirms
its end. Like an ActionLeaf of the BT server, it waits with its start while canceled work of its tree is still ending.
Conditions and actions that finish within a tick get a new answer in each tick. A decorator that depends on the robot
may start its child or not. The ``place`` of a model tells it from other nodes that have its path, since nodes may have
one name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar, Final

from flexbt_core.behavior_tree.engine.context import UnfinishedWork
from flexbt_core.behavior_tree.engine.leaf import LeafNode, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.registry import node_skill
from flexbt_core.behavior_tree.model.blackboard import EMPTY
from flexbt_core.behavior_tree.model.definition import NodeDefinition
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, PortType
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.nav2.controls import PauseResumeController
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.skills.skill import Skill

from .leaf_skills import Facts, needs_of
from .model import EnvironmentChoices, question_anew

_ENGINE: Final = 'flexbt_core.behavior_tree.nodes.'
_NAV2: Final = f'{_ENGINE}nav2.'
_RESULTS: Final = (SUCCESS, FAILURE)

_ERROR_CODE: Final = 'error_code'
_FAILS_WITHOUT: Final = {
    'InitialPoseReceived': 'initial_pose_received',
    'IsGoalNearby': 'path',
    'IsPathValid': 'path',
    'WouldAControllerRecoveryHelp': _ERROR_CODE,
    'WouldAPlannerRecoveryHelp': _ERROR_CODE,
    'WouldARouteRecoveryHelp': _ERROR_CODE,
    'WouldASmootherRecoveryHelp': _ERROR_CODE,
}
"""Conditions of Nav2 that fail while an optional input is missing. Of others it is not known what they return then."""


class LeafKind(Enum):
    """The model of a node. REAL: the node itself."""

    REAL = 'real'
    ACTION = 'action'
    INSTANT = 'instant'
    GATE = 'gate'
    PAUSE = 'pause'
    PASS = 'pass'  # noqa: S105


@dataclass(frozen=True)
class LeafModel:
    """The behavior that a node may show.

    ``results`` are its possible results. ``resources`` are the actuators that it uses while it works. A GATE that does
    not tick its child returns ``otherwise``; with ``begins_first``, it always ticks the child first, and while it is
    RUNNING. One that ``may_fail`` may also halt it and fail. After a halt, the tree does not wait for a node that
    ``ignores_cancel``. An ACTION that ``answers_soon`` may return its previous result at once: the server is ready,
    and its answer has not changed.
    """

    kind: LeafKind
    results: tuple[NodeStatus, ...] = _RESULTS
    resources: frozenset[str] = frozenset()
    otherwise: NodeStatus = RUNNING
    begins_first: bool = True
    may_fail: bool = False
    ignores_cancel: bool = False
    answers_soon: bool = False


LeafModels = Callable[[NodeDefinition], LeafModel]
"""A function that returns the model of a node."""

REAL: Final = LeafModel(LeafKind.REAL)
# Nodes that start their child depending on the robot, on messages or on requests. GoalUpdater only receives goals.
_GATES: Final = {
    'PathLongerOnApproach': LeafModel(LeafKind.GATE, otherwise=SUCCESS, begins_first=False),
    'GoalUpdatedController': LeafModel(LeafKind.GATE),
    'DistanceController': LeafModel(LeafKind.GATE, may_fail=True),
    'SpeedController': LeafModel(LeafKind.GATE),
    'GoalUpdater': LeafModel(LeafKind.PASS),
    'PauseResumeController': LeafModel(LeafKind.PAUSE),
}
_REACTIVE: Final = frozenset(('ReactiveSequence', 'ReactiveFallback', 'WhileDoElse'))
LIMITERS: Final = frozenset(
    ('RateController', *(id for id, model in _GATES.items() if model.kind is LeafKind.GATE and model.begins_first))
)
"""Decorators that limit how often their child starts, which has an effect only if they are ticked again."""


LISTENERS: Final = frozenset(('GoalUpdated', 'GlobalUpdatedGoal'))
"""Conditions on changes since their previous tick: if ticked only once, at the start, they detect nothing."""


def leaf_model(definition: NodeDefinition) -> LeafModel:
    """Return the model of a node, derived only from its class, its ports and its skill."""
    manifest = definition.manifest
    module = manifest.node_class.__module__
    if definition.tree_id is not None:
        return REAL
    if manifest.kind in (NodeKind.DECORATOR, NodeKind.CONTROL):
        if manifest.id in _GATES:
            return _GATES[manifest.id]
        return REAL
    if module.startswith(_ENGINE) and not module.startswith(_NAV2):
        return REAL
    skill = node_skill(manifest)
    own = frozenset(skill.resources) if skill is not None else frozenset[str]()
    ignores = skill is not None and skill.ignores_cancel
    is_instant = manifest.kind is NodeKind.CONDITION or issubclass(manifest.node_class, SyncAction)
    declared = manifest.outcomes
    possible = declared.possible(definition.values, ()).results if declared is not None else _RESULTS
    results = tuple(result for result in _RESULTS if result in possible)
    if is_instant:
        return LeafModel(LeafKind.INSTANT, results or _RESULTS, own)
    soon = issubclass(manifest.node_class, StatefulAction) and manifest.node_class.answers_soon
    return LeafModel(LeafKind.ACTION, results, own, ignores_cancel=ignores, answers_soon=soon)


class Environment:
    """State that all models share: the open actions, and the answers of the current step.

    ``open`` are the working actions, by path. ``canceling`` are the halted ones that have not ended, by path, with
    the unfinished work that the tree waits for.
    Of the current step: ``answers`` by path; ``begun``, the leaves that began; ``asked``, the conditions and
    decorators that were ticked, both with the result of ``described`` at that time; and ``events``, lines for people.
    ``due`` is the deadline of an attempt by its skill, by path, s.
    """

    def __init__(
        self, values: Mapping[str, tuple[Any, ...]], found: Callable[[Violation], None], events: list[str]
    ) -> None:
        self.open: dict[str, ModelAction] = {}
        self.canceling: dict[str, UnfinishedWork | None] = {}
        self.choices = EnvironmentChoices()
        self.events = events
        self.begun: list[tuple[str, tuple[str, ...]]] = []
        self.asked: dict[str, tuple[str, ...]] = {}
        self.described: Callable[[TreeNode], tuple[str, ...]] = lambda node: (node.id,)
        self.answers: dict[str, int] = {}
        self.values = values
        self.facts = Facts()
        self.due: dict[str, float] = {}
        self.found = found
        self.most_counted = 0
        """Attempts up to which a node without a limit counts, since a script may give it one."""
        self.removed: frozenset[str] | None = frozenset()
        """Keys that nodes may remove, in any scope; None: any."""

    def asks(self) -> None:
        """Begin a step: clear the answers and the measured facts, which may have changed."""
        self.events.clear()
        self.begun = []
        self.asked = {}
        self.answers = {}
        self.facts.measured.clear()

    def begin(self, action: ModelAction) -> None:
        """Record the start of an action."""
        self.facts.begins(action.place, action.needs, self.found)
        self.open[action.place] = action
        if action.declared is not None and action.declared.deadline is not None:
            self.due[action.place] = action.clock.now() + action.declared.deadline
        action.acts()
        self.begun.append((action.place, self.described(action)))
        self.events.append(f'{action.place} begins')

    def end(self, path: str) -> None:
        """Record that an action has ended with a result."""
        self.open.pop(path, None)
        self.due.pop(path, None)

    def rests(self, now: float) -> None:
        """End a tick: report each action that still works after its deadline."""
        self.facts.refresh()
        for path in [path for path, due in self.due.items() if due <= now]:
            declared = self.open[path].declared
            assert declared is not None
            text = f'{path} works on after {declared.deadline:g} s, when an attempt is to be given up by its skill'
            self.found(Violation(Property.DEADLINE, path, text))

    def cancel(self, action: ModelAction) -> None:
        """Record that an action was halted."""
        self.end(action.place)
        self.facts.works(action.needs)
        if not action.model.ignores_cancel:
            self.canceling[action.place] = action.context.add_unfinished(f'canceling {action.place}')
            self.events.append(f'{action.place} is being canceled')
        elif action.model.resources:
            self.canceling[action.place] = None
            self.events.append(f'{action.place} is halted, and what it has begun continues')
        else:
            self.events.append(f'{action.place} is halted')

    def confirm(self, path: str) -> None:
        """Record that a halted action has ended."""
        unfinished = self.canceling.pop(path)
        if unfinished is not None:
            unfinished.done()


def write_outputs(node: _Model | ModelGate, environment: Environment, status: NodeStatus) -> None:
    """Write the outputs that the real node would write with this result; without SUCCESS only the error codes."""
    for name, port in node.ports.items():
        value = node.port_values.get(name)
        if not port.writable or value is None or value.key is None:
            continue
        if status is SUCCESS or name.startswith('error'):
            entry = node.blackboard.declare(value.key, port.type)
            options = fitting(port.type, environment.values.get(value.key.removeprefix('@'), ()))
            if options:
                taken = environment.choices.choose(f'{node.place} writes {value.key}', [*map(repr, options)])
                entry.write(options[taken])
            else:
                entry.write(some_value(port.type))


class _Model(LeafNode):
    __slots__ = ('_path', 'needs', 'place')

    declared: ClassVar[Skill | None]
    model: ClassVar[LeafModel]
    needed: ClassVar[tuple[str, ...]]
    """Inputs that the real node reads."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._path = self.place = super().path
        self.needs = needs_of(self, self.declared, self.environment.facts.names)
        self.environment.facts.need(self.needs)

    @property
    def path(self) -> str:
        return self._path

    @property
    def environment(self) -> Environment:
        environment: Environment = self.services
        return environment

    @property
    def server(self) -> str:
        """Name of the server that the node needs to succeed: its type, and the server name if the tree sets one."""
        given = (self.port_values.get(port) for port in ('server_name', 'service_name'))
        name = next((value.text for value in given if value is not None and value.key is None), '')
        return f'{self.id} ({name})' if name else self.id

    def read(self) -> None:
        """Read the inputs that the real node reads. Raises PortError."""
        for name in self.needed:
            self.get_input(name)

    def fails(self) -> bool:
        """Return whether the real node certainly fails, because an entry of the blackboard was never written."""
        value = self.port_values.get(_FAILS_WITHOUT.get(self.id, ''))
        if value is None or value.key is None:
            return False
        entry = self.blackboard.entry(value.key)
        return entry is None or entry.value is EMPTY

    def write(self, status: NodeStatus) -> None:
        """Write the outputs for this result, and apply the effects of the skill."""
        write_outputs(self, self.environment, status)
        self.environment.facts.ends(self.place, self.needs, status)

    def answer(self) -> NodeStatus:
        """Return an immediate result from the environment: of a condition the same one within a step, of an action that
        is done again in it another one each time."""
        results = self.model.results
        known = self.environment.answers
        question = self.place if self.kind is NodeKind.CONDITION else question_anew(self.place, known)
        if question not in known:
            known[question] = self.environment.choices.choose(question, [result.name for result in results])
        return results[known[question]]


class ModelInstant(_Model):
    """A leaf that finishes within one tick: a condition, or an action that only computes."""

    __slots__ = ()

    def execute(self) -> NodeStatus:
        try:
            self.read()
            self.environment.facts.begins(self.place, self.needs, self.environment.found)
            described = self.environment.described(self)  # before `write`, which may change its inputs
            status = FAILURE if self.fails() else self.answer()
            self.write(status)
        except Exception as error:
            raise self.fault(error) from error
        self.status = status
        if self.kind is NodeKind.CONDITION:
            self.environment.asked[self.place] = described
        else:
            self.environment.begun.append((self.place, described))
            self.environment.events.append(f'{self.place} is done: {status.name}')
        return status


class ModelAction(_Model, StatefulAction):
    """An action that works until the environment returns a result, or confirms that it was canceled."""

    __slots__ = ('before', 'is_asked_anew', 'is_waiting', 'result')

    goes_on = ''
    acts_later = True

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.result: NodeStatus | None = None
        self.is_asked_anew = False  # in each tick, while a later sibling works
        self.before: NodeStatus | None = None  # its last result, if that matters
        self.is_waiting = False

    def on_start(self) -> NodeStatus:
        self.read()
        self.result = None
        self.is_waiting = bool(self.context.unfinished)
        if self.is_waiting:
            return RUNNING
        self.environment.begin(self)
        if self.before is not None and self._answers_at_once():
            self.result = self.before
            return self.on_running()
        return RUNNING

    def _answers_at_once(self) -> bool:
        """Return whether its result is available in the tick that starts it; at most once in a step, since an answer
        takes time."""
        known = self.environment.answers
        if self.place in known:
            return False
        known[self.place] = 0
        return self.environment.choices.choose(f'{self.place} answers at once', ('no', 'yes')) == 1

    def on_running(self) -> NodeStatus:
        environment = self.environment
        if self.is_waiting and not self.context.unfinished:
            self.is_waiting = False
            environment.begin(self)
        if self.result is None:
            return RUNNING
        status, self.result = self.result, None
        if self.model.answers_soon and self.is_asked_anew:
            self.before = status
        environment.end(self.place)
        self.write(status)
        return status

    def on_halted(self) -> None:
        if not self.is_waiting:
            self.environment.cancel(self)
        self.is_waiting = False
        self.result = None


def mark_asked_anew(nodes: Iterable[TreeNode]) -> None:
    """Mark the actions of a tree that a reactive control node ticks again in each tick, before a later child."""
    for node in nodes:
        asked = list(node.attached[:-1]) if node.id in _REACTIVE else []
        for one in asked:
            asked += one.attached
            if isinstance(one, ModelAction):
                one.is_asked_anew = True


class ModelGate(Decorator):
    """A decorator that may tick its child or not."""

    __slots__ = ('place',)

    model: ClassVar[LeafModel]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.place = self.path

    def tick(self) -> NodeStatus:
        environment: Environment = self.services
        model = self.model
        is_working = model.begins_first and (not self.active or self.child.status is RUNNING)
        begins = is_working or model.kind is LeafKind.PASS
        ways = ('yes', *(() if begins else ('no',)), *(('it fails',) if model.may_fail else ()))
        environment.asked[self.place] = environment.described(self)
        taken = ways[environment.choices.choose(f'{self.place} begins its child', ways)]
        if taken == 'it fails':
            self.halt_child()
            return FAILURE
        self.status = RUNNING
        if model.kind is LeafKind.PASS:
            write_outputs(self, environment, SUCCESS)
        return self.tick_child() if taken == 'yes' else model.otherwise


class ModelPause(PauseResumeController):
    """A PauseResumeController that may get a request before each tick, by the services that its ports name."""

    __slots__ = ('place',)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.place = self.path

    def tick(self) -> NodeStatus:
        environment: Environment = self.services
        port, request = ('resume', self.resume) if self.awaits_request else ('pause', self.pause)
        is_offered = self.active and self.get_input_or(f'{port}_service_name', '')
        if is_offered and self.place not in environment.answers:
            taken = environment.choices.choose(f'{self.place} is asked to {port}', ('no', 'yes'))
            environment.answers[self.place] = taken
            if taken:
                request()
        return super().tick()


_CLASSES: Final[Mapping[LeafKind, type[Any]]] = {
    LeafKind.ACTION: ModelAction,
    LeafKind.INSTANT: ModelInstant,
    LeafKind.GATE: ModelGate,
    LeafKind.PAUSE: ModelPause,
    LeafKind.PASS: ModelGate,
}


def substitute(definition: NodeDefinition, model: LeafModel) -> NodeDefinition:
    """Return the definition of a node with its class replaced by the model."""
    if model.kind is LeafKind.REAL:
        return definition
    manifest = definition.manifest
    needed = tuple(
        name
        for name, port in manifest.ports.items()
        if port.readable and (port.required or port.default is not NO_DEFAULT)
    )
    namespace = {
        '__slots__': (),
        '__module__': __name__,
        'kind': manifest.kind,
        'ports': manifest.ports,
        'model': model,
        'skill': Skill.of(resources=sorted(model.resources)),
        'declared': node_skill(manifest),
        'needed': needed,
    }
    base = _CLASSES[model.kind]
    return definition._replace(manifest=replace(manifest, node_class=type(base.__name__, (base,), namespace)))


# -- values ----------------------------------------------------------------------------------------------------------


def fitting(kind: PortType | None, values: Iterable[Any]) -> tuple[Any, ...]:
    """Return the distinct values of a type: numbers for booleans if there are no others of it. If it may be any,
    prefer numbers and strings to booleans."""
    values = [*values]
    if kind is None or kind.python_type is object:
        fit = [one for one in values if type(one) is not bool] or values
    else:
        fit = [one for one in values if type(one) is kind.python_type]
        if not fit and kind.python_type in (int, float, str):
            fit = [kind.python_type(one) for one in values if not isinstance(one, str)]
    return tuple(dict.fromkeys(fit))


def some_value(kind: PortType | None) -> Any:
    """Return any value of a type."""
    if kind is None or kind.python_type is object:
        return 'value'
    try:
        return kind.python_type()
    except Exception:  # the type may run any code: use a placeholder then
        return 'value'
