# SPDX-License-Identifier: BSD-3-Clause
"""State machines and trees as pictures: Graphviz's language, Mermaid's, and SVG with a legend. Needs no ROS."""

from .graphviz import LAYOUT_SECONDS, graphviz_command, svg
from .machine_graph import DrawnState, DrawnTree, MachineBox, StateBox, machine_graph
from .machine_picture import machine_as_dot, machine_as_mermaid
from .markup import STYLE, dot_text, finished, fitted, mermaid_text
from .region_picture import DrawnMove, DrawnRegion, regions_as_dot, regions_as_mermaid
from .sequence_picture import Arrow, Note, SequenceDiagram, sequence_as_mermaid, sequence_as_svg
from .tree_picture import DrawnNode, NodeShape, trees_as_dot, trees_as_mermaid

__all__ = [
    'LAYOUT_SECONDS',
    'STYLE',
    'Arrow',
    'DrawnMove',
    'DrawnNode',
    'DrawnRegion',
    'DrawnState',
    'DrawnTree',
    'MachineBox',
    'NodeShape',
    'Note',
    'SequenceDiagram',
    'StateBox',
    'dot_text',
    'finished',
    'fitted',
    'graphviz_command',
    'machine_as_dot',
    'machine_as_mermaid',
    'machine_graph',
    'mermaid_text',
    'regions_as_dot',
    'regions_as_mermaid',
    'sequence_as_mermaid',
    'sequence_as_svg',
    'svg',
    'trees_as_dot',
    'trees_as_mermaid',
]
