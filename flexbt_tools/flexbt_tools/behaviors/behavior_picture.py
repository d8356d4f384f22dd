# SPDX-License-Identifier: BSD-3-Clause
"""What of a behavior is drawn: its state machine, and the trees that its states run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flexbt_common.pictures import DrawnState, DrawnTree, MachineBox, machine_graph
from flexbt_core.state_machine import MachineDefinition
from flexbt_tools.trees import drawn_nodes, items_of

from .used_trees import UsedTrees

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
    """The graph of a machine; with ``expand`` sub-trees stand in their place.

    ``reasons`` say why states of the machine are there, by their names. ``ports`` as in
    :meth:`flexbt_tools.trees.Item.attributes`.
    """
    drawn = {
        use.path: DrawnTree(use.key.id, drawn_nodes(items_of(trees.library, use.key, expand=expand), ports))
        for use in trees.uses
        if use.key is not None
    }
    return machine_graph(
        [
            DrawnState(
                entry.path,
                entry.kind.name.lower(),
                entry.type_name,
                entry.children,
                entry.outcomes,
                entry.targets,
                entry.autonomy,
                drawn.get(entry.path),
                _why(entry.path, reasons),
            )
            for entry in machine.structure()
        ]
    )


def _why(path: str, reasons: Mapping[str, str]) -> list[str]:
    """Of a state of the machine itself; what its name says already is left out."""
    _, _, label = path.rpartition('/')
    return (
        [line for line in reasons.get(label, '').split('; ') if line not in ('', label)] if path.count('/') == 1 else []
    )
