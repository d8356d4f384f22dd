# SPDX-License-Identifier: BSD-3-Clause
"""A behavior tree with its environment, as the BT server runs it: ticked after each event and at each timer."""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.context import TreeContext, UnfinishedWork
from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import ControlNode, DecoratorNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, NodeExecutionError, PortError
from flexbt_core.behavior_tree.model.ports import (
    DOUBLE,
    INT,
    KEY,
    NO_DEFAULT,
    UNSIGNED,
    Port,
    PortType,
    PortValue,
)
from flexbt_core.behavior_tree.model.status import IDLE, RUNNING, SUCCESS, NodeStatus
from flexbt_core.behavior_tree.nodes.blackboard import UpdateDecorator, WasEntryUpdated
from flexbt_core.behavior_tree.nodes.loops import Loop
from flexbt_core.behavior_tree.nodes.nav2.decorators import RateController
from flexbt_core.behavior_tree.nodes.timing import Delay, Sleep, Timeout
from flexbt_core.behavior_tree.script.interpreter import BoundScript
from flexbt_core.monitors.properties import Property, Violation, shared_keys
from flexbt_core.monitors.requirement_text import Vocabulary
from flexbt_core.monitors.requirements import Requirement, Requirements
from flexbt_core.monitors.tree_monitor import TreeMonitor

from .configuration import Configuration, Layout, StateSnapshotter
from .leaf_models import (
    LIMITERS,
    LISTENERS,
    Environment,
    LeafKind,
    LeafModels,
    ModelAction,
    ModelGate,
    ModelInstant,
    ModelPause,
    fitting,
    leaf_model,
    mark_asked_anew,
    some_value,
    substitute,
)
from .leaf_skills import Facts
from .model import CONFIRMED, LAPSE, START, STOP, TIMER, EnvironmentChoices, Label, LabelEffect, System
from .script_values import Compared, compared_in, constants_of, tested_values
from .virtual_time import VirtualClock

RESULT: Final = 'result'
TICK: Final = 'tick'

_MODELS: Final = (ModelAction, ModelGate, ModelInstant, ModelPause)
TIMED: Final = (Timeout, Delay, Sleep, RateController)
"""The nodes of the engine that wait for a time and have no model."""
_ONE_BY_ONE: Final = frozenset(
    (
        *('Sequence', 'AsyncSequence', 'SequenceWithMemory', 'PersistentSequence', 'Fallback', 'AsyncFallback'),
        *(
            'TryCatch',
            'IfThenElse',
            'RecoveryNode',
            'RoundRobin',
            'PauseResumeController',
            *(f'Switch{cases}' for cases in range(2, 7)),
        ),
    )
)
"""Controls of which one child works at a time."""

STOPPED: Final = 'stopped'
"""The result of a tree that was stopped."""
SUCCEEDS: Final = f'={SUCCESS.name}'
"""The end of a tree by success, among what it promises."""
_PLAIN: Final = (bool, int, float, str)
"""Types of values that are compared and shown; of other values only the presence counts."""
_COUNTS: Final = (1, 2)
_NUMBERS: Final[Mapping[str, tuple[Any, ...]]] = {
    INT.name: _COUNTS,
    UNSIGNED.name: (1, 100_000),  # ms
    DOUBLE.name: (1.0,),
}
"""Numbers for a port of a node of the engine, of unknown value: not 0, by which most nodes do nothing."""
_ROUNDS: Final = 200
"""Ticks in a row that count as a livelock."""

_CONSTANT: Final = (
    '_values',
    'context',
    'blackboard',
    'id',
    'name',
    'uid',
    '_scope',
    'conditions',
    '_entries',
)
_NAME: Final = re.compile(r'[A-Za-z_]\w*')
_OURS: Final = 'flexbt_core.behavior_tree.'
_ASSIGNED: Final = re.compile(r'([A-Za-z_@]\w*)\s*(?::=|[-+*/]?=(?!=))')

