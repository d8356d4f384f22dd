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
"""For each tree, before those that need more are begun again."""


# The environment of a behavior in a proof: the possible actions of its states, and the keys that its trees write.


def state_models(used: UsedTrees, reports: Mapping[TreeKey, Report], boards: Blackboards) -> StateModels:
    """Return what stands for the states of a behavior. Of one that runs a tree, what was found about the tree holds."""
    resources = tree_resources(used.library)
    uses = {use.path: use for use in used.uses}

    def model(definition: StateDefinition) -> StateModel:
        state = definition.state.unwrapped
        if isinstance(state, OperatorDecisionState):
            return StateModel(StateModelKind.DECISION, suggestion=state.suggestion)
        found = state_model(definition)
        if isinstance(state, OperatorInputState):  # it is the operator who declines
            return replace(found, canceled=frozenset())
        use = uses.get(definition.path)
        if use is None:
            return found
        report = None if use.key is None else reports.get(use.key)
        writes = {outcome: boards.writes(use, found, outcome, report) for outcome in state.outcomes}
        found = replace(found, reads=boards.reads(use), writes=writes)
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


# What the trees of a behavior hand to each other on blackboards, as the machine that runs them sees it.


@dataclass(frozen=True)
class Blackboards:
    """The keys that each tree needs before it begins, and their known writers."""

    needed: Mapping[TreeKey, frozenset[str]]

    @classmethod
    def of(cls, used: UsedTrees, given: Collection[str] = ()) -> Blackboards:
        """Return those of a behavior; its trees are given ``given`` from outside, and what their models name. Raises
        TreeLoadError."""
        library = used.library
        known = {*HOST_KEYS, *given}
        return cls(
            {
                key: TreeSystem(library, key, given=GOALS).needed - known - library.model(key.id).keys()
                for key in dict.fromkeys(use.key for use in used.uses if use.key is not None)
            }
        )

    @property
    def observed(self) -> frozenset[str]:
        """The keys that a tree needs and does not write itself."""
        return frozenset().union(*self.needed.values())

    def reads(self, use: TreeUse) -> frozenset[str]:
        """Return what has to be there when a state begins that uses the BT server, in words."""
        needed = self.needed[use.key] if use.key is not None else frozenset[str]()
        return _named(needed - use.use.writes.keys(), use)

    def writes(self, use: TreeUse, model: StateModel, outcome: str, report: Report | None) -> frozenset[str]:
        """Return what is there after an outcome of it, in words. Of a tree that is not known, or not proved, anything
        may be.

        One that has failed, or was canceled, may have been refused: then it has written nothing.
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
        """Return which writers are not known since trees are not proved; '' if there are none."""
        trees = ', '.join(key.id for key, report in reports.items() if not report.is_proof)
        if not trees or not self.observed:
            return ''
        keys = ', '.join(f'[{key}]' for key in sorted(self.observed))
        return (
            f'not known, and taken as written: {keys} after trees that were not followed to their end, or with which '
            f'something is wrong: {trees}'
        )


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
        """All of them, the machine last."""
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
    """Explore a behavior within the seconds of ``limits`` in all. What a tree does not use of its time, those after it
    may.

    ``required`` is what holds of its machine beside what holds for all, ``required_of_trees`` of trees, by their IDs.
    ``given`` are keys of blackboards that are there before. Of the trees, what is in ``cache`` is not explored again.

    Raises UnfitError when that is about what they do not have.
    """
    if problems := problems_with(required, machine_vocabulary(machine), name):
        raise UnfitError('\n'.join(problems))
    requirements = [one.requirement for one in required]
    end = time.process_time() + limits.seconds
    boards = Blackboards.of(used, given)
    trees: dict[TreeKey, Report] = {}
    ahead = list(dict.fromkeys(use.key for use in used.uses if use.key is not None))
    for most in (_FIRST_SECONDS, limits.seconds):  # most trees are small: what they do not need is for the others
        for number, key in enumerate(ahead):
            share = _SHARE_OF_TREES * (end - time.process_time()) / (len(ahead) - number)
            trees[key] = prove_tree(
                used.library,
                key,
                given=given,
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
    """Return what is wrong on a way that a proof has found, as a saved test has it. Nothing, when that way is closed.

    The way is one of the machine, or of the tree ``tree`` that it runs. ``name`` is that of an installed behavior, or
    the file of a machine; ``trees`` are files that it does not load itself, ``models`` such that describe node types.
    What its trees write is proved again, with up to so many ``configurations`` of each and no limit of time, so that
    what is found does not depend on how fast that goes.

    Raises UsageError when the behavior cannot be built, LookupError when it does not run this tree.
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
        return replay_in(used.library, key, moves, given=given, require=require)
    boards = Blackboards.of(used, given)
    reports = {}
    if boards.observed:  # what the trees have written is known of their proofs
        limits = ExplorationLimits(inf, configurations)
        observed, cache = boards.observed, ProofCache()
        reports = {
            key: prove_tree(
                used.library, key, given=given, limits=limits, faults=faults, observed=observed, cache=cache
            )
            for key in boards.needed
        }
    bounds = MachineBounds(Operator(operator), forces, faults, autonomy)
    required = [parse_requirement(text, 'require').requirement for text in require]
    states = state_models(used, reports, boards)
    return replay(lambda: MachineSystem(machine, states, bounds, required, reduces=False), moves_of(moves))


# Two versions of a behavior side by side: the trees that the same states run, and the machines.


class Version(NamedTuple):
    """One of both: its machine, and the trees that this runs."""

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
    """Compare the trees that the same states run, and the machines, within the seconds of ``limits`` in all.

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

    def share() -> ExplorationLimits:  # what one does not use of its time, those after it may
        left = max(end - time.process_time(), 0.0)
        return replace(limits, seconds=left / (len(pairs) + 1 - len(found)), whole=limits.seconds)

    for (earlier, key), path in reversed(pairs.items()):
        assert earlier is not None
        called = f'tree {key.id}' if earlier.id == key.id else f'tree {key.id} (before: {earlier.id}) of {path}'
        versions = ((before.used.library, earlier), (now.used.library, key))
        report = partial(on_progress, called)
        found.append(compare_trees(*versions, given=given, limits=share(), on_progress=report, name=called))

    def make(version: Version) -> MachineSystem:
        models = state_models(version.used, {}, Blackboards.of(version.used, given))
        return MachineSystem(version.machine, models, bounds, reduces=False)

    report = partial(on_progress, 'the machine')
    return [*found, Compared(f'machine of {name}', compare(lambda: make(before), lambda: make(now), share(), report))]
