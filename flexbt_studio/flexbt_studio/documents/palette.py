# SPDX-License-Identifier: BSD-3-Clause
"""The palette: the node types and states that a mission can be made of, as JSON values."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import NodeManifest
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_tools.trees.stand_ins import is_stand_in


def node_types(registry: NodeRegistry) -> list[dict[str, Any]]:
    """Return all node types, each with its ports, documentation and example, ordered by kind and name."""
    return sorted(map(node_type, registry), key=lambda one: (one['kind'], one['id']))


def node_type(manifest: NodeManifest) -> dict[str, Any]:
    """Return one node type. ``children`` is the least and greatest number of children, null for no limit."""
    example = manifest.example
    return {
        'id': manifest.id,
        'kind': manifest.kind.value,
        'ports': [_port(name, port) for name, port in manifest.ports.items()],
        'children': list(manifest.children),
        'summary': manifest.documentation.partition('\n\n')[0],
        'documentation': manifest.documentation,
        'example': '' if example is None else example.xml,
        'package': manifest.node_class.__module__.partition('.')[0],
        'installed': not is_stand_in(manifest),
    }


def _port(name: str, port: Port) -> dict[str, Any]:
    return {
        'name': name,
        'direction': port.direction.value,
        'type': '' if port.type is None else port.type.name,
        'category': '' if port.type is None else port.type.category,
        'default': None if port.default is NO_DEFAULT else str(port.default),
        'required': port.required,
        'description': port.documentation,
    }


_MARKS: Final = {'--': 'parameters', '>#': 'inputs', '#>': 'outputs', '<=': 'outcomes'}
_ENTRY: Final = re.compile(r'^(--|>#|#>|<=)\s+(\S+)\s*(.*)$')


def states(installed: Mapping[str, Callable[..., EventState]]) -> list[dict[str, Any]]:
    """Return the installed states by name, with the package if several packages have one of that name.

    Docstrings in FlexBE's form describe parameters, keys and outcomes.
    """
    classes = {name: one for name, one in installed.items() if isinstance(one, type)}
    longest_first = sorted(classes.items(), key=lambda entry: -len(entry[0]))
    names = {(one, name.rpartition('/')[2]): name for name, one in longest_first}  # a class may have another name, too
    return [_state(name, one) for (one, _), name in sorted(names.items(), key=lambda entry: entry[1])]


def declared(state: type[Any]) -> tuple[list[str], dict[str, list[tuple[str, str]]]]:
    """Return what the docstring of a state declares: the lines of its text, and pairs of name and text by kind.

    The kinds are parameters, inputs, outputs and outcomes. The form is FlexBE's.
    """
    text: list[str] = []
    entries: dict[str, list[tuple[str, str]]] = {kind: [] for kind in _MARKS.values()}
    for line in inspect.cleandoc(state.__doc__ or '').splitlines():
        if found := _ENTRY.match(line.strip()):
            entries[_MARKS[found[1]]].append((found[2], found[3]))
        else:
            text.append(line)
    return text, entries


def _state(name: str, state: type[EventState]) -> dict[str, Any]:
    text, entries = declared(state)
    described = dict(entries['parameters'])
    return {
        'id': name,
        'kind': 'state',
        'parameters': [_parameter(one, described.get(one.name, '')) for one in _parameters(state)],
        **{
            kind: [{'name': key, 'description': told} for key, told in entries[kind]]
            for kind in list(_MARKS.values())[1:]
        },
        'summary': ' '.join(text).strip().partition('. ')[0],
        'documentation': '\n'.join(text).strip(),
        'package': state.__module__.partition('.')[0],
    }


def _parameters(state: type[EventState]) -> list[inspect.Parameter]:
    taken = inspect.signature(state).parameters.values()
    return [one for one in taken if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]


def _parameter(parameter: inspect.Parameter, described: str) -> dict[str, Any]:
    kind, _, text = described.partition(' ')
    required = parameter.default is parameter.empty
    return {
        'name': parameter.name,
        'type': kind,
        'default': None if required else repr(parameter.default),
        'required': required,
        'description': text.strip(),
    }
