# SPDX-License-Identifier: BSD-3-Clause
"""A behavior as text, as JSON and as a picture."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

from flexbt_common.pictures.machine_picture import DrawnState, DrawnTree, MachineBox, machine_graph
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES
from flexbt_core.state_machine.model.definition import MachineDefinition, StructureEntry, Transition
from flexbt_core.values.text import one_line
from flexbt_tools.trees.outline import drawn_nodes, items_of

from .built_behavior import BuiltBehavior, UsedTrees

_INDENT = '  '
_REASON: Final = re.compile(r"""    ["']?([^ "'].*?)["']?:  # (.+)""")


def machine_lines(behavior: BuiltBehavior) -> Iterator[str]:
    """Yield a line for each state, and one for each of its outcomes."""
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


def structure_as_json(entry: StructureEntry) -> dict[str, Any]:
    """Return a node with the fields of flexbt_msgs/msg/StateStructure."""
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
    """Return the reason for each state, by its name, from the text (YAML) of a synthesized machine.

    :func:`machine_as_yaml` writes the reason as a comment after the name.
    """
    found = (_REASON.fullmatch(line) for line in text.splitlines())
    return {match[1]: match[2] for match in found if match is not None}


# The parts of a behavior in a picture: its state machine, and the trees that its states run.

_NO_TREES: Final = UsedTrees()
_NO_REASONS: Final[Mapping[str, str]] = {}


def graph_of(
    machine: MachineDefinition,
    trees: UsedTrees = _NO_TREES,
    *,
    expand: bool,
    ports: str,
    reasons: Mapping[str, str] = _NO_REASONS,
) -> MachineBox:
    """Return the graph of a machine. With ``expand``, sub-trees are drawn in place.

    ``reasons`` maps names of states of the machine to the reason for each. ``ports`` as in :meth:`Item.attributes`.
    """
    drawn = {
        use.path: DrawnTree(use.key.id, drawn_nodes(items_of(trees.library, use.key, expand=expand), ports))
        for use in trees.uses
        if use.key is not None
    }
    return machine_graph(
        [
            DrawnState(**structure_as_json(entry), tree=drawn.get(entry.path), why=_why(entry.path, reasons))
            for entry in machine.structure()
        ]
    )


def _why(path: str, reasons: Mapping[str, str]) -> list[str]:
    """Return the reasons for a state of the machine itself, without those that repeat its name."""
    _, _, label = path.rpartition('/')
    return (
        [line for line in reasons.get(label, '').split('; ') if line not in ('', label)] if path.count('/') == 1 else []
    )
