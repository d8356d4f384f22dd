# SPDX-License-Identifier: BSD-3-Clause
"""Capabilities and mappings in YAML, the interfaces of their states, and which of them may run at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Final

import yaml

from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle
from flexbt_core.values.yaml_data import line_of

from .yaml_nodes import YamlEntry, YamlFile

DEFAULT_OUTCOMES: Final = ('completed', 'failure')
"""Default outcomes to which those of states are normalized; the first is the desired one."""

DEFAULT_AUTONOMY: Final = 1
"""The level of an outcome for which none is given (low)."""

TIMEOUT: Final = 'timeout'
"""The state parameter that contains a deadline."""

_CAPABILITY_NAME: Final = re.compile(r'[A-Za-z_]\w*')
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
    """Names of outcomes: of states (to normalized ones), of the machine (to propositions)."""

    state_outcomes: Mapping[str, str] = field(default_factory=dict)
    machine_outcomes: Mapping[str, str] = field(default_factory=dict)
    transition_outcomes: tuple[str, ...] = ()

    def updated(self, other: Mappings) -> Mappings:
        """Return these with those of another file, which win where both have one."""
        return Mappings(
            {**self.state_outcomes, **other.state_outcomes},
            {**self.machine_outcomes, **other.machine_outcomes},
            other.transition_outcomes or self.transition_outcomes,
        )


@dataclass(frozen=True, slots=True)
class Capability:
    """The capabilities of a state class. Conditions are as they are written; those by outcome have normalized outcomes.

    ``resources`` are what it has for itself while it is active; None, when nothing is said of it: then everything.
    ``deadline`` is the line of the file that has one; its value is among the parameters, as ``timeout``.
    """

    name: str
    interface: str
    line: int
    parameters: Mapping[str, Any] = field(default_factory=dict)
    preconditions: tuple[YamlEntry, ...] = ()
    postconditions: Mapping[str, tuple[YamlEntry, ...]] = field(default_factory=dict)
    relations: Mapping[str, tuple[YamlEntry, ...]] = field(default_factory=dict)
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
    """Read a mapping file. Raises SynthesisError with all its problems."""
    file = YamlFile(text, source)
    mappings = _mappings(file, file.top('a file of mappings', _MAPPING_KEYS))
    file.end()
    return mappings


def read_capabilities(text: str, source: str, mappings: Mappings | None = None) -> CapabilityFile:
    """Return a capability file; ``mappings`` apply where it has none.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    file = YamlFile(text, source)
    entries = file.top('a capability file', _FILE_KEYS)
    own = (mappings or Mappings()).updated(_mappings(file, entries))
    own = replace(own, transition_outcomes=own.transition_outcomes or DEFAULT_OUTCOMES)
    name = file.word(entries['name'], 'name') if 'name' in entries else source.rpartition('/')[2].split('.')[0]
    integers, world_integers = _by_owner(file, entries.get('variable_mappings'), 'variable_mappings')
    labels = {key: _labels(file, *one) for key, one in integers.items()}
    remembered, world_memory = _by_owner(file, entries.get('memory'), 'memory')
    memory = {key: file.flag(*one) for key, one in remembered.items()}
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
        if not _CAPABILITY_NAME.fullmatch(outcome.text):
            file.note(outcome.line, f'{short_repr(outcome.text)} is not a name of an outcome')
    return Mappings(
        pairs('state_outcome_mappings'),
        pairs('sm_outcome_mappings'),
        tuple(dict.fromkeys(one.text for one in outcomes)),
    )


def _by_owner(
    file: YamlFile, node: yaml.Node | None, what: str
) -> tuple[dict[str, tuple[yaml.Node, str]], frozenset[str]]:
    """Return the entries of the world and of the system, each with what it is called, and the names of the world's."""
    found: dict[str, tuple[yaml.Node, str]] = {}
    world: set[str] = set()
    for owner, names in file.entries(node, what, ('env_props', 'sys_props')).items():
        for name, one in file.entries(names, f'{what}.{owner}').items():
            if name in found:
                file.problem(one, f'{what}.{owner}.{name} is that of the other owner, too; name it once')
            found[name] = one, f'{what}.{owner}.{name}'
            _checked_name(file, name, *found[name])
            world |= {name} if owner == 'env_props' else set()
    return found, frozenset(world)


def _labels(file: YamlFile, values: yaml.Node, what: str) -> dict[int, str]:
    labels = {
        file.number(one, key, f'a value in {what}'): file.word(one, what)
        for key, one in file.entries(values, what).items()
    }
    if not labels:
        file.problem(values, f"{what} has no values: write for example 0: 'None'")
    if len(set(labels.values())) < len(labels):
        file.problem(values, f'{what} has two values of one name')
    return labels


def _capability(file: YamlFile, name: str, node: yaml.Node, mappings: Mappings) -> Capability:
    what = f'capability {truncate_middle(name)}'
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
    """Return the parameters of the state; a deadline is that which states call ``timeout``."""
    parameters = {key: file.value(one, f'parameter {key} of {what}') for key, one in given.items()}
    if deadline is None:
        return parameters
    seconds = file.value(deadline, f'deadline of {what}')
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 < seconds < 1e9:
        file.problem(deadline, f'deadline of {what} has to be a number of seconds above 0, not {short_repr(seconds)}')
    elif TIMEOUT in parameters:
        file.problem(deadline, f'{what} has a deadline and the parameter {TIMEOUT}: write one of them')
    else:
        parameters[TIMEOUT] = float(seconds)
    return parameters


