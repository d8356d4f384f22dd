# SPDX-License-Identifier: BSD-3-Clause
"""What a state class declares, as far as synthesis has to know it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from flexbt_core.values import excerpt, hint

from .yaml_nodes import YamlFile

_KEYS: Final = ('outcomes', 'input_keys', 'output_keys')


@dataclass(frozen=True, slots=True)
class Interface:
    """Outcomes of a state class, and the userdata that it reads and writes (None: not known)."""

    outcomes: tuple[str, ...]
    input_keys: tuple[str, ...] | None = None
    output_keys: tuple[str, ...] | None = None


class UnknownParameterError(ValueError):
    """A state class takes no parameter of this name; ``known`` are those that it takes."""

    def __init__(self, state: str, parameter: str, known: Collection[str]) -> None:
        super().__init__(f"{state} takes no parameter '{excerpt(parameter)}'{hint(parameter, known)}")
        self.state, self.parameter, self.known = state, parameter, known


class Interfaces(Protocol):
    """Finds what a state class declares."""

    def __call__(self, name: str, parameters: Mapping[str, Any]) -> Interface:
        """The interface of a class with these parameters. Raises LookupError or ValueError, fit for the user;
        UnknownParameterError for a parameter that the class does not take."""


def read_interfaces(text: str, source: str) -> Interfaces:
    """Interfaces from YAML: ``Name: {outcomes: [...], input_keys: [...], output_keys: [...]}``.

    Raises:
        SynthesisError: with every problem of it.
    """
    file = YamlFile(text, source)
    known: dict[str, Interface] = {}
    for name, node in file.top('a file of interfaces').items():
        entries = file.entries(node, name, _KEYS)
        if 'outcomes' not in entries:
            file.problem(node, f'{name} has no outcomes')
        words = {key: tuple(one.text for one in file.words(entries[key], f'{key} of {name}')) for key in entries}
        known[name] = Interface(words.get('outcomes', ()), words.get('input_keys'), words.get('output_keys'))
    file.end()

    def interface(name: str, parameters: Mapping[str, Any]) -> Interface:
        if name not in known:
            raise LookupError(f"there is no state '{name}'{hint(name, known)}")
        return known[name]

    return interface
