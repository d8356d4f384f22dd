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
from flexbt_core.state_machine.model.definition import MachineDefinition
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
from flexbt_server.node_types import node_registry
from flexbt_tools.behaviors.built_behavior import UsedTrees, behavior_entry, build, used_trees
from flexbt_tools.errors import UnfitError, UsageError
from flexbt_tools.trees.files import read_models
from flexbt_tools.trees.stand_ins import OpenRegistry

from .behavior_environment import Blackboards, state_models
from .proof_cache import ProofCache
from .proof_report import Compared, moves_of
from .tree_proof import compare_trees, prove_tree, replay_in, requirements_text

_SHARE_OF_TREES: Final = 0.8
"""Share of the remaining time for all remaining trees."""
_FIRST_SECONDS: Final = 2.0
"""For each tree, before those that need more are begun again."""


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
    *,
    seconds: float,
    configurations: int,
    required: Sequence[StatedRequirement] = (),
    required_of_trees: Mapping[str, Sequence[StatedRequirement]] = MappingProxyType({}),
    given: Collection[str] = (),
    on_progress: Callable[[str, int, int], None] = unreported,
    cache: ProofCache | None = None,
) -> BehaviorProof:
    """Explore a behavior within ``seconds`` of processor time in all. What a tree does not use of its time, those after
    it may.

    ``required`` is what holds of its machine beside what holds for all, ``required_of_trees`` of trees, by their IDs.
    ``given`` are keys of blackboards that are there before. Of the trees, what is in ``cache`` is not explored again.

    Raises UnfitError when that is about what they do not have.
    """
    if problems := problems_with(required, machine_vocabulary(machine), name):
        raise UnfitError('\n'.join(problems))
    requirements = [one.requirement for one in required]
    end = time.process_time() + seconds
    boards = Blackboards.of(used, given)
    trees: dict[TreeKey, Report] = {}
    ahead = list(dict.fromkeys(use.key for use in used.uses if use.key is not None))
    for most in (_FIRST_SECONDS, seconds):  # most trees are small: what they do not need is for the others
        for number, key in enumerate(ahead):
            share = _SHARE_OF_TREES * (end - time.process_time()) / (len(ahead) - number)
            limits = ExplorationLimits(min(most, share), configurations)
            trees[key] = prove_tree(
                used.library,
                key,
                given=given,
                limits=limits,
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
        ExplorationLimits(max(0.0, end - time.process_time()), configurations),
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
    *,
    seconds: float,
    configurations: int,
    given: Collection[str] = (),
    on_progress: Callable[[str, int, int], None] = unreported,
) -> list[Compared]:
    """Compare the trees that the same states run, and the machines, within ``seconds`` of processor time in all.

    Raises TreeLoadError and RefusedError as compare_trees does.
    """
    old = {use.path: use.key for use in before.used.uses}
    pairs = {
        (old[use.path], use.key): use.path
        for use in reversed(now.used.uses)
        if use.key is not None and old.get(use.path) is not None
    }
    end = time.process_time() + seconds
    found: list[Compared] = []

    def limits() -> ExplorationLimits:  # what one does not use of its time, those after it may
        left = max(end - time.process_time(), 0.0)
        return ExplorationLimits(left / (len(pairs) + 1 - len(found)), configurations, seconds)

    for (earlier, key), path in reversed(pairs.items()):
        assert earlier is not None
        called = f'tree {key.id}' if earlier.id == key.id else f'tree {key.id} (before: {earlier.id}) of {path}'
        versions = ((before.used.library, earlier), (now.used.library, key))
        report = partial(on_progress, called)
        found.append(compare_trees(*versions, given=given, limits=limits(), on_progress=report, name=called))

    def make(version: Version) -> MachineSystem:
        models = state_models(version.used, {}, Blackboards.of(version.used, given))
        return MachineSystem(version.machine, models, bounds, reduces=False)

    report = partial(on_progress, 'the machine')
    return [*found, Compared(f'machine of {name}', compare(lambda: make(before), lambda: make(now), limits(), report))]
