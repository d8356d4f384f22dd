# SPDX-License-Identifier: BSD-3-Clause
"""Requests and specifications, as data and in their files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from flexbt_core.values.text import did_you_mean, short_repr

from .specification import GameVariable, Section, Specification
from .yaml_nodes import YamlEntry, YamlFile

FAILURE_OUTCOMES: Final = frozenset({'failed', 'failure', 'aborted', 'canceled'})
"""Outcomes of a machine that are not a success."""

_KEYS: Final = (
    'initial_conditions',
    'goals',
    'sm_outcomes',
    'system_name',
    'spec_name',
    'specification_file_name',
    'synthesis_timeout_s',
)


@dataclass(frozen=True, slots=True)
class MachineRequest:
    """Initial conditions and goals (formulas over propositions, each list a conjunction), outcomes of the machine.

    Without goals the specification has the objective. ``timeout`` in seconds; 0 for the default.
    """

    initial_conditions: tuple[str, ...] = ()
    goals: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()
    system: str = ''
    name: str = ''
    timeout: float = 0.0


def read_request(text: str, source: str) -> MachineRequest:
    """Return a request in YAML (or JSON) with the fields of the action's message.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    file = YamlFile(text, source)
    entries = file.top('a request', _KEYS)

    def texts(key: str) -> tuple[str, ...]:
        return tuple(one.text for one in file.words(entries.get(key), key))

    def text_of(key: str) -> str:
        return file.word(entries[key], key) if key in entries else ''

    timeout = (
        file.value(entries['synthesis_timeout_s'], 'synthesis_timeout_s') if 'synthesis_timeout_s' in entries else 0
    )
    if not isinstance(timeout, int | float) or not 0 <= timeout < 1e9:
        file.problem(
            entries['synthesis_timeout_s'], f'synthesis_timeout_s has to be seconds, not {short_repr(timeout)}'
        )
        timeout = 0
    request = MachineRequest(
        texts('initial_conditions'),
        texts('goals'),
        texts('sm_outcomes'),
        text_of('system_name'),
        text_of('spec_name'),
        float(timeout),
    )
    file.end()
    return request


# Specifications as they are written: YAML with ``specs``, or sections of structuredslugs.

_DECLARATION: Final = re.compile(r'([A-Za-z_]\w*)(?:\s*:\s*(\d{1,6})\s*\.\.\.\s*(\d{1,6}))?')
_DECLARING: Final = ('INPUT', 'OUTPUT')
_SECTIONS: Final = (*_DECLARING, *(section.value for section in Section))


@dataclass(frozen=True, slots=True)
class SpecificationFile:
    """Variables that are declared, and formulas by section with the line of each."""

    source: str
    name: str = ''
    variables: Mapping[str, GameVariable] = field(default_factory=dict)
    formulas: Mapping[Section, tuple[YamlEntry, ...]] = field(default_factory=dict)


def read_specification(text: str, source: str) -> SpecificationFile:
    """Return a specification of either form: structuredslugs where the text has a section in brackets.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    if re.search(r'^\s*\[\w+\]\s*(#.*)?$', text, re.MULTILINE):
        return _read_sections(text, source)
    return _read_yaml(text, source)


def _read_yaml(text: str, source: str) -> SpecificationFile:
    file = YamlFile(text, source)
    entries = file.top('a specification', ('spec_name', 'name', 'specs'))
    name = file.word(entries['spec_name'], 'spec_name') if 'spec_name' in entries else ''
    if 'specs' not in entries:
        file.note(1, 'there are no "specs:"')
    found: dict[str, tuple[YamlEntry, ...]] = {}
    for section, node in file.entries(entries.get('specs'), 'specs').items():
        if section in _SECTIONS:
            found[section] = file.words(node, section)
        elif section.upper() in _SECTIONS or did_you_mean(section, _SECTIONS).startswith('; did'):
            file.problem(node, f'{short_repr(section)} is not a section{did_you_mean(section, _SECTIONS)}')
    return _specification(file, name, found)


def _read_sections(text: str, source: str) -> SpecificationFile:
    file = YamlFile(text, source)
    found: dict[str, list[YamlEntry]] = {}
    section = None
    for number, whole in enumerate(text.splitlines(), 1):
        line = whole.partition('#')[0].strip()
        if line.startswith('[') and line.endswith(']'):
            section = line[1:-1].strip()
            if section not in _SECTIONS:
                file.note(number, f'{short_repr(section)} is not a section{did_you_mean(section, _SECTIONS)}')
        elif line and section is None:
            file.note(number, 'a formula before the first section; write for example [SYS_TRANS] above it')
        elif line and section is not None:
            found.setdefault(section, []).append(YamlEntry(line, number))
    return _specification(file, '', found)


def _specification(file: YamlFile, name: str, found: Mapping[str, Iterable[YamlEntry]]) -> SpecificationFile:
    variables: dict[str, GameVariable] = {}
    for section in _DECLARING:
        for text, line in found.get(section, ()):
            parts = _DECLARATION.fullmatch(text)
            if parts is None:
                file.note(line, f'{short_repr(text)} declares no variable: write NAME, or NAME:0...7 for an integer')
                continue
            low, high = parts[2], parts[3]
            bounds = None if low is None else (int(low), int(high))
            if bounds is not None and bounds[0] > bounds[1]:
                file.note(line, f'{short_repr(text)} has no values')
            elif parts[1] in variables:
                file.note(line, f"'{parts[1]}' is declared twice")
            else:
                variables[parts[1]] = GameVariable(parts[1], section == 'INPUT', bounds)
    file.end()
    formulas = {section: tuple(found.get(section.value, ())) for section in Section}
    return SpecificationFile(file.source, name, variables, formulas)


def as_structured_slugs(specification: Specification) -> Iterator[str]:
    """Yield the lines of a specification as structuredslugs, each formula with its origin."""
    for is_input, section in ((True, 'INPUT'), (False, 'OUTPUT')):
        yield f'[{section}]'
        for one in specification.variables.values():
            if one.is_input is is_input:
                yield one.name if one.bounds is None else f'{one.name}:{one.bounds[0]}...{one.bounds[1]}'
        yield ''
    for one_section in Section:
        yield f'[{one_section.value}]'
        for line in specification.lines:
            if line.section is one_section:
                yield line.text if line.origin is None else f'{line.text:<50}  # {line.origin}'
        yield ''
