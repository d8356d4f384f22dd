# SPDX-License-Identifier: BSD-3-Clause
"""Capabilities and mappings as flexbe_synthesis has them in YAML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import yaml

from flexbt_core.values import excerpt, line_of, shown

from .yaml_nodes import Entry, YamlFile

DEFAULT_OUTCOMES: Final = ('completed', 'failure')
"""What outcomes of states are normalized to where nothing else is said; the first is the one that is hoped for."""

DEFAULT_AUTONOMY: Final = 1
"""The level of an outcome for which none is given (low)."""

TIMEOUT: Final = 'timeout'
"""The parameter of states that a deadline is."""

_NAME: Final = re.compile(r'[A-Za-z_]\w*')
_MAPPING_KEYS: Final = ('sm_outcome_mappings', 'state_outcome_mappings', 'transition_outcomes')
_FILE_KEYS: Final = ('name', 'variable_mappings', 'memory', 'capabilities', *_MAPPING_KEYS)
_CAPABILITY_KEYS: Final = (
    'interface',
    'parameters',
    'preconditions',
    'postconditions',
    'transition_relation',
    'autonomy',
    'userdata_in',
    'userdata_out',
    'resources',
    'deadline',
)


@dataclass(frozen=True, slots=True)
class Mappings:
    """How outcomes are called: of states (to normalized ones), of the machine (to propositions)."""

    state_outcomes: Mapping[str, str] = field(default_factory=dict)
    machine_outcomes: Mapping[str, str] = field(default_factory=dict)
    transition_outcomes: tuple[str, ...] = ()

    def updated(self, other: Mappings) -> Mappings:
        """These, and those of another file, which count where both have one."""
        return Mappings(
            {**self.state_outcomes, **other.state_outcomes},
            {**self.machine_outcomes, **other.machine_outcomes},
            other.transition_outcomes or self.transition_outcomes,
        )


@dataclass(frozen=True, slots=True)
class Capability:
    """What a state class can do. Conditions are as they are written; those by outcome have normalized outcomes.

    ``resources`` are what it has for itself while it is active; None, when nothing is said of it: then everything.
    ``deadline`` is the line of the file that has one; its value is among the parameters, as ``timeout``.
    """

    name: str
    interface: str
    line: int
    parameters: Mapping[str, Any] = field(default_factory=dict)
    preconditions: tuple[Entry, ...] = ()
    postconditions: Mapping[str, tuple[Entry, ...]] = field(default_factory=dict)
    relations: Mapping[str, tuple[Entry, ...]] = field(default_factory=dict)
    autonomy: Mapping[str, int] = field(default_factory=dict)
    default_autonomy: int = DEFAULT_AUTONOMY
    userdata_in: Mapping[str, str] = field(default_factory=dict)
    userdata_out: Mapping[str, str] = field(default_factory=dict)
    resources: frozenset[str] | None = None
    deadline: int | None = None


@dataclass(frozen=True, slots=True)
class CapabilityFile:
    """A system: its capabilities, its integers with labels and its memory; what belongs to the world is ``world_*``."""

    source: str
    name: str
    capabilities: Mapping[str, Capability]
    mappings: Mappings
    labels: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    world_integers: frozenset[str] = frozenset()
    memory: Mapping[str, bool] = field(default_factory=dict)
    world_memory: frozenset[str] = frozenset()


def read_mappings(text: str, source: str) -> Mappings:
    """A file of mappings. Raises SynthesisError with every problem of it."""
    file = YamlFile(text, source)
    mappings = _mappings(file, file.top('a file of mappings', _MAPPING_KEYS))
    file.end()
    return mappings


def read_capabilities(text: str, source: str, mappings: Mappings | None = None) -> CapabilityFile:
    """A capability file; ``mappings`` hold where it has none of its own.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    file = YamlFile(text, source)
    entries = file.top('a capability file', _FILE_KEYS)
    own = (mappings or Mappings()).updated(_mappings(file, entries))
    own = replace(own, transition_outcomes=own.transition_outcomes or DEFAULT_OUTCOMES)
    name = file.word(entries['name'], 'name') if 'name' in entries else source.rpartition('/')[2].split('.')[0]
    labels, world_integers = _labels(file, entries.get('variable_mappings'))
    memory, world_memory = _memory(file, entries.get('memory'))
    if 'capabilities' not in entries:
        file.note(1, 'there are no capabilities: write "capabilities:" with an entry for each')
    capabilities = {
        label: _capability(file, label, node, own)
        for label, node in file.entries(entries.get('capabilities'), 'capabilities').items()
    }
    if 'capabilities' in entries and not capabilities:
        file.problem(entries['capabilities'], 'there are no capabilities')
    file.end()
    return CapabilityFile(source, name, capabilities, own, labels, world_integers, memory, world_memory)


def _mappings(file: YamlFile, entries: Mapping[str, yaml.Node]) -> Mappings:
    def pairs(key: str) -> dict[str, str]:
        return {name: file.word(one, f'{key}.{name}') for name, one in file.entries(entries.get(key), key).items()}

    outcomes = file.words(entries.get('transition_outcomes'), 'transition_outcomes')
    for outcome in outcomes:
        if not _NAME.fullmatch(outcome.text):
            file.note(outcome.line, f'{shown(outcome.text)} is no name of an outcome')
    return Mappings(
        pairs('state_outcome_mappings'),
        pairs('sm_outcome_mappings'),
        tuple(dict.fromkeys(one.text for one in outcomes)),
    )


