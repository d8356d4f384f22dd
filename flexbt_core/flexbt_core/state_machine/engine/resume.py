# SPDX-License-Identifier: BSD-3-Clause
"""Resuming: the position of a run as plain data, starting another run at that position, and switching the machine of
a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeAlias, get_args, get_origin, get_type_hints

from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition, StateKind
from flexbt_core.state_machine.model.userdata import Scope, StateMachineError
from flexbt_core.values.text import short_repr

from .controls import STEPS, Step
from .events import MachineSwitched
from .leaf import LeafRun
from .region import ContainerRun, Region, RegionChild
from .run import MachineRun


@dataclass(frozen=True)
class RunPosition:
    """The position of a run. Paths are those of states and machines; the root is always active and not listed.

    ``active``: the active nodes, outermost first. Each active machine that is neither in ``wanted`` nor in ``leaving``
    has one active or coming child; a concurrency container has any number of them.
    ``coming``: nodes to enter from their beginning.
    ``wanted``: the outcome that an active node which is done waits to be left by. Such a machine has no active child,
    and such a state is not entered again.
    ``approved``: the nodes in ``wanted`` that the operator has approved.
    ``leaving``: the outcome of a node that was left and had not halted yet; '' for a repeated node.
    ``ended``: outcome of each child of an active concurrency container that has ended.
    ``userdata``: keys and values of the root and of each machine in ``active``. These are the values themselves, not
    copies: save them at once.
    ``levels``: autonomy of the root, and of each sub-tree whose level differs from its parent's.
    ``step``: the step that is under way, as text; '' for none.
    ``decisions``: the pending decisions, for display: id, kind, path, outcome, prompt. ``decision_count`` keeps
    the ids of later decisions different.
    """

    active: tuple[str, ...]
    coming: tuple[str, ...]
    wanted: Mapping[str, str]
    approved: tuple[str, ...]
    leaving: Mapping[str, str]
    ended: Mapping[str, str]
    userdata: Mapping[str, Mapping[str, Any]]
    levels: Mapping[str, int]
    locked: tuple[str, ...]
    breakpoints: tuple[str, ...]
    step: str
    is_paused: bool
    decisions: tuple[Mapping[str, str], ...]
    decision_count: int

    def to_plain(self) -> dict[str, Any]:
        """Return the position as dicts and lists; JSON can hold it if it can hold the userdata."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: _plain(value) for name, value in plain.items()}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> RunPosition:
        """Return the position that :meth:`to_plain` wrote.

        Raises:
            StateMachineError: ``plain`` is not a position; the text lists missing, unknown and wrongly typed fields.
        """
        kinds = get_type_hints(cls)
        if plain.keys() != kinds.keys():
            wrong = ', '.join(sorted(map(str, plain.keys() ^ kinds.keys())))
            raise StateMachineError(f'this is not a position of a run: missing or left over: {wrong}')
        for name, value in plain.items():
            if not _is_of(value, kinds[name]) or (name == 'decision_count' and value < 0):
                raise StateMachineError(f'this is not a position of a run: {name} cannot be {short_repr(value)}')
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()
        }
        return cls(**values)


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [dict(one) if isinstance(one, Mapping) else one for one in value]
    return dict(value) if isinstance(value, Mapping) else value


def _is_of(value: Any, kind: Any) -> bool:
    """Return whether plain data has the type of a field: a text, a number, or a list or mapping of these."""
    of = get_args(kind)
    if get_origin(kind) is tuple:
        return isinstance(value, list | tuple) and all(_is_of(one, of[0]) for one in value)
    if get_origin(kind) is Mapping:
        return isinstance(value, Mapping) and all(_is_of(one, of[0]) and _is_of(value[one], of[1]) for one in value)
    return kind is Any or (isinstance(value, kind) and isinstance(value, bool) is (kind is bool))


# Read the position of a run, and continue there in another one.

_Writers: TypeAlias = Mapping[str, Mapping[str, tuple[str, float]]]

_NONE_STAYS: Final[Mapping[str, LeafRun]] = {}
_UNKNOWN: Final[_Writers] = {}


