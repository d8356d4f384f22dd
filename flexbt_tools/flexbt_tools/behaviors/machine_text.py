# SPDX-License-Identifier: BSD-3-Clause
"""The state machine of a behavior as text and as JSON, and what the text of a synthesized one says of its states."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import yaml

from flexbt_core.state_machine import AUTONOMY_NAMES, MachineDefinition, StructureEntry, Transition
from flexbt_core.values import one_line

from .built_behavior import BuiltBehavior

_INDENT = '  '
_REASON: Final = re.compile(r'    (?! )(.+?):  # (.+)')


def machine_lines(behavior: BuiltBehavior) -> Iterator[str]:
    """A line for each state, and one for each of its outcomes."""
    assert behavior.machine is not None
    yield one_line(f'{behavior.name}: {", ".join(behavior.machine.outcomes)}')
    nodes = zip(behavior.machine.nodes(), behavior.machine.structure(), strict=True)
    for node, entry in list(nodes)[1:]:
        margin = _INDENT * node.path.count('/')
        kind = '' if entry.kind.name == 'STATE' else f'  {entry.kind.name.lower()}'
        yield one_line(f'{margin}{node.label}  ({entry.type_name}){kind}')
        for outcome, transition in node.transitions.items():
            yield one_line(f'{margin}{_INDENT}{outcome}{_target(transition)}{_autonomy(transition)}')
        for condition in node.conditions if isinstance(node, MachineDefinition) else ():
            ended = ', '.join(f'{label}: {outcome}' for label, outcome in condition.children)
            yield one_line(f'{margin}{_INDENT}{condition.outcome} when {ended}')


def _target(transition: Transition) -> str:
    if transition.state is not None:
        return f' -> {transition.state}'
    return f' -> ={transition.outcome}' if transition.outcome is not None else ''


def _autonomy(transition: Transition) -> str:
    return f'  [{AUTONOMY_NAMES[transition.autonomy]}]' if transition.autonomy > 0 else ''


def structure_as_json(entry: StructureEntry) -> dict[str, object]:
    """A node with the fields of flexbt_msgs/msg/StateStructure."""
    return {
        'path': entry.path,
        'kind': entry.kind.name.lower(),
        'type': entry.type_name,
        'children': entry.children,
        'outcomes': entry.outcomes,
        'targets': entry.targets,
        'autonomy': entry.autonomy,
    }


def reasons(text: str) -> dict[str, str]:
    """Return why each state is there, by its name, from the text (YAML) of a synthesized machine.

    :func:`flexbt_formal.synthesis.machines.machine_as_yaml` writes it as a comment behind the name.
    """
    found = (_REASON.fullmatch(line) for line in text.splitlines())
    return {str(yaml.safe_load(match[1])): match[2] for match in found if match is not None}