TREE_LAYOUT: Final = Layout(
    fixed=(NodeDefinition, BoundScript),
    constant={
        TreeNode: frozenset(_CONSTANT),
        ControlNode: frozenset(('children', '_ticks')),
        DecoratorNode: frozenset(('child', '_tick')),
        TreeContext: frozenset(
            (
                'clock',
                'services',
                'scripts',
                'on_wake',
                'observers',
                'log',
                'callbacks',
                '_lock',
                'rewrapped',
                'monitor',
                'resting',
                'waited',
                '_awaited',
            )
        ),
        Blackboard: frozenset(('lock', '_parent', '_root', '_remaps')),
        UnfinishedWork: frozenset(('_context',)),
        Environment: frozenset(
            (
                *('values', 'choices', 'events', 'begun', 'asked', 'described', 'answers', 'found', 'most_counted'),
                'removed',
            )
        ),
        Facts: frozenset(('_needed', 'measured', 'names')),
        ModelAction: frozenset(('needs', '_path', 'place')),
        ModelInstant: frozenset(('needs', '_path', 'place')),
        ModelGate: frozenset(('place',)),
        ModelPause: frozenset(('place', '_lock')),
        TreeMonitor: frozenset(
            (
                *('_found', '_tree', '_nodes', '_resources', '_aliases', '_called', '_named', '_has_requirements'),
                *('_is_woken_only', '_answers'),
            )
        ),
        Requirements: frozenset(('requirements', 'whiles', 'aparts', '_now', '_found', '_by_event', 'happened')),
        Tree: frozenset(
            (
                *('key', 'blackboard', 'context', 'nodes', 'definitions', 'subtrees', 'callbacks', 'root', '_depth'),
                *('_after_round', '_entry', '_max_rounds', '_trunk', '_expanded', '_on_expanded', 'on_livelock'),
            )
        ),
    },
    ignored={
        TreeNode: frozenset(('decided_by', '_failed', '_child_failed', '_expired')),
        LeafNode: frozenset(('_reason',)),
        Entry: frozenset(('sequence',)),
        Facts: frozenset(('_written',)),
        TreeContext: frozenset(('earliest',)),
        Tree: frozenset(('_failure',)),
        # As long as there is no violation, the state of the tree determines these.
        TreeMonitor: frozenset(('_open', 'going_on', '_acting', '_ending', '_starting', '_is_taken')),
        VirtualClock: frozenset(('time',)),
    },
    views={
        PortType: {'': lambda type: type.name},
        TreeNode: {'_count': lambda node: _counted(node)},
        UpdateDecorator: {'_seen': lambda node: _writes_seen(node)},
        WasEntryUpdated: {'_seen': lambda node: _writes_seen(node)},
        # What an IDLE node remembers of a time, it does not read again.
        Sleep: {'_deadline': lambda node: node._deadline if node.stored_status is RUNNING else None},
        RateController: {'_start': lambda node: None if node.stored_status is IDLE else node._start},
    },
)


def remove_entries(tree: Tree) -> None:
    """Remove all entries of a tree, before a configuration with :data:`TREE_LAYOUT` is restored.

    Nodes and scripts keep the entries that they have found. Those that the configuration does not have stay removed.
    """
    for subtree in tree.subtrees:
        for key in subtree.blackboard:
            subtree.blackboard.unset(key)


def _is_unlimited(node: Any) -> bool:
    """Return whether a node counts attempts without a limit."""
    limit = getattr(node, 'limit', None)
    try:
        return limit is not None and node.get_input(limit) == -1
    except PortError:
        return False  # not written yet, or not a number: the tick that needs it reports that


def _counted(node: Any) -> int:
    """Return the attempts that a node has counted; without a limit they do not matter, unless it may get one."""
    count: int = node._count
    if not _is_unlimited(node):
        return count
    return 0 if node.port_values[node.limit].key is None else min(count, getattr(node.services, 'most_counted', 0))


def removed_by(nodes: Iterable[TreeNode]) -> frozenset[str] | None:
    """Return the keys that nodes may remove, each from its scope; None: any."""
    keys = [node.port_values['key'] for node in nodes if node.id == 'UnsetBlackboard']
    return None if any(one.key is not None for one in keys) else frozenset(one.text for one in keys)