def _resources(file: YamlFile, node: yaml.Node, what: str) -> frozenset[str]:
    named = file.words(node, f'resources of {what}')
    for one in named:
        if not _CAPABILITY_NAME.fullmatch(one.text):
            file.note(one.line, f'resources of {what}: {short_repr(one.text)} is not a name: letters, digits and _')
    return frozenset(one.text for one in named)


def _by_outcome(
    file: YamlFile, node: yaml.Node | None, what: str, mappings: Mappings
) -> dict[str, tuple[YamlEntry, ...]]:
    """List by normalized outcome, each by its name, or by that of an outcome of states that counts as it; a list by
    itself is of the first one."""
    if not isinstance(node, yaml.MappingNode):
        words = file.words(node, what)
        return {mappings.transition_outcomes[0]: words} if words else {}
    known = {**mappings.state_outcomes, **{one: one for one in mappings.transition_outcomes}}
    found: dict[str, tuple[YamlEntry, ...]] = {}
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
    file.problem(node, f'{what} is {short_repr(level)}; the levels are 0 (off), 1 (low), 2 (high), 3 (full)')
    return DEFAULT_AUTONOMY


def _userdata(file: YamlFile, node: yaml.Node | None, what: str) -> dict[str, str]:
    found = {}
    for key, one in file.entries(node, what).items():
        entries = file.entries(one, f'{key} of {what}', ('remapping',))
        found[key] = file.word(entries['remapping'], f'remapping of {key}') if 'remapping' in entries else key
    return found


def _checked_name(file: YamlFile, name: str, node: yaml.Node, what: str) -> None:
    if not _CAPABILITY_NAME.fullmatch(name) or len(name) > 80:
        file.problem(node, f'{what}: {short_repr(name)} is not a name: letters, digits and _, at most 80')


# What a state class declares, as far as synthesis has to know it.

_KEYS: Final = ('outcomes', 'input_keys', 'output_keys')


@dataclass(frozen=True, slots=True)
class StateInterface:
    """Outcomes of a state class, and the userdata that it reads and writes (None: not known)."""

    outcomes: tuple[str, ...]
    input_keys: tuple[str, ...] | None = None
    output_keys: tuple[str, ...] | None = None


class UnknownParameterError(ValueError):
    """A state class takes no parameter of this name; ``known`` are those that it takes."""

    def __init__(self, state: str, parameter: str, known: Collection[str]) -> None:
        super().__init__(f"{state} takes no parameter '{truncate_middle(parameter)}'{did_you_mean(parameter, known)}")
        self.state, self.parameter, self.known = state, parameter, known


Interfaces = Callable[[str, Mapping[str, Any]], StateInterface]
"""A function that returns the interface of a state class with these parameters.

It raises LookupError or ValueError, fit for the user; UnknownParameterError for a parameter that the class does not
take.
"""


def read_interfaces(text: str, source: str) -> Interfaces:
    """Interfaces from YAML: ``Name: {outcomes: [...], input_keys: [...], output_keys: [...]}``.

    Raises:
        SynthesisError: with every problem of it.
    """
    file = YamlFile(text, source)
    known: dict[str, StateInterface] = {}
    for name, node in file.top('a file of interfaces').items():
        entries = file.entries(node, name, _KEYS)
        if 'outcomes' not in entries:
            file.problem(node, f'{name} has no outcomes')
        words = {key: tuple(one.text for one in file.words(entries[key], f'{key} of {name}')) for key in entries}
        known[name] = StateInterface(words.get('outcomes', ()), words.get('input_keys'), words.get('output_keys'))
    file.end()

    def interface(name: str, parameters: Mapping[str, Any]) -> StateInterface:
        if name not in known:
            raise LookupError(f"there is no state '{name}'{did_you_mean(name, known)}")
        return known[name]

    return interface


# Which capabilities may be active at once.

_IDENTIFIER: Final = re.compile(r'[A-Za-z_]\w*')


def concurrent_pairs(file: CapabilityFile, interfaces: Mapping[str, StateInterface]) -> list[tuple[str, str]]:
    """Return the pairs, each in the order of names: of capabilities that say which resources they have for themselves,
    share none, and do not change what the other one reads or changes.

    Pairs suffice: of several each two have to be one. A pre-condition holds then as long as the capability is active.
    """
    known = {key: one for key, one in sorted(file.capabilities.items()) if one.resources is not None}
    changes: dict[str, frozenset[str]] = {}
    touches: dict[str, frozenset[str]] = {}
    for key, one in known.items():
        read = _keys(interfaces[key].input_keys, one.userdata_in)
        changes[key] = changed_by(one) | _keys(interfaces[key].output_keys, one.userdata_out)
        touches[key] = changes[key] | _names(entry.text for entry in one.preconditions) | read
    return [
        (one, other)
        for one, other in combinations(known, 2)
        if not (known[one].resources or frozenset()) & (known[other].resources or frozenset())
        and not changes[one] & touches[other]
        and not changes[other] & touches[one]
    ]


def changed_by(capability: Capability) -> frozenset[str]:
    """Return the variables that outcomes of a capability change, memory without its suffix."""
    effects = (entry.text.partition('=')[0] for entries in capability.postconditions.values() for entry in entries)
    return _names(effects)


def _names(texts: Iterable[str]) -> frozenset[str]:
    return frozenset(name.removesuffix('_m') for text in texts for name in _IDENTIFIER.findall(text))


def _keys(declared: Iterable[str] | None, remapping: Mapping[str, str]) -> frozenset[str]:
    """Keys of userdata, as the machine calls them."""
    return frozenset(f'>{remapping.get(key, key)}' for key in (*(declared or ()), *remapping))
