# SPDX-License-Identifier: BSD-3-Clause
"""Whether the states of a behavior keep to what their skills say, leave each other their actuators, and have the time
that they need."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Final

from flexbt_core.skills import LEVELS, Skill, SkillLibrary
from flexbt_core.state_machine import MachineDefinition, StateDefinition, StateKind, StateWrapper, state_skill
from flexbt_core.values import hint, shown
from flexbt_tools.tree_checks import SHARED_RESOURCE, TOO_SHORT, least_times, tree_resources

from .findings import SKILL, Finding
from .used_trees import UsedTrees

Users = Mapping[str, str]
"""The actuators that something needs, and who needs it, as it is named to users; one of several."""

_NO_TIME: Final = (0.0, 0.0)


def findings_of(machine: MachineDefinition, trees: UsedTrees, skills: SkillLibrary) -> Iterator[Finding]:
    """What is found. ``skills`` are those of the leaves, and those that files declare."""
    needs: dict[str, Users] = {}  # by path
    lasting: dict[str, tuple[str, float]] = {}  # by path: the tree, and the least time until it succeeds
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
        # What has priority runs while all others are paused.
        alone = node.kind is StateKind.PRIORITY
        needs[node.path] = {} if alone else {name: user for one in reversed(children) for name, user in one.items()}
        if node.kind is StateKind.CONCURRENCY:
            for one, other in combinations(children, 2):
                for name in one.keys() & other.keys():
                    message = f'{one[name]} and {other[name]} need [{name}] for themselves, and run at the same time'
                    yield Finding(SHARED_RESOURCE, node.path, message)


def _in_time(node: StateDefinition, skill: Skill, what: str, least: float) -> Iterator[Finding]:
    """A state that is given up before it can be done."""
    limits = [node.state.time_limit] if isinstance(node.state, StateWrapper) else []
    limit = min([*limits, skill.deadline if skill.deadline is not None else math.inf])
    if limit < least < math.inf:
        message = f'it can never be done: {what} takes {least:g} s, and it is given up after {limit:g} s'
        yield Finding(TOO_SHORT, node.path, message)


def _ways(machine: MachineDefinition, known: Mapping[str, Skill]) -> Iterator[Finding]:
    """Transitions to a state that needs the contrary of what was just brought about, or was just answered."""
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
    """Outcomes of which the skill says nothing, or of which only the skill knows."""
    for name, outcome in skill.outcomes.items():
        if name not in node.outcomes:
            known = hint(name, node.outcomes)
            message = f'its skill speaks of the outcome {shown(name)}, which the state does not have{known}'
            yield Finding(SKILL, node.path, message)
        elif outcome.kind is None and (skill.preconditions or any(one.effects for one in skill.outcomes.values())):
            message = f'its skill does not say what the outcome {shown(name)} means; give it a class, such as failed'
            yield Finding(SKILL, node.path, message)
        elif outcome.autonomy is not None and name in node.transitions:
            given = node.transitions[name].autonomy
            if given < outcome.autonomy:
                level = f'level {LEVELS[given]}' if given >= 0 else 'no level'
                wanted = f'its skill requires autonomy {LEVELS[outcome.autonomy]} for {name!r}'
                message = f'{wanted}; the transition has {level}'
                yield Finding(SKILL, node.path, message)
