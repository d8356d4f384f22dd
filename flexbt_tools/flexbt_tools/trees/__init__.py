# SPDX-License-Identifier: BSD-3-Clause
"""Tree files of this computer: read, listed, described. Needs no ROS."""

from .blackboard_file import BlackboardFile, json_types, save_blackboard
from .files import BY_PACKAGE, STDIN, find_resource, read_library, read_models, shown_name
from .key_usage import EntryUsage, KeyUsage, LostWrite, Place, lost_writes
from .keys import KeyUse, uses
from .outline import PORTS, Item, drawn_nodes, find_tree, is_main, items_of
from .schema import schema_lines
from .stand_ins import UNKNOWN_PORT, OpenRegistry, add_models, is_stand_in
from .tree_order import references, roots, sub_trees_first, used_trees
from .tree_text import tree_as_json, tree_lines

__all__ = [
    'BY_PACKAGE',
    'PORTS',
    'STDIN',
    'UNKNOWN_PORT',
    'BlackboardFile',
    'EntryUsage',
    'Item',
    'KeyUsage',
    'KeyUse',
    'LostWrite',
    'OpenRegistry',
    'Place',
    'add_models',
    'drawn_nodes',
    'find_resource',
    'find_tree',
    'is_main',
    'is_stand_in',
    'items_of',
    'json_types',
    'lost_writes',
    'read_library',
    'read_models',
    'references',
    'roots',
    'save_blackboard',
    'schema_lines',
    'shown_name',
    'sub_trees_first',
    'tree_as_json',
    'tree_lines',
    'used_trees',
    'uses',
]
