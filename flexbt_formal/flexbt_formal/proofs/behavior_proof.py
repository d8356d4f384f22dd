# SPDX-License-Identifier: BSD-3-Clause
"""Proofs of behaviors with their trees, and comparisons of two versions of a behavior."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.definition import TreeKey
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.monitors.properties import Violation
from flexbt_core.monitors.requirement_text import (
    StatedRequirement,
    machine_vocabulary,
    parse_requirement,
    problems_with,
)
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_formal.exploration.comparison import compare
from flexbt_formal.exploration.explorer import (
    DEFAULT_CONFIGURATIONS,
    ExplorationLimits,
    explore,
    replay,
    unreported,
)
from flexbt_formal.exploration.machine_system import MachineBounds, MachineSystem, Operator
from flexbt_formal.exploration.model import Report
from flexbt_formal.exploration.state_models import StateModel, StateModelKind, StateModels, state_model
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_server.node_types import node_registry
from flexbt_states import OperatorDecisionState, OperatorInputState
from flexbt_tools.behaviors.built_behavior import TreeUse, UsedTrees, behavior_entry, build, used_trees
from flexbt_tools.errors import UnfitError, UsageError
from flexbt_tools.tree_checks.check import HOST_KEYS
from flexbt_tools.tree_checks.resources import tree_resources
from flexbt_tools.trees.files import read_models
from flexbt_tools.trees.stand_ins import OpenRegistry

from .proof_cache import ProofCache
from .proof_report import Compared, moves_of
from .tree_proof import GOALS, compare_trees, prove_tree, replay_in, requirements_text

_SHARE_OF_TREES: Final = 0.8
"""Share of the remaining time for all remaining trees."""
_FIRST_SECONDS: Final = 2.0
"""Time limit for each tree in the first pass; a second pass restarts the unfinished ones."""


# The environment of a behavior in a proof: the possible actions of its states, and the keys that its trees write.


def state_models(used: UsedTrees, reports: Mapping[TreeKey, Report], boards: Blackboards) -> StateModels:
    """Return the models of the states of a behavior. A state that runs a tree uses the report of that tree."""
    resources = tree_resources(used.library)
    uses = {use.path: use for use in used.uses}

    def model(definition: StateDefinition) -> StateModel:
        state = definition.state.unwrapped
        if isinstance(state, OperatorDecisionState):
            return StateModel(StateModelKind.DECISION, suggestion=state.suggestion)
        found = state_model(definition)
        if isinstance(state, OperatorInputState):  # the operator causes this outcome
            return replace(found, canceled=frozenset())
        use = uses.get(definition.path)
        if use is None:
            return found
        report = None if use.key is None else reports.get(use.key)
        writes = {outcome: boards.writes(use, found, outcome, report) for outcome in state.outcomes}
        found = replace(found, reads=boards.reads(use), writes=writes, removes=boards.removes(use))
        if use.key is None:
            return found
        found = replace(found, resources=frozenset(resources[use.key]), server='BT server')
        if report is None or not report.is_proof:
            return found
        outcomes = state.outcomes
        if 'SUCCESS' not in report.ends:
            outcomes = tuple(one for one in outcomes if one != 'done')
        return replace(found, outcomes=outcomes, outputs=writes.get('done', frozenset()))

    return model


# The blackboard keys that the trees of a behavior pass to each other, as the machine sees them.


@dataclass(frozen=True)
class Blackboards:
    """The keys that each tree needs before it begins and their known writers, and the keys that each may remove; None:
    any."""

    needed: Mapping[TreeKey, frozenset[str]]
    removed: Mapping[TreeKey, frozenset[str] | None]

    @classmethod
    def of(cls, used: UsedTrees, given: Collection[str] = ()) -> Blackboards:
        """Return the keys of a behavior. The keys ``given``, and those that the tree models mention, exist before a
        tree begins. Raises TreeLoadError."""
        library = used.library
        known = {*HOST_KEYS, *given}
        keys = dict.fromkeys(use.key for use in used.uses if use.key is not None)
        systems = {key: TreeSystem(library, key, given=(*GOALS, *_written_before(used, key))) for key in keys}
        return cls(
            {key: system.needed - known - library.model(key).keys() for key, system in systems.items()},
            {key: system.removed for key, system in systems.items()},
        )

    @property
    def observed(self) -> frozenset[str]:
        """Keys that some tree needs and does not write itself."""
        return frozenset().union(*self.needed.values())

    def reads(self, use: TreeUse) -> frozenset[str]:
        """Return the keys that must exist when a state begins that uses the BT server, in words."""
        needed = self.needed[use.key] if use.key is not None else frozenset[str]()
        return _named(needed - use.use.writes.keys(), use)

    def removes(self, use: TreeUse) -> frozenset[str]:
        """Return the keys that may not exist any more after a use, in words. An unknown tree counts as removing
        nothing."""
        removed = self.removed[use.key] if use.key is not None else frozenset[str]()
        return _named(self.observed if removed is None else self.observed & removed, use)

    def writes(self, use: TreeUse, model: StateModel, outcome: str, report: Report | None) -> frozenset[str]:
        """Return the keys that exist after an outcome of a use, in words. An unknown or unproved tree may have
        written any key.

        A failed or canceled tree counts as writing nothing, because the server may have refused it.
        """
        if use.runs_unknown:
            return _named(self.observed, use)
        if outcome in model.not_written:
            return frozenset()
        if report is not None and not report.is_proof:
            return _named(self.observed, use)
        by_tree = report.written.get('SUCCESS', frozenset()) if report is not None and outcome == 'done' else ()
        return _named(self.observed.intersection((*use.use.writes, *by_tree)), use)

    def note(self, reports: Mapping[TreeKey, Report]) -> str:
        """Return a note on writers that are unknown because their trees are not proved; '' without any."""
        trees = ', '.join(key.id for key, report in reports.items() if not report.is_proof)
        if not trees or not self.observed:
            return ''
        keys = ', '.join(f'[{key}]' for key in sorted(self.observed))
        return (
            f'not known, and taken as written: {keys} after trees that were not followed to their end, or with which '
            f'something is wrong: {trees}'
        )


def _written_before(used: UsedTrees, key: TreeKey) -> list[str]:
    """Return the keys that some state writes before it runs a tree."""
    return sorted({name for use in used.uses if use.key == key for name in use.use.writes})


def _named(keys: frozenset[str], use: TreeUse) -> frozenset[str]:
    board = f'of the blackboard {use.use.blackboard!r}' if use.use.blackboard else 'of the shared blackboard'
    return frozenset(f'[{key}] {board}' for key in keys)


# The proof.


@dataclass(frozen=True)
class BehaviorProof:
    """The results for the trees of a behavior, and for its machine."""

    name: str
    trees: dict[TreeKey, Report]
    machine: Report

    @property
    def reports(self) -> list[Report]:
        """All reports, that of the machine last."""
        return [*self.trees.values(), self.machine]


def prove_behavior(
    name: str,
    machine: MachineDefinition,
    used: UsedTrees,
    bounds: MachineBounds,
    limits: ExplorationLimits,
    *,
    required: Sequence[StatedRequirement] = (),
    required_of_trees: Mapping[str, Sequence[StatedRequirement]] = MappingProxyType({}),
    given: Collection[str] = (),
    on_progress: Callable[[str, int, int], None] = unreported,
    cache: ProofCache | None = None,
) -> BehaviorProof:
    """Explore a behavior and its trees, within the seconds of ``limits`` in total. Time that a tree does not use is
    available to the later ones.

    ``required`` are additional requirements of the machine, ``required_of_trees`` of trees, by ID. ``given`` are
    blackboard keys that exist from the start. Trees whose proof is in ``cache`` are not explored again.

    Raises UnfitError if a requirement refers to unknown names.
    """
    if problems := problems_with(required, machine_vocabulary(machine), name):
        raise UnfitError('\n'.join(problems))
    requirements = [one.requirement for one in required]
    limits = replace(limits, whole=limits.seconds)
    end = time.process_time() + limits.seconds
    boards = Blackboards.of(used, given)
    trees: dict[TreeKey, Report] = {}
    ahead = list(dict.fromkeys(use.key for use in used.uses if use.key is not None))
    for most in (_FIRST_SECONDS, limits.seconds):  # most trees are small and leave their time to the others
        for number, key in enumerate(ahead):
            share = _SHARE_OF_TREES * (end - time.process_time()) / (len(ahead) - number)
            trees[key] = prove_tree(
                used.library,
                key,
                given=[*given, *_written_before(used, key)],
                limits=replace(limits, seconds=min(most, share)),
                faults=bounds.faults,
                required=required_of_trees.get(key.id, ()),
                observed=boards.observed,
                on_progress=partial(on_progress, f'tree {key.id}'),
                cache=cache,
            )
        ahead = [key for key, report in trees.items() if report.stopped_by]
    models = state_models(used, trees, boards)
    without = ', '.join(use.path for use in used.uses if use.runs_unknown)
    unknown = f'; of the trees that these run nothing is known, any outcome is taken as possible: {without}'
    report = explore(
        lambda: MachineSystem(machine, models, bounds, requirements),
        f'machine of {name}',
        f'{bounds}{unknown if without else ""}{requirements_text(required)}',
        replace(limits, seconds=max(0.0, end - time.process_time())),
        partial(on_progress, 'the machine'),
        faults=bounds.faults,
    )
    note = boards.note(trees)
    return BehaviorProof(name, trees, replace(report, notes=(*report.notes, note)) if note else report)


def replay_behavior(
    name: str,
    moves: Iterable[Sequence[Any]],
    *,
    tree: str = '',
    parameters: Sequence[tuple[str, str]] = (),
    operator: str = Operator.ANSWERS.value,
    forces: int = 0,
    faults: int = 1,
    autonomy: int = 1,
    require: Sequence[str] = (),
    given: Sequence[str] = (),
    configurations: int = DEFAULT_CONFIGURATIONS,
    trees: Sequence[str] = (),
    models: Sequence[str] = (),
    nav2_branch: Nav2Branch = NAV2_BRANCHES[0],
) -> list[Violation]:
    """Replay a path of a saved test, and return its violations; none if the path is not possible any more.

    The path is one of the machine, or of the tree ``tree`` that it runs. ``name`` is that of an installed behavior, or
    the file of a machine. ``trees`` are tree files that it does not load itself, ``models`` files that describe node
    types. The writes of its trees are proved again, with up to this many ``configurations`` each and no time limit, so
    that the result does not depend on the speed of the computer.

    Raises UsageError if the behavior cannot be built, LookupError if it does not run this tree.
    """
    behavior = build(behavior_entry(name), parameters)
    machine = behavior.machine
    if machine is None:
        raise UsageError('\n'.join(behavior.problems))
    registry = node_registry(lambda source, error: None, nav2_branch)
    read_models(models, registry)
    used = used_trees(machine, trees, OpenRegistry(registry))
    if tree:
        key = next((use.key for use in used.uses if use.key is not None and use.key.id == tree), None)
        if key is None:
            raise LookupError(f'{name} does not run a tree {tree!r}')
        return replay_in(used.library, key, moves, given=[*given, *_written_before(used, key)], require=require)
    boards = Blackboards.of(used, given)
    reports = {}
    if boards.observed:  # only the proofs of the trees know which keys they write
        limits = ExplorationLimits(inf, configurations)
        observed, cache = boards.observed, ProofCache()
        reports = {
            key: prove_tree(
                used.library,
                key,
                given=[*given, *_written_before(used, key)],
                limits=limits,
                faults=faults,
                observed=observed,
                cache=cache,
            )
            for key in boards.needed
        }
    bounds = MachineBounds(Operator(operator), forces, faults, autonomy)
    required = [parse_requirement(text, 'require').requirement for text in require]
    states = state_models(used, reports, boards)
    return replay(lambda: MachineSystem(machine, states, bounds, required, reduces=False), moves_of(moves))


# Two versions of a behavior side by side: the trees that the same states run, and the machines.


class Version(NamedTuple):
    """One of the two versions: its machine, and the trees that the machine runs."""

    machine: MachineDefinition
    used: UsedTrees


def compare_behaviors(
    name: str,
    before: Version,
    now: Version,
    bounds: MachineBounds,
    limits: ExplorationLimits,
    *,
    given: Collection[str] = (),
    on_progress: Callable[[str, int, int], None] = unreported,
) -> list[Compared]:
    """Compare the trees that the same states run, and the machines, within the seconds of ``limits`` in total.

    Raises TreeLoadError and RefusedError as compare_trees does.
    """
    old = {use.path: use.key for use in before.used.uses}
    pairs = {
        (old[use.path], use.key): use.path
        for use in reversed(now.used.uses)
        if use.key is not None and old.get(use.path) is not None
    }
    end = time.process_time() + limits.seconds
    found: list[Compared] = []

    def share() -> ExplorationLimits:  # later comparisons use the time that is left
        left = max(end - time.process_time(), 0.0)
        return replace(limits, seconds=left / (len(pairs) + 1 - len(found)), whole=limits.seconds)

    for (earlier, key), path in reversed(pairs.items()):
        assert earlier is not None
        called = f'tree {key.id}' if earlier.id == key.id else f'tree {key.id} (before: {earlier.id}) of {path}'
        versions = ((before.used.library, earlier), (now.used.library, key))
        report = partial(on_progress, called)
        written = _written_before(before.used, earlier) + _written_before(now.used, key)
        found.append(
            compare_trees(*versions, given=[*given, *written], limits=share(), on_progress=report, name=called)
        )

    def make(version: Version) -> MachineSystem:
        models = state_models(version.used, {}, Blackboards.of(version.used, given))
        return MachineSystem(version.machine, models, bounds, reduces=False)

    report = partial(on_progress, 'the machine')
    return [*found, Compared(f'machine of {name}', compare(lambda: make(before), lambda: make(now), share(), report))]