def position_of(run: MachineRun) -> RunPosition:
    """Return the position of a run, for :func:`start_at`. Call it on the run's thread, also while an event is read."""
    root, controls = run.root, run.controls
    active: list[str] = []
    coming: list[str] = []
    approved: list[str] = []
    wanted: dict[str, str] = {}
    leaving: dict[str, str] = {}
    ended: dict[str, str] = {}
    userdata: dict[str, dict[str, Any]] = {}

    def take(machine: ContainerRun) -> None:
        userdata[machine.path] = machine.scope.values()
        outcome = machine.outcome or machine.ending
        if outcome is not None:
            wanted[machine.path] = outcome
        if machine.ending is not None:
            return  # its children have been left
        if machine.definition.kind is StateKind.CONCURRENCY:
            ended.update((machine.children[label].path, outcome) for label, outcome in machine.ended.items())
        for region in machine.regions:
            if region.child is not None:
                take_child(region, region.child)
            elif region.coming is not None:
                (active if region.is_resumed else coming).append(region.coming.path)

    def take_child(region: Region, child: RegionChild) -> None:
        active.append(child.path)
        if region.is_leaving:
            leaving[child.path] = child.outcome or ''
            return
        if region.is_approved:
            approved.append(child.path)
        if isinstance(child, ContainerRun):
            take(child)
        elif child.outcome is not None:
            wanted[child.path] = child.outcome

    take(root)
    return RunPosition(
        active=tuple(active),
        coming=tuple(coming),
        wanted=wanted,
        approved=tuple(approved),
        leaving=leaving,
        ended=ended,
        userdata=userdata,
        levels=controls.levels(),
        locked=tuple(sorted(controls.locked)),
        breakpoints=tuple(sorted(controls.breakpoints)),
        step=str(controls.step or ''),
        is_paused=run.is_paused,
        decisions=tuple(
            {'id': one.id, 'kind': one.kind.name, 'path': one.path, 'outcome': one.outcome, 'prompt': one.prompt}
            for one in run.decisions
        ),
        decision_count=run.decision_count,
    )


def reasons_against(definition: MachineDefinition, position: RunPosition) -> list[str]:
    """Return the reasons why a machine cannot be at a position; empty if it can."""
    nodes = {node.path: node for node in definition.nodes()}
    return [*_unknown(nodes, position), *_impossible(definition, position)]


def _unknown(nodes: Mapping[str, StateDefinition | MachineDefinition], position: RunPosition) -> Iterator[str]:
    for path in (*position.active, *position.coming, *position.ended, *position.locked, *position.breakpoints):
        if path not in nodes:
            yield f'the machine has no state {path!r}'
    for path, outcome in (*position.wanted.items(), *position.leaving.items(), *position.ended.items()):
        if path in nodes and outcome and outcome not in nodes[path].outcomes:
            yield f'{path} has no outcome {outcome!r}'
    for path, level in position.levels.items():
        if path not in nodes or level not in AUTONOMY_NAMES:
            yield f'there is no level {level} of {path!r}'
    if position.step and position.step.partition(' ')[0] not in STEPS:
        yield f'there is no step {position.step!r}'


def _impossible(machine: MachineDefinition, position: RunPosition) -> Iterator[str]:
    """Yield the contradictions of the position in an active machine."""
    here = {*position.active, *position.coming}
    children = [child for child in machine.children.values() if child.path in here]
    is_done = machine.path in position.wanted and not children
    if machine.kind is not StateKind.CONCURRENCY and len(children) != 1 and not is_done:
        found = ', '.join(child.path for child in children) or 'none'
        yield f'one state of {machine.path} has to be active, not {found}'
    elif machine.path not in position.userdata:
        yield f'the userdata of {machine.path} is missing'
    over = [child for child in machine.children.values() if child.path in position.ended]
    ends = machine.outcome_of({child.label: position.ended[child.path] for child in over})
    if ends is not None and machine.path not in position.wanted:
        yield f'{machine.path} would be over, by {ends!r}, with the children that have ended; let it end first'
    for child in children:
        if isinstance(child, MachineDefinition) and child.path in position.active:
            if child.path not in position.leaving:
                yield from _impossible(child, position)
        elif any(path.startswith(f'{child.path}/') for path in here):
            yield f'{child.path} cannot have anything active in it'


