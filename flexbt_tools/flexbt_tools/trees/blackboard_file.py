# SPDX-License-Identifier: BSD-3-Clause
"""Files with what is on a blackboard, see ``behavior_tree.blackboard_json``. ROS messages are known where ROS is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from flexbt_core.behavior_tree import (
    Blackboard,
    BlackboardError,
    JsonTypes,
    NodeRegistry,
    export_blackboard,
    import_blackboard,
)
from flexbt_core.values import load_json, read_text, write_text
from flexbt_tools.errors import UsageError


def json_types(registry: NodeRegistry) -> JsonTypes:
    """What may be in the files: what is registered, and messages where there is ROS."""
    try:
        from flexbt_server.trees import RosJsonTypes
    except ImportError:
        return registry.json_types
    return RosJsonTypes(registry.json_types)


class BlackboardFile:
    """The content of a file; without a name, nothing. Raises UsageError when it cannot be read."""

    def __init__(self, name: str | None = None, types: JsonTypes | None = None) -> None:
        self._name = name
        self._types = types if types is not None else JsonTypes()
        self._document: Mapping[str, Any] = {}
        if name is None:
            return
        try:
            document = load_json(read_text(name))
        except (OSError, ValueError, RecursionError) as error:
            raise UsageError(f'--blackboard {name}: {error}') from error
        if not isinstance(document, dict):
            raise UsageError(f'--blackboard {name}: expected an object, {{"key": value}}')
        self._document = document

    def fill_text(self, board: Blackboard) -> None:
        """Writes what a tree may need to be made: text, which fixes no type."""
        self._write(board, {key: value for key, value in self._document.items() if isinstance(value, str)})

    def fill(self, board: Blackboard) -> None:
        """Writes everything. Raises UsageError when something is not understood, or does not fit."""
        self._write(board, self._document)

    def _write(self, board: Blackboard, document: Mapping[str, Any]) -> None:
        try:
            import_blackboard(board, document, self._types)
        except BlackboardError as error:
            raise UsageError(f'--blackboard {self._name}: {error}') from error


def save_blackboard(board: Blackboard, name: str, types: JsonTypes) -> list[str]:
    """Writes a file as a whole; gives what could not be saved. Raises UsageError when the file cannot be written."""
    document, problems = export_blackboard(board, types)
    try:
        write_text(name, json.dumps(document, indent=2, allow_nan=False) + '\n')
    except OSError as error:
        raise UsageError(f'--save-blackboard {name}: {error}') from error
    return problems