def _writes_seen(node: UpdateDecorator | WasEntryUpdated) -> Any:
    """Return the number of writes that a node has seen in relation to the current one. If the entry may be removed,
    return also by how many writes a new one has that number again."""
    removed: frozenset[str] | None = node.services.removed
    if removed is not None and node.blackboard.outermost(node._key)[1] not in removed:
        return node._seen == node._entry.sequence
    entry = node._entry if node._entry.present else node.blackboard.entry(node._key)
    return node._seen, 0 if entry is None else min(entry.sequence, node._seen + 1)


def _goes_on_for_ever(node: TreeNode) -> bool:
    """Return whether a node restarts its child without limit, until it fails or is stopped."""
    return node.id == 'KeepRunningUntilFailure' or (node.id == 'Repeat' and _is_unlimited(node))


def _places(nodes: Iterable[TreeNode]) -> dict[TreeNode, str]:
    """Return the path of each node, with the number of the node where several have one name."""
    paths = {node: node.path for node in nodes}
    counts = Counter(paths.values())
    for node, path in paths.items():
        place = path
        while counts[place] > 1 or (place != path and place in counts):
            place += f'::{node.uid}'
        paths[node] = place
    return paths


def _times_in(node: TreeNode) -> int:
    """Return for how many times a node and those below it may wait at once; of one that is not known: several."""
    below = [_times_in(child) for child in node.attached]
    inside = max(below, default=0) if node.id in _ONE_BY_ONE else sum(below)
    if isinstance(node, _MODELS):
        skill = node.declared if isinstance(node, ModelAction) else None
        return inside + (skill is not None and skill.deadline is not None)
    if not type(node).__module__.startswith(_OURS):
        return inside + 2
    return max(inside, 1) if isinstance(node, Delay) else inside + isinstance(node, TIMED)


class _PortUse(NamedTuple):
    """A port that is bound to a key: the declared port (None if only its name is known), the key, the entry."""

    node: TreeNode
    port: Port | None
    key: str
    entry: Entry | None