def start_at(run: MachineRun, position: RunPosition) -> None:
    """Start a run at the position of another one.

    Its states are entered again with ``is_resumed`` set, one per step. The operator's settings are restored.

    Raises:
        StateMachineError: the run was started before, or the machine cannot be at that position; with the reasons.
        StateError: a state is part of another run that has not ended.
    """
    if reasons := reasons_against(run.definition, position):
        raise StateMachineError(f'the run cannot continue there: {"; ".join(reasons)}')

    def enter() -> None:
        run.pausing.is_paused = position.is_paused
        run.decision_count = position.decision_count
        run.controls.restore(position.levels, position.locked, position.breakpoints, Step.of(position.step))
        restore(run, position)

    run.start(enter)


def restore(
    run: MachineRun, position: RunPosition, staying: Mapping[str, LeafRun] = _NONE_STAYS, writers: _Writers = _UNKNOWN
) -> None:
    """Put the machine of a run, with no state entered yet, at a position.

    Later steps enter its states, except those in ``staying``, by path, which stay active. ``writers`` are those of the
    userdata, as in :meth:`MachineRun.writers_of_machines`.
    """
    _Restoring(position, staying, writers).machine(run.root, run.scope)


class _Restoring:
    def __init__(self, position: RunPosition, staying: Mapping[str, LeafRun], writers: _Writers) -> None:
        self._position = position
        self._staying = staying
        self._writers = writers

    def machine(self, machine: ContainerRun, scope: Scope) -> None:
        position = self._position
        scope.restore(position.userdata[machine.path])
        scope.writers.update(self._writers.get(machine.path, {}))
        machine.activate(scope)
        machine.outcome = position.wanted.get(machine.path)
        is_concurrent = machine.definition.kind is StateKind.CONCURRENCY
        for number, (label, child) in enumerate(machine.children.items()):
            region = machine.regions[number if is_concurrent else 0]
            if child.path in position.active:
                self._child(machine, region, child)
            elif child.path in position.ended and is_concurrent:
                machine.ended[label] = position.ended[child.path]
            elif child.path in position.coming or (is_concurrent and machine.outcome is None):
                region.await_entry(child)

    def _child(self, machine: ContainerRun, region: Region, child: LeafRun | ContainerRun) -> None:
        position = self._position
        outcome = position.wanted.get(child.path)
        left_by = position.leaving.get(child.path)
        if left_by is not None:
            region.child, child.outcome = child, left_by or None
            region.is_leaving = True
            if isinstance(child, ContainerRun):
                child.take_priority()
        elif isinstance(child, ContainerRun):
            region.child = child
            self.machine(child, child.new_scope(machine.scope, position.userdata[child.path]))
        elif child.path in self._staying:
            region.child = self._stay(machine, child)
        elif outcome is not None:
            region.child = child
            child.restore(machine.scope, outcome)
        else:
            region.await_entry(child, is_resumed=True)
        region.is_approved = child.path in position.approved

    def _stay(self, machine: ContainerRun, replaced: LeafRun) -> LeafRun:
        leaf = self._staying[replaced.path]
        leaf.stay(replaced.definition)
        leaf.move(machine.scope)
        machine.children[leaf.definition.label] = leaf
        return leaf


# Continue with another machine while states stay active.
#
# FlexBE locks the one active state, stops the run, and begins another run with that state in it. Here the switch is one
# step of the run, in which nothing else can happen. So it needs no lock, any number of states stays active, and none
# of their callbacks is called. If the switch is refused, the run continues as before.


