# SPDX-License-Identifier: BSD-3-Clause
"""Check behaviors with their trees: state machines, skills, and blackboards."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, groupby
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.blackboard import Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import TreeKey
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.skill import LEVELS, Skill
from flexbt_core.state_machine.authoring.wrappers import StateWrapper
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition, StateKind
from flexbt_core.state_machine.model.event_state import state_skill
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_tools.tree_checks.check import HOST_KEYS, lost_write
from flexbt_tools.tree_checks.diagnostics import SHARED_RESOURCE, TOO_SHORT, Diagnostic
from flexbt_tools.tree_checks.reachability import least_times
from flexbt_tools.tree_checks.resources import NO_SKILLS, tree_resources
from flexbt_tools.trees.key_usage import EntryUsage, KeyUsage, NodePlace, lost_writes

from .built_behavior import BuiltBehavior, TreeUse, UsedTrees, used_trees
from .findings import (
    BROKEN_TREE,
    KEY_CLASH,
    LOST_WRITE,
    OTHER_TREE,
    REFUSED,
    RULES,
    SKILL,
    UNREAD_KEY,
    UNWRITTEN_KEY,
    Finding,
)
from .machine_rules import machine_findings

_ORDER = {rule.name: index for index, rule in enumerate(RULES)}


def check_behavior(
    behavior: BuiltBehavior,
    files: Sequence[str],
    registry: NodeRegistry,
    skills: SkillLibrary = NO_SKILLS,
    inputs: Sequence[str] = (),
) -> list[Finding]:
    """Return the findings for a behavior, errors first.

    ``files`` are further tree files that the BT server has. ``skills`` are those of the leaves, and those that files
    declare. Something outside the behavior writes the blackboard keys ``inputs``.
    """
    if behavior.machine is None:
        if behavior.records:
            return [Finding(REFUSED, one['node'], one['message'], record=one) for one in behavior.records]
        return [Finding(REFUSED, '', problem) for problem in behavior.problems]
    used = used_trees(behavior.machine, files, registry)
    found = [*used.findings, *machine_findings(behavior.machine), *blackboard_findings(used, inputs)]
    found += skill_findings(behavior.machine, used, skills)
    return sorted(dict.fromkeys(found), key=lambda one: _ORDER[one.rule.name])


# Blackboards: whether the states of a behavior and the trees that they run agree about keys.
#
# All trees that a behavior runs on one blackboard, and all states that read or write it, are checked together: any of
# them may read what another writes, in any order.


def blackboard_findings(trees: UsedTrees, inputs: Collection[str] = ()) -> Iterator[Finding]:
    """Yield the findings between the states and the trees, blackboard by blackboard.

    Something outside the behavior writes the keys ``inputs``.
    """
    yield from _other_trees(trees)
    usage = KeyUsage(trees.library)
    for name, uses in groupby(sorted(trees.uses, key=_blackboard), key=_blackboard):
        yield from _of_blackboard(name, list(uses), usage, {*HOST_KEYS, *inputs})


_WORD: Final = re.compile(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+')
_LEAST: Final = 4
"""Minimum number of letters of a word, or of a name, to be compared."""


def _other_trees(trees: UsedTrees) -> Iterator[Finding]:
    """Yield states that are named after an existing tree but run a tree with a different name."""
    for use in trees.uses:
        if use.key is None:
            continue
        label = use.path.rpartition('/')[2]
        own = [use.key.id, Path(use.key.file).stem]
        folder = Path(use.key.file).parent
        beside = sorted(file.stem for file in folder.glob('*.xml')) if folder.is_dir() else []
        if any(set(_words(label)) & set(_words(name)) or _is_called_after(label, name) for name in own):
            continue
        others = (name for name in dict.fromkeys([*trees.library.tree_ids(), *beside]) if name not in own)
        other = next((name for name in others if _is_called_after(label, name)), '')
        if other:
            message = f'it runs the tree [{use.key.id}] of {use.key.file}, and there is a tree {other!r}'
            yield Finding(OTHER_TREE, use.path, message)


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORD.findall(name) if len(word) >= _LEAST]


def _is_called_after(label: str, tree: str) -> bool:
    """Return whether one name is the beginning of the other, as Recover of Recovery."""
    one, other = (re.sub(r'[^a-z0-9]', '', name.lower()) for name in (label, tree))
    return min(len(one), len(other)) >= _LEAST and (one.startswith(other) or other.startswith(one))


def _blackboard(use: TreeUse) -> str:
    return use.use.blackboard


def _of_blackboard(name: str, uses: Sequence[TreeUse], usage: KeyUsage, given: Collection[str]) -> Iterator[Finding]:
    board = Blackboard()
    usages: dict[Entry, EntryUsage] = {}
    runners = {use.key: use.path for use in uses if use.key is not None}
    errors: list[Finding] = []
    for key, path in runners.items():
        try:
            usage.add(key, board, usages)
        except TreeLoadError as error:
            errors += (Finding(BROKEN_TREE, path, one.message, Diagnostic(BROKEN_TREE, one)) for one in error.errors)
    if errors:
        yield from errors
        return
    board_name = f'blackboard {name!r}' if name else 'the shared blackboard'
    keys = _Keys(board, usages, uses, runners, given)
    yield from keys.clashes()
    if any(use.runs_unknown for use in uses):
        return
    yield from keys.unread(board_name)
    yield from keys.lost_in_trees()
    yield from keys.unwritten_for_states(board_name)
    yield from keys.unwritten_for_trees(board_name)


class _Keys:
    """The keys of one blackboard."""

    def __init__(
        self,
        board: Blackboard,
        usages: dict[Entry, EntryUsage],
        uses: Sequence[TreeUse],
        runners: Mapping[TreeKey, str],
        given: Collection[str],
    ) -> None:
        self._uses = uses
        self._usages = usages
        self._runners = runners
        self._given = given
        self._of_key = {
            key: usages[entry] for key in board if (entry := board.entry(key)) is not None and entry in usages
        }
        self._names = {usage.entry: key for key, usage in self._of_key.items()}
        self._written = {key for use in uses for key in use.use.writes}
        self._read = {key for use in uses for key in use.use.reads}

    def clashes(self) -> Iterator[Finding]:
        """Yield states and trees that use the same key for different things."""
        for use in self._uses:
            for verb, types in (('writes', use.use.writes), ('reads', use.use.reads)):
                for key, type in types.items():
                    usage = self._of_key.get(key)
                    declared = usage.entry.type if usage is not None else None
                    if declared is not None and _clash(type, declared.name):
                        message = f'{verb} the key {key!r} as {type}; for the trees there it is {declared.name}'
                        yield Finding(KEY_CLASH, use.path, message)

    def unread(self, board: str) -> Iterator[Finding]:
        """Yield keys that a state writes and nothing reads."""
        for use in self._uses:
            for key in use.use.writes:
                usage = self._of_key.get(key)
                if (usage is None or not usage.is_read) and key not in self._read:
                    yield Finding(UNREAD_KEY, use.path, f'writes the key {key!r}, which nothing on {board} reads')

    def lost_in_trees(self) -> Iterator[Finding]:
        """Yield keys that a tree writes and nothing reads, if the intended reader is clear."""
        for lost in lost_writes(self._usages.values()):
            if self._names.get(lost.entry) not in self._read:
                place = lost_write(lost)
                yield Finding(LOST_WRITE, self._path(lost.writer), place.place.message, place)

    def unwritten_for_states(self, board: str) -> Iterator[Finding]:
        """Yield keys that a state reads and nothing writes."""
        for use in self._uses:
            for key in use.use.reads:
                usage = self._of_key.get(key)
                is_written = (usage is not None and usage.is_written) or key in self._written
                if not is_written and key not in self._given:
                    yield Finding(UNWRITTEN_KEY, use.path, f'reads the key {key!r}, which nothing on {board} writes')

    def unwritten_for_trees(self, board: str) -> Iterator[Finding]:
        """Yield keys that a tree reads and nothing writes."""
        for usage in self._usages.values():
            key = self._names.get(usage.entry)
            if not usage.readers or usage.is_written or key in self._written or key in self._given:
                continue
            place = usage.readers[0]
            message = f'key [{place.use.key}] is read, and neither a state nor a tree on {board} writes it'
            yield Finding(UNWRITTEN_KEY, self._path(place), message, Diagnostic(UNWRITTEN_KEY, place.error(message)))

    def _path(self, place: NodePlace) -> str:
        """Return the path of the state that runs the tree; '' if several files are loaded as one."""
        return next((path for tree, path in self._runners.items() if tree.file == place.tree.source.file), '')


def _clash(type: str, declared: str) -> bool:
    """Return whether a state's value cannot have a port's type. Numbers and text convert to each other."""
    if type == declared or 'string' in (type, declared):
        return False
    return '/' in type or '/' in declared


# Skills: whether the states of a behavior match their skills, share no actuator at the same time, and have enough time.

Users = Mapping[str, str]
"""The required actuators, each with the name of one user."""

_NO_TIME: Final = (0.0, 0.0)


def skill_findings(machine: MachineDefinition, trees: UsedTrees, skills: SkillLibrary) -> Iterator[Finding]:
    """Yield the findings about skills. ``skills`` are those of the leaves, and those that files declare."""
    needs: dict[str, Users] = {}  # by path
    lasting: dict[str, tuple[str, float]] = {}  # by path: the tree, and the minimum time until it succeeds
    of_trees, times = tree_resources(trees.library, skills), least_times(trees.library, skills)
    for use in trees.uses:
        if use.key is not None:
            lasting[use.path] = f'its tree {use.key.id}', times[use.key]
            leaves = of_trees[use.key].items()
            needs[use.path] = {name: f'{use.path} ({leaf} in tree {use.key.id})' for name, leaf in leaves}
    nodes = list(machine.nodes())
    known = {node.path: _skill(node, skills) for node in nodes if isinstance(node, StateDefinition)}
    for node in reversed(nodes):
        if isinstance(node, StateDefinition):
            skill = known[node.path]
            yield from _outcomes(node, skill)
            yield from _in_time(node, skill, *lasting.get(node.path, ('it', skill.duration[0])))
            if skill.duration != _NO_TIME:
                needs[node.path] = {**needs.get(node.path, {}), **dict.fromkeys(skill.resources, node.path)}
            continue
        yield from _ways(node, known)
        children = [needs.get(child.path, {}) for child in node.children.values()]
        # While a state with priority runs, all others are paused.
        alone = node.kind is StateKind.PRIORITY
        needs[node.path] = {} if alone else {name: user for one in reversed(children) for name, user in one.items()}
        if node.kind is StateKind.CONCURRENCY:
            for one, other in combinations(children, 2):
                for name in one.keys() & other.keys():
                    message = f'{one[name]} and {other[name]} need [{name}] for themselves, and run at the same time'
                    yield Finding(SHARED_RESOURCE, node.path, message)


def _in_time(node: StateDefinition, skill: Skill, what: str, least: float) -> Iterator[Finding]:
    """Yield a finding if the state times out before it can succeed."""
    limits = [node.state.time_limit] if isinstance(node.state, StateWrapper) else []
    limit = min([*limits, skill.deadline if skill.deadline is not None else math.inf])
    if limit < least < math.inf:
        message = f'it can never be done: {what} takes {least:g} s, and it is given up after {limit:g} s'
        yield Finding(TOO_SHORT, node.path, message)


def _ways(machine: MachineDefinition, known: Mapping[str, Skill]) -> Iterator[Finding]:
    """Yield transitions to a state that requires the opposite of what was just achieved or answered."""
    for child in machine.children.values():
        for name, transition in child.transitions.items():
            target = machine.children.get(transition.state or '')
            if target is None or child.path not in known or target.path not in known:
                continue
            skill, following = known[child.path], known[target.path]
            outcome = skill.outcomes.get(name)
            unbound = {*skill.parameters, *following.parameters}
            contrary = {~one for one in outcome.effects} if outcome is not None else set()
            for literal in following.preconditions:
                if literal in contrary and unbound.isdisjoint(literal.arguments):
                    message = f'it needs {literal}; {child.path} leads here by {name!r}, after which {~literal}'
                    yield Finding(SKILL, target.path, message)


def _skill(node: StateDefinition, skills: SkillLibrary) -> Skill:
    own = state_skill(node.state)
    told = skills.skills.get(own.name)
    if told is None:
        return own
    whole = told.completed_by('', own.outcomes, own.reads, own.writes)
    return replace(whole, resources=told.resources or own.resources)


def _outcomes(node: StateDefinition, skill: Skill) -> Iterator[Finding]:
    """Yield outcomes that the skill does not describe, or that only the skill has."""
    for name, outcome in skill.outcomes.items():
        if name not in node.outcomes:
            known = did_you_mean(name, node.outcomes)
            message = f'its skill speaks of the outcome {short_repr(name)}, which the state does not have{known}'
            yield Finding(SKILL, node.path, message)
        elif outcome.kind is None and (skill.preconditions or any(one.effects for one in skill.outcomes.values())):
            message = (
                f'its skill does not say what the outcome {short_repr(name)} means; give it a class, such as failed'
            )
            yield Finding(SKILL, node.path, message)
        elif outcome.autonomy is not None and name in node.transitions:
            given = node.transitions[name].autonomy
            if given < outcome.autonomy:
                level = f'level {LEVELS[given]}' if given >= 0 else 'no level'
                wanted = f'its skill requires autonomy {LEVELS[outcome.autonomy]} for {name!r}'
                message = f'{wanted}; the transition has {level}'
                yield Finding(SKILL, node.path, message)