class TreeSystem(System):
    """A tree with its own clock.

    ``models`` returns the model of a node. ``given`` are keys that are on the blackboard from the start, as are those
    that the tree reads and never writes. ``requirements`` are checked after each tick. ``observed`` are keys that
    others read after the end of the tree. The constants of the library ``beside``, of another version, are also tried.
    With ``reduces``, keys that nothing reads do not distinguish configurations.
    """

    def __init__(
        self,
        library: TreeLibrary,
        key: TreeKey,
        models: LeafModels = leaf_model,
        *,
        given: Iterable[str] = (),
        requirements: Iterable[Requirement] = (),
        observed: Iterable[str] = (),
        beside: TreeLibrary | None = None,
        reduces: bool = True,
    ) -> None:
        """Raise TreeLoadError or LookupError, as Tree does."""
        super().__init__()
        monitor = self._monitor = TreeMonitor(self._note, requirements)
        self.requirements = monitor.requirements
        board = self._board = Blackboard()
        documents = [*library.documents.values(), *(() if beside is None else beside.documents.values())]
        nodes = [node for document in documents for tree in document.trees.values() for node in tree.nodes()]
        scripts = [*_scripts(nodes)]
        enums = {name: one for document in documents for name, one in document.scripts.enums.items()}
        copied = [*_copies(nodes)]
        compared = [*_switches(nodes), *_ports(node for node in nodes if models(node).kind is LeafKind.REAL)]
        compared += (part for script in scripts for part in compared_in(script, enums))
        values = tested_values(compared, copied)
        numbers = (one for part in (*compared, *copied) for one in part.constants if not isinstance(one, str))
        self._environment = Environment(values, self._note, self._events)
        self._environment.most_counted = 1 + int(max([*_COUNTS, *filter(math.isfinite, numbers)]))
        self._ticked: set[int] = set()
        self._has_succeeded = False
        self._observed = frozenset(observed)
        self.tree = Tree(
            library,
            key.id,
            file=key.file,
            blackboard=board,
            clock=self.clock,
            services=self._environment,
            substitute=lambda definition, path: monitor.watched(substitute(definition, models(definition)), path),
            max_rounds=_ROUNDS,
        )
        self._environment.removed = removed_by(self.tree.nodes)
        self._places = _places(self.tree.nodes)
        for node in self.tree.nodes:
            if isinstance(node, _MODELS):
                node.place = self._places[node]
        self.tree.on_livelock = lambda message: None  # the findings report it
        self.tree.observe(self._note_status)
        self.lapses = _times_in(self.tree.root) + self._times_required > 1
        mark_asked_anew(self.tree.nodes)
        self._limiters = [node for node in self.tree.nodes if isinstance(node, DecoratorNode) and node.id in LIMITERS]
        self._withheld: set[int] = set()
        self._listeners = [node for node in self.tree.nodes if isinstance(node, ModelInstant) and node.id in LISTENERS]
        self._heard: set[int] = set()
        monitor.begins(self.tree)
        self._questions: list[tuple[str, Entry, tuple[Any, ...]]] = []
        declared = {key: board.declare(key, None) for key in sorted(set(given))}
        self._entry_names = {
            entry: key
            for subtree in reversed(self.tree.subtrees)
            for key, entry in subtree.blackboard.entries().items()
        }
        uses = [
            _PortUse(node, node.ports.get(name), value.key, node.blackboard.entry(value.key))
            for node in self.tree.nodes
            for name, value in node.port_values.items()
            if value.key is not None
        ]
        self.given = self._give(declared, uses)
        self._environment.described = self._described
        unread = self._unread(scripts, uses)
        self._writes = self._written_keys(unread, uses)
        self._merged = frozenset(unread if reduces else ())
        self._run = _Run()
        self._memory = StateSnapshotter(
            (
                self._run,
                self.tree,
                *self.tree.nodes,
                *(subtree.blackboard for subtree in self.tree.subtrees),
                *(entry for subtree in self.tree.subtrees for entry in subtree.blackboard.entries().values()),
                self.tree.context,
                self.clock,
                self._environment,
                self._monitor,
            ),
            self.clock,
            TREE_LAYOUT,
            unread=self._merged,
        )

    def _unread(self, scripts: Iterable[str], uses: Iterable[_PortUse]) -> list[Entry]:
        """Return the entries that nothing reads; none if the tree has a custom node, which may read any entry."""
        known = (isinstance(node, _MODELS) or type(node).__module__.startswith(_OURS) for node in self.tree.nodes)
        if not all(known):
            return []
        names = self._observed.union(_NAME.findall(' '.join(scripts)))
        boards = [subtree.blackboard for subtree in self.tree.subtrees]
        entries = [(key, entry) for board in boards for key, entry in board.entries().items()]
        read = {entry for key, entry in entries if key in names} | {
            use.entry for use in uses if use.port is None or use.port.readable
        }
        return [entry for _, entry in entries if entry not in read]

    def _written_keys(self, unread: Collection[Entry], uses: Iterable[_PortUse]) -> Mapping[str, Sequence[str]]:
        """Return the keys that nodes write and others may read, by path. A port without a declaration may be an input,
        so it does not count."""
        found: dict[str, list[str]] = defaultdict(list)
        for node, port, _, entry in uses:
            writes = port is not None and port.writable and (port.declares or not port.readable)
            if writes and entry is not None and entry not in unread:
                found[self._places[node]].append(self._entry_names[entry])
        return found

    @property
    def removed(self) -> frozenset[str] | None:
        """Keys of the outermost blackboard that the tree may remove; None: any."""
        # One in a sub-tree removes a key of that scope only.
        return removed_by(node for node in self.tree.nodes if node.blackboard is self._board)

    def _give(self, declared: Mapping[str, Entry], uses: Iterable[_PortUse]) -> tuple[str, ...]:
        """Write the initial entries; return their keys, each by its name nearest to the root."""
        read: dict[Entry, str] = {}
        needed: set[Entry] = set()
        written: set[Entry] = set()
        for node, definition in zip(self.tree.nodes, self.tree.definitions, strict=True):
            keys = [name for script in _scripts([definition]) for name in _ASSIGNED.findall(script)]
            named = {name for name, port in node.ports.items() if port.writable and port.literal is KEY}
            keys += [value.text for name, value in node.port_values.items() if value.key is None and name in named]
            written.update(entry for key in keys if (entry := node.blackboard.entry(key)) is not None)
        for _, port, _, entry in uses:
            if port is None or entry is None:
                continue
            if port.readable:
                read.setdefault(entry, self._entry_names[entry])
                if port.required or port.default is not NO_DEFAULT:
                    needed.add(entry)
            if port.writable:
                written.add(entry)
        tested = self._tested()
        for key, entry in declared.items():
            if entry in tested:  # scripts read it, by any name
                read.setdefault(entry, key)
                needed.add(entry)
        found = []
        outermost = frozenset(self._board.entries().values())  # from outside nobody writes into a sub-tree
        for entry, key in read.items():
            if entry in outermost and entry.value is EMPTY and (entry not in written or key in declared):
                options = fitting(entry.type, tested.get(entry, ()))
                entry.write(options[0] if options else some_value(entry.type))
                if len(options) > 1:
                    self._questions.append((key, entry, options))
                found.append((key, entry in needed))
        self.needed = frozenset(key for key, is_needed in found if is_needed)
        """Keys in ``given`` that a node requires."""
        return tuple(sorted({key for key, _ in found}))

    def _tested(self) -> dict[Entry, tuple[Any, ...]]:
        """Return the values that affect scripts, by entry, under any name in a sub-tree."""
        found: dict[Entry, tuple[Any, ...]] = {}
        for subtree in self.tree.subtrees:
            for key, values in self._environment.values.items():
                entry = subtree.blackboard.entry(key)
                if entry is not None:
                    found[entry] = found.get(entry, ()) + values
        return found

    # -- interface of System -----------------------------------------------------------------------------------------

    def capture(self) -> Configuration:
        configuration = super().capture()
        if self._run.result is None:
            return configuration
        # Only the ends of canceled actions can follow.
        canceling, written = sorted(self._environment.canceling), sorted(self.written & self._observed)
        return configuration.known_by((self._run.result, canceling, written))

    def restore(self, configuration: Configuration) -> None:
        remove_entries(self.tree)
        super().restore(configuration)

    @property
    def vocabulary(self) -> Vocabulary:
        """Names that requirements of this tree can use."""
        return self._monitor.vocabulary

    @property
    def ended(self) -> str | None:
        return self._run.result if self._run.result is not None and not self.tree.unfinished else None

    @property
    def is_over(self) -> bool:
        return self._run.result is not None

    @property
    def written(self) -> frozenset[str]:
        known = {key: entry for key, entry in self._board.entries().items() if entry not in self._merged}
        return frozenset(key for key, entry in known.items() if entry.value is not EMPTY and key not in self.given)

    def labels(self) -> Sequence[Label]:
        run, environment = self._run, self._environment
        if not run.is_started:
            return [Label(START)]
        if self.ended is not None:
            return []
        confirms = [Label(CONFIRMED, path) for path in environment.canceling]
        if run.result is not None:
            return confirms
        labels = [
            Label(RESULT, path, status.name)
            for path, action in environment.open.items()
            for status in action.model.results
        ]
        labels += confirms
        if labels:
            labels += self._lapse_labels()
        if self._next_due() is not None:
            labels.append(Label(TIMER))
        labels += [Label(TICK), Label(STOP)]
        return labels

    def answer(self, label: Label) -> LabelEffect | None:
        if label.kind != RESULT:
            return None
        return LabelEffect(self._environment.open[label.subject].server, label.value == SUCCESS.name)

    def step(self, label: Label, choices: EnvironmentChoices) -> list[Violation]:
        run, environment = self._run, self._environment
        environment.choices = choices
        environment.asks()
        self._found = []
        if label.kind == LAPSE:
            self.clock.lapse(self._next_due())
        elif label.kind == STOP:
            self._halt(STOPPED)
        else:
            if label.kind == START:
                run.is_started = True
                for key, entry, options in self._questions:
                    entry.write(options[choices.choose(f'given {key}', [*map(repr, options)])])
                self._monitor.check_parts()
            elif label.kind == RESULT:
                environment.open[label.subject].result = NodeStatus[label.value]
            elif label.kind == CONFIRMED:
                environment.confirm(label.subject)
            elif label.kind == TIMER:
                due = self._next_due()
                if due is not None:
                    self.clock.go_to(due)
            if run.result is None:
                self._tick()
        return self._found

    def position(self) -> str:
        if not self._run.is_started:
            return 'nothing was ticked yet'
        if self._run.result is not None:
            return f'the tree has ended: {self._run.result}'
        leaves = self.tree.active_nodes(leaves_only=True)
        return f'RUNNING: {", ".join(leaves) or self.tree.active_nodes()[-1]}'

    def paths(self) -> Sequence[str]:
        return list(self._places.values())

    def begun(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        return self._environment.begun

    def asked(self) -> Mapping[str, tuple[str, ...]]:
        return self._environment.asked

    def handed_over(self) -> Mapping[str, str]:
        if self._run.result in (None, STOPPED):
            return {}
        entries = self._board.entries().items()
        return {key: repr(entry.value) for key, entry in entries if type(entry.value) in _PLAIN}

    def _described(self, node: TreeNode) -> tuple[str, ...]:
        """Return the type of a leaf, and its ports with their keys and, for inputs of plain types, their current
        values."""
        return (node.id, *(self._port_text(node, name) for name in sorted(node.port_values)))

    def _port_text(self, node: TreeNode, name: str) -> str:
        value = node.port_values[name]
        if value.key is None:  # 0.20 and 0.2 are the same number
            return f'{name}="{value.literal if type(value.literal) in _PLAIN else value.text}"'
        entry = node.blackboard.entry(value.key)
        key = value.key if entry is None else self._entry_names.get(entry, value.key)
        is_read = name not in node.ports or node.ports[name].readable
        is_plain = is_read and entry is not None and type(entry.value) in _PLAIN
        plain = f' ({entry.value!r})' if entry is not None and is_plain else ''
        return f'{name}="{{{key}}}"{plain}'

    def covered(self) -> frozenset[str]:
        ended = [SUCCEEDS] if self._has_succeeded else []
        return frozenset((*(place for node, place in self._places.items() if node.uid in self._ticked), *ended))

    def coverable(self) -> frozenset[str]:
        return frozenset(self._places.values())

    def promised(self) -> frozenset[str]:
        """Return all nodes, and success unless the tree repeats without limit: a node that is never ticked is
        dead code. A tree that cannot fail is allowed."""
        return self.coverable() if any(map(_goes_on_for_ever, self.tree.nodes)) else self.coverable() | {SUCCEEDS}

    def idle(self) -> Iterable[Violation]:
        """Yield violations for decorators that never delayed their child, and for conditions on changes that are ticked
        only while no action works that a change could end."""
        for node in self._limiters:
            if node.uid not in self._withheld:
                place = self._places[node]
                text = (
                    f'{place} never makes its child wait: it is not ticked again after the child has succeeded, '
                    'so the child is done once'
                )
                yield Violation(Property.LIMITS, place, text)
        for listener in self._listeners:
            if listener.uid in self._ticked and listener.uid not in self._heard:
                text = (
                    f'{listener.place} is asked only before something works: what changes meanwhile is not heard, as '
                    'it would be below a ReactiveFallback or ReactiveSequence'
                )
                yield Violation(Property.LISTENS, listener.place, text)

    # -- the host ----------------------------------------------------------------------------------------------------

    def _next_due(self) -> float | None:
        given = (
            *self._environment.due.values(),
            self.tree.next_wake,
            self.clock.next_timer(),
            self.requirements.next_due(),
        )
        times = [time for time in given if time is not None]
        return min(times, default=None)

    def _tick(self) -> None:
        tree, environment = self.tree, self._environment
        working = [path for path, action in environment.open.items() if action.result is None]
        tree.take_wake()
        try:
            status = tree.tick_once()
        except NodeExecutionError as error:
            self._note(_fault(error))
            self._halt('ERROR')
            return
        if status is RUNNING and tree.wake_pending:
            text = f'the tree wakes itself over and over ({_ROUNDS} ticks in a row) and waits for nothing'
            self._note(Violation(Property.NO_LIVELOCK, tree.key.id, text))
        self._monitor.ticked(status)
        environment.rests(self.clock.now())
        if len(environment.open) > 1:
            for violation in shared_keys((path, self._writes[path]) for path in environment.open):
                self._note(violation)
        for node in self._limiters:
            if node.status is RUNNING and node.child.status is not RUNNING:
                self._withheld.add(node.uid)
        if any(path in environment.open for path in working):
            self._heard.update(node.uid for node in self._listeners if node.place in environment.asked)
        if status is not RUNNING:
            self._events.append(f'the tree ends: {status.name}')
            self._halt(status.name)

    def _halt(self, result: str) -> None:
        self._run.result = result
        self._has_succeeded |= result == SUCCESS.name
        try:
            self.tree.halt()
        except NodeExecutionError as error:
            self._note(_fault(error))
        self._monitor.halted()

    def _note_status(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        if after is not IDLE:
            self._ticked.add(node.uid)


class _Run:
    """State of the run that the host of the tree keeps."""

    def __init__(self) -> None:
        self.is_started = False
        self.result: str | None = None


def _scripts(nodes: Iterable[NodeDefinition]) -> Iterable[str]:
    for node in nodes:
        yield from (script.text for script in node.conditions.values())
        yield from (value.text for name, value in node.values.items() if name in ('code', 'if', 'switch'))


def _switches(nodes: Iterable[NodeDefinition]) -> Iterator[Compared]:
    """Yield the comparisons of each Switch."""
    for node in nodes:
        decides = node.values.get('variable')
        if decides is not None and decides.key is not None:
            cases = [value for name, value in node.values.items() if name.startswith('case_')]
            yield Compared(_keys(decides, *cases), tuple(_texts(cases)))


def _copies(nodes: Iterable[NodeDefinition]) -> Iterator[Compared]:
    """Yield keys and constants of one value: in a sub-tree and outside of it, copied or written by a node, or of a
    queue."""
    for node in nodes:
        if node.tree_id is not None:
            for name, value in node.values.items():
                yield Compared((name, *_keys(value)), tuple(constants_of(_texts([value]))))
        elif (key := node.values.get('output_key')) is not None:
            others = [value for name, value in node.values.items() if name != 'output_key']
            yield Compared((key.text.removeprefix('@'), *_keys(*others)), tuple(constants_of(_texts(others))))
        elif issubclass(node.manifest.node_class, Loop) and (key := node.values.get('value')) is not None:
            elements = (one for text in _texts([node.values['queue']]) for one in text.split(';'))
            yield Compared(_keys(key), tuple(constants_of(elements)))


def _keys(*values: PortValue) -> tuple[str, ...]:
    return tuple(value.key.removeprefix('@') for value in values if value.key is not None)


def _texts(values: Iterable[PortValue]) -> Iterator[str]:
    return (value.text for value in values if value.key is None)


def _ports(nodes: Iterable[NodeDefinition]) -> Iterator[Compared]:
    """Yield the keys of queues of a Loop, each with one of two elements and an empty one, and of numbers by which
    the nodes of the engine count or measure time."""
    for node in nodes:
        kind = node.manifest.node_class
        for name, value in node.values.items():
            port = node.manifest.ports.get(name)
            if value.key is None or port is None or not port.readable:
                continue
            meant: tuple[Any, ...] = _NUMBERS.get(port.type.name, ()) if port.type is not None else ()
            if issubclass(kind, Loop) and name == 'queue':
                meant = (kind.queue.parse('1;0'), ())
            if meant:
                yield Compared(_keys(value), meant=meant)


def _fault(error: NodeExecutionError) -> Violation:
    cause = error.__cause__
    if not (isinstance(cause, BehaviorTreeError) and cause.is_absent):
        return Violation(Property.NO_FAULT, error.node_path, str(error))
    text = str(error)
    if isinstance(cause, PortError):
        what = f'{error.node_path} reads {{{cause.key}}} by its port {cause.port}'
        text = f'{what}, and there is nothing by that key: it was never written, or has been removed'
    return Violation(Property.DATA, error.node_path, text)
