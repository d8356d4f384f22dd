# SPDX-License-Identifier: BSD-3-Clause
"""Graphs as pictures: Graphviz's language, Mermaid's, and SVG."""

from .graphviz import svg
from .markup import DOT_HEAD, MERMAID_HEAD, dot_text, dot_tree, mermaid_text, mermaid_tree
from .tree_picture import trees_as_dot, trees_as_mermaid

__all__ = [
    'DOT_HEAD',
    'MERMAID_HEAD',
    'dot_text',
    'dot_tree',
    'mermaid_text',
    'mermaid_tree',
    'svg',
    'trees_as_dot',
    'trees_as_mermaid',
]