def switch_machine(run: MachineRun, definition: MachineDefinition) -> str | None:
    """Continue with another machine, which has the active states at the same paths: a command, as in
    :mod:`operator_commands`.

    The active states are not left and entered again: the state objects stay, with their userdata, until they are left.
    A refusal names each state that cannot stay. on_start is called for the new states, on_stop for the old ones that
    do not stay. Pending decisions are asked again, since their outcomes may lead elsewhere now.
    """
    old, root, position = run.root, ContainerRun(run, definition), position_of(run)
    known = {node.path for node in definition.nodes()}
    target = _without_what_is_gone(position, known)
    staying = {leaf.path: leaf for leaf in run.active_states()}
    leaves = list(root.leaves())
    reasons = [
        *_in_between(old),
        *reasons_against(definition, target),
        *_changes(definition, old.definition, position),
        *_missing_inputs(definition, position),
        *(f'{leaf.path}: its state is part of a run already' for leaf in leaves if leaf.state.bound_to is not None),
    ]
    if not reasons:
        for leaf in leaves:
            leaf.bind()
        reasons = _raising(leaves)
    if reasons:
        return f'the run cannot continue with that machine: {"; ".join(reasons)}'
    writers = run.writers_of_machines()
    run.go_on_with(root)
    for leaf in old.leaves():
        if leaf.path not in staying:
            leaf.stop()
    restore(run, replace(target, approved=()), staying, writers)
    run.tell(MachineSwitched(definition))
    return None


def _raising(leaves: Sequence[LeafRun]) -> list[str]:
    """Call on_start of the states of the other machine; if one raises, stop all of them and return the reason."""
    raised = [leaf.path for leaf in leaves if leaf.start()]
    if raised:
        for leaf in leaves:
            leaf.stop()
    return [f'{", ".join(raised)} raised in on_start'] if raised else []


def _in_between(old: ContainerRun) -> Iterator[str]:
    """Yield the nodes that are being left and have not halted."""
    for region in old.active_regions():
        if region.child is not None and (region.is_leaving or region.container.is_ending):
            yield f'{region.child.path} is being left; try again when it has halted'


def _without_what_is_gone(position: RunPosition, known: set[str]) -> RunPosition:
    """Return the position without the locks, breakpoints, levels and ended children that the other machine lacks."""
    return replace(
        position,
        locked=tuple(path for path in position.locked if path in known),
        breakpoints=tuple(path for path in position.breakpoints if path in known),
        levels={path: level for path, level in position.levels.items() if path in known},
        ended={path: outcome for path, outcome in position.ended.items() if path in known},
    )


def _changes(new: MachineDefinition, old: MachineDefinition, position: RunPosition) -> Iterator[str]:
    """Yield the active nodes that are of another kind in the other machine."""
    others = {node.path: node for node in new.nodes()}
    for node in old.nodes():
        other = others.get(node.path)
        if other is None or (node.path not in position.active and node is not old):
            continue
        if isinstance(node, StateDefinition) and isinstance(other, StateDefinition):
            yield from _changes_of_state(node, other)
        elif isinstance(node, StateDefinition) or isinstance(other, StateDefinition) or node.kind is not other.kind:
            yield f'{node.path} is active, and would be {_kind(other)} instead of {_kind(node)}'


def _changes_of_state(old: StateDefinition, new: StateDefinition) -> Iterator[str]:
    kinds = (type(node.state.unwrapped) for node in (old, new))
    one, other = (f'{kind.__module__}.{kind.__qualname__}' for kind in kinds)
    if one != other:
        yield f'{old.path} is active, and would be of class {other} instead of {one}'
        return
    for what in ('outcomes', 'input_keys', 'output_keys'):
        before, after = set(getattr(old.state, what)), set(getattr(new.state, what))
        if before != after:
            changed = ', '.join(sorted(before ^ after))
            yield f'{old.path} is active, and would have other {what.replace("_", " ")} ({changed})'


def _missing_inputs(new: MachineDefinition, position: RunPosition) -> Iterator[str]:
    for key in new.read_inputs:
        if key not in new.defaults and key not in position.userdata[new.path]:
            yield f"nobody has given the input '{key}'"


def _kind(node: StateDefinition | MachineDefinition) -> str:
    return 'a state' if isinstance(node, StateDefinition) else f'a container of kind {node.kind.name}'
