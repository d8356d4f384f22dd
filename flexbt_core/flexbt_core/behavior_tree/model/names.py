# SPDX-License-Identifier: BSD-3-Clause
"""What nodes, trees and ports may be called."""

from __future__ import annotations

import functools
from typing import Final

# Attributes that any node may have, and which no port can be named after (reference: BehaviorTree.CPP 4).
PRE_POST_ATTRIBUTES: Final = frozenset(
    ('_failureIf', '_successIf', '_skipIf', '_while', '_onHalted', '_onFailure', '_onSuccess', '_post')
)
RESERVED_ATTRIBUTES: Final = PRE_POST_ATTRIBUTES | {'name', 'ID', '_autoremap'}
FORBIDDEN_IN_NAMES: Final = frozenset(' \t\r\n<>&"\'/\\:*?|.')


@functools.lru_cache(1024)
def port_name_problem(name: str) -> str:
    """Why ``name`` cannot name a port; '' when it can."""
    if not name:
        return 'a port name cannot be empty'
    if name in RESERVED_ATTRIBUTES:
        return f"'{name}' is a reserved attribute name"
    if not (name[0].isascii() and name[0].isalpha()):
        return f"port name '{name}' has to begin with a letter"
    return _forbidden_character(name)


def model_name_problem(name: str, allowed: str = '') -> str:
    """Why ``name`` cannot be the ID of a node type; '' when it can. The characters ``allowed`` may be in it."""
    if not name:
        return 'the name of a tree or node type cannot be empty'
    if name in ('Root', 'root'):
        return f"'{name}' is a reserved name"
    return _forbidden_character(name, allowed)


def tree_name_problem(name: str) -> str:
    """Why ``name`` cannot be the ID of a tree; '' when it can.

    It may have blanks between its words: BehaviorTree.CPP up to 4.8 takes them, and MoveIt Pro's trees have them.
    """
    return model_name_problem(name, allowed=' ' if name == name.strip(' ') else '')


def _forbidden_character(name: str, allowed: str = '') -> str:
    for character in name:
        if (character in FORBIDDEN_IN_NAMES or ord(character) < 0x20 or ord(character) == 0x7F) and (
            character not in allowed
        ):
            return f"name '{name}' contains the character {character!r}, which is not allowed there"
    return ''
