# SPDX-License-Identifier: BSD-3-Clause
"""Proofs of single trees, with every possible behavior of their leaves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.behavior_tree.model.ports import PortDirection
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.monitors.properties import Violation
from flexbt_core.monitors.requirement_text import StatedRequirement, parse_requirement, problems_with
from flexbt_formal.exploration.comparison import compare
from flexbt_formal.exploration.explorer import ExplorationLimits, OnProgress, explore, replay, unreported
from flexbt_formal.exploration.model import Report, servers_gone
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_server.node_types import node_registry
from flexbt_tools.errors import RefusedError, UnfitError
from flexbt_tools.trees.files import read_library, read_models, references
from flexbt_tools.trees.stand_ins import OpenRegistry, is_stand_in

from .proof_cache import NOTE, ProofCache, digest_of
from .proof_report import Compared, moves_of

GOALS: Final = ('goal', 'goals')
"""Keys that the runner of a tree writes before its start, as Nav2 navigators do."""
TREE_BOUNDS: Final = (
    'any result of each leaf at once, when a timer is due or just before, cancels confirmed soon or late, '
    'a stop at any time'
)


def prove_tree(
    library: TreeLibrary,
    key: TreeKey,
    *,
    given: Iterable[str] = (),
    limits: ExplorationLimits | None = None,
    faults: int = 1,
    required: Sequence[StatedRequirement] = (),
    observed: Iterable[str] = (),
    on_progress: OnProgress = unreported,
    cache: ProofCache | None = None,
) -> Report:
    """Explore a tree. ``given`` are keys that are on the blackboard before it begins. ``faults`` is the number of its
    servers that may fail permanently. ``required`` are additional requirements. ``observed`` are keys for which the
    report shows the outcomes that always write them. A proof in ``cache`` is reused.

    A leaf whose type is not installed may return any result, and the report notes this.

    Raises:
        TreeLoadError: the tree cannot be built.
        RefusedError: it has a control node or decorator whose type is not installed, so its behavior is unknown.
        UnfitError: a requirement refers to names that the tree does not have.
    """
    keys = _given(library, key, given)
    unknown = _unknown_leaves(library, key)

    def make() -> TreeSystem:
        return TreeSystem(library, key, given=keys, requirements=requirements, observed=looked_at)

    looked_at = sorted(observed)
    requirements = [one.requirement for one in required]
    first = make()
    if problems := problems_with(required, first.vocabulary, f'tree {key.id}'):
        raise UnfitError('\n'.join(problems))
    taken = first.given
    bounds = TREE_BOUNDS + (f', {servers_gone(faults)}' if faults else '')
    bounds += f'; given before it begins: {", ".join(taken)}' if taken else ''
    bounds += requirements_text(required)
    digest = (
        '' if cache is None else digest_of(library, key, [*keys, str(faults), str(looked_at), *map(str, requirements)])
    )
    known = None if cache is None else cache.get(digest, make)
    report = known or explore(make, f'tree {key.id}', bounds, limits, on_progress, faults=faults)
    if cache is not None and known is None and report.is_complete:
        cache.put(digest, report)
    notes = [] if known is None else [NOTE]
    if unknown:
        notes.append(
            f'not installed here, so any result is possible, and actuators are not known: {", ".join(unknown)}'
        )
    return replace(report, notes=(*report.notes, *notes))


def _given(library: TreeLibrary, key: TreeKey, given: Iterable[str]) -> tuple[str, ...]:
    """Return the keys that are on the blackboard before a tree begins: also those that its model declares as inputs."""
    ports = library.model(key).items()
    return (*GOALS, *given, *(name for name, port in ports if port.direction is not PortDirection.OUTPUT))


def compare_trees(
    before: tuple[TreeLibrary, TreeKey],
    now: tuple[TreeLibrary, TreeKey],
    *,
    given: Iterable[str] = (),
    limits: ExplorationLimits | None = None,
    on_progress: OnProgress = unreported,
    name: str = '',
) -> Compared:
    """Explore two versions of a tree side by side, as :func:`prove_tree` explores one. ``name`` is their name in the
    result. Raises TreeLoadError and RefusedError as that does.
    """
    keys: set[str] = set()
    for library, key in (before, now):
        _unknown_leaves(library, key)
        keys.update(_given(library, key, given))
        keys.update(TreeSystem(library, key, given=keys).given)  # external inputs of one version exist for both

    def make(version: tuple[TreeLibrary, TreeKey], other: tuple[TreeLibrary, TreeKey]) -> TreeSystem:
        return TreeSystem(*version, given=keys, beside=other[0])  # both get the same values

    found = compare(lambda: make(before, now), lambda: make(now, before), limits, on_progress)
    return Compared(name or f'tree {now[1].id}', found)


def requirements_text(required: Sequence[StatedRequirement]) -> str:
    """Return requirements in words, as a part of the bounds of a report."""
    return f'; required: {"; ".join(str(one.requirement) for one in required)}' if required else ''


def _unknown_leaves(library: TreeLibrary, key: TreeKey) -> list[str]:
    """Return the types of the leaves that are not installed. Raises RefusedError for controls and decorators that are
    not."""
    leaves: set[str] = set()
    errors: list[LoadError] = []
    seen, ahead = {key}, [key]
    while ahead:
        tree = ahead.pop()
        definition = library.definition(tree)
        for node in definition.nodes():
            if not is_stand_in(node.manifest):
                continue
            if node.manifest.kind in (NodeKind.ACTION, NodeKind.CONDITION):
                leaves.add(node.manifest.id)
            else:
                kind = node.manifest.kind.value.lower()
                errors.append(
                    definition.error(node, f'this {kind} is not installed here, so no tree with it is proved')
                )
        new = {target for _, target in references(library, tree)} - seen
        seen |= new
        ahead += new
    if errors:
        raise RefusedError(dict.fromkeys(errors))
    return sorted(leaves)


def replay_tree(
    files: Sequence[str],
    tree: str,
    moves: Iterable[Sequence[Any]],
    *,
    given: Iterable[str] = (),
    require: Sequence[str] = (),
    models: Sequence[str] = (),
    nav2_branch: Nav2Branch = NAV2_BRANCHES[0],
) -> list[Violation]:
    """Replay a path of a saved test, and return its violations; none if the path is not possible any more.

    ``models`` are files that describe node types. Raises RefusedError or LookupError if a file or the tree does not
    exist.
    """
    registry = node_registry(lambda source, error: None, nav2_branch)
    read_models(models, registry)
    library = read_library(files, OpenRegistry(registry))
    key = library.find(tree)
    if key is None:
        raise LookupError(f'there is no tree {tree!r} in {", ".join(files)}')
    return replay_in(library, key, moves, given=given, require=require)


def replay_in(
    library: TreeLibrary,
    key: TreeKey,
    moves: Iterable[Sequence[Any]],
    *,
    given: Iterable[str] = (),
    require: Sequence[str] = (),
) -> list[Violation]:
    """Replay a path as :func:`replay_tree` does, in a library that is already loaded."""
    keys = _given(library, key, given)
    required = [parse_requirement(text, 'require').requirement for text in require]
    return replay(lambda: TreeSystem(library, key, given=keys, requirements=required), moves_of(moves))