def _labels(file: YamlFile, node: yaml.Node | None) -> tuple[dict[str, dict[int, str]], frozenset[str]]:
    labels: dict[str, dict[int, str]] = {}
    world: set[str] = set()
    for owner, variables in file.entries(node, 'variable_mappings', ('env_props', 'sys_props')).items():
        for name, values in file.entries(variables, f'variable_mappings.{owner}').items():
            what = f'variable_mappings.{owner}.{name}'
            _checked_name(file, name, values, what)
            labels[name] = {
                file.number(one, key, f'a value in {what}'): file.word(one, what)
                for key, one in file.entries(values, what).items()
            }
            if not labels[name]:
                file.problem(values, f"{what} has no values: write for example 0: 'None'")
            world |= {name} if owner == 'env_props' else set()
    return labels, frozenset(world)


def _memory(file: YamlFile, node: yaml.Node | None) -> tuple[dict[str, bool], frozenset[str]]:
    memory: dict[str, bool] = {}
    world: set[str] = set()
    for owner, names in file.entries(node, 'memory', ('env_props', 'sys_props')).items():
        for name, value in file.entries(names, f'memory.{owner}').items():
            _checked_name(file, name, value, f'memory.{owner}.{name}')
            memory[name] = file.flag(value, f'memory.{owner}.{name}')
            world |= {name} if owner == 'env_props' else set()
    return memory, frozenset(world)


def _capability(file: YamlFile, name: str, node: yaml.Node, mappings: Mappings) -> Capability:
    what = f'capability {excerpt(name)}'
    _checked_name(file, name, node, what)
    entries = file.entries(node, what, _CAPABILITY_KEYS)
    if 'interface' not in entries:
        file.problem(node, f'{what} has no interface: name the state class that carries it out')
    autonomy, default = _autonomy(file, entries.get('autonomy'), f'autonomy of {what}')
    parameters = file.entries(entries.get('parameters'), f'parameters of {what}')
    return Capability(
        name,
        file.word(entries['interface'], f'interface of {what}') if 'interface' in entries else '',
        line_of(node),
        _parameters(file, what, parameters, entries.get('deadline')),
        file.words(entries.get('preconditions'), f'preconditions of {what}'),
        _by_outcome(file, entries.get('postconditions'), f'postconditions of {what}', mappings),
        _by_outcome(file, entries.get('transition_relation'), f'transition_relation of {what}', mappings),
        autonomy,
        default,
        _userdata(file, entries.get('userdata_in'), f'userdata_in of {what}'),
        _userdata(file, entries.get('userdata_out'), f'userdata_out of {what}'),
        _resources(file, entries['resources'], what) if 'resources' in entries else None,
        line_of(entries['deadline']) if 'deadline' in entries else None,
    )


def _parameters(
    file: YamlFile, what: str, given: Mapping[str, yaml.Node], deadline: yaml.Node | None
) -> dict[str, Any]:
    """The parameters of the state; a deadline is that which states call ``timeout``."""
    parameters = {key: file.value(one, f'parameter {key} of {what}') for key, one in given.items()}
    if deadline is None:
        return parameters
    seconds = file.value(deadline, f'deadline of {what}')
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 < seconds < 1e9:
        file.problem(deadline, f'deadline of {what} has to be a number of seconds above 0, not {shown(seconds)}')
    elif TIMEOUT in parameters:
        file.problem(deadline, f'{what} has a deadline and the parameter {TIMEOUT}: write one of them')
    else:
        parameters[TIMEOUT] = float(seconds)
    return parameters


def _resources(file: YamlFile, node: yaml.Node, what: str) -> frozenset[str]:
    named = file.words(node, f'resources of {what}')
    for one in named:
        if not _NAME.fullmatch(one.text):
            file.note(one.line, f'resources of {what}: {shown(one.text)} is no name: letters, digits and _')
    return frozenset(one.text for one in named)


def _by_outcome(file: YamlFile, node: yaml.Node | None, what: str, mappings: Mappings) -> dict[str, tuple[Entry, ...]]:
    """Lists by normalized outcome, each by its name, or by that of an outcome of states that counts as it; a list by
    itself is of the first one."""
    if not isinstance(node, yaml.MappingNode):
        words = file.words(node, what)
        return {mappings.transition_outcomes[0]: words} if words else {}
    known = {**mappings.state_outcomes, **{one: one for one in mappings.transition_outcomes}}
    found: dict[str, tuple[Entry, ...]] = {}
    for outcome, one in file.entries(node, what, known).items():
        normalized = known.get(outcome, outcome)
        found[normalized] = found.get(normalized, ()) + file.words(one, f'{what} after {outcome}')
    return found


def _autonomy(file: YamlFile, node: yaml.Node | None, what: str) -> tuple[dict[str, int], int]:
    if node is None:
        return {}, DEFAULT_AUTONOMY
    if isinstance(node, yaml.ScalarNode):
        return {}, _level(file, node, what)
    return {outcome: _level(file, one, what) for outcome, one in file.entries(node, what).items()}, DEFAULT_AUTONOMY


def _level(file: YamlFile, node: yaml.Node, what: str) -> int:
    level = file.word(node, what)
    if level in ('0', '1', '2', '3'):
        return int(level)
    file.problem(node, f'{what} is {shown(level)}; the levels are 0 (off), 1 (low), 2 (high), 3 (full)')
    return DEFAULT_AUTONOMY


def _userdata(file: YamlFile, node: yaml.Node | None, what: str) -> dict[str, str]:
    found = {}
    for key, one in file.entries(node, what).items():
        entries = file.entries(one, f'{key} of {what}', ('remapping',))
        found[key] = file.word(entries['remapping'], f'remapping of {key}') if 'remapping' in entries else key
    return found


def _checked_name(file: YamlFile, name: str, node: yaml.Node, what: str) -> None:
    if not _NAME.fullmatch(name) or len(name) > 80:
        file.problem(node, f'{what}: {shown(name)} is no name: letters, digits and _, at most 80')
