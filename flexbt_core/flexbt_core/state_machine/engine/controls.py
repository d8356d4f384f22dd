# SPDX-License-Identifier: BSD-3-Clause
"""What the operator has set for a run: autonomy, locks, breakpoints. It outlives the states that it is about."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from flexbt_core.state_machine.model import ROOT_PATH, MachineDefinition, is_autonomous, is_inside


class Controls:
    """Of one run, by the paths of its states and machines."""

    def __init__(self, definition: MachineDefinition, level: int) -> None:
        self._levels = {node.path: level for node in definition.nodes()}
        self.locked: set[str] = set()
        self.breakpoints: set[str] = set()

    def __contains__(self, path: object) -> bool:
        """Whether there is such a state or machine."""
        return path in self._levels

    def level(self, path: str) -> int:
        """The level that holds for a state or machine: the one that was set last for it, or for what is around it."""
        return self._levels[path]

    def set_level(self, level: int, top: str) -> None:
        """Set the level of a sub-tree."""
        for path in self._levels:
            if is_inside(path, top):
                self._levels[path] = level

    def levels(self) -> dict[str, int]:
        """The level of the root, and of each sub-tree that has another one than what is around it."""
        return {
            path: level
            for path, level in self._levels.items()
            if path == ROOT_PATH or level != self._levels[_around(path)]
        }

    def may_pass(self, path: str, required: int) -> bool:
        """Whether a state or machine may be left without the operator, by an outcome that requires a level."""
        return path not in self.breakpoints and is_autonomous(required, self._levels[path])

    def restore(self, levels: Mapping[str, int], locked: Iterable[str], breakpoints: Iterable[str]) -> None:
        """Take over what was set for another run of the machine; ``levels`` is what :meth:`levels` gave."""
        for path in sorted(levels):  # what is around something comes first
            self.set_level(levels[path], path)
        self.locked = set(locked)
        self.breakpoints = set(breakpoints)

    def move_to(self, definition: MachineDefinition) -> None:
        """Hold for another machine: what both have keeps its settings, what is new has those of what is around it."""
        levels: dict[str, int] = {}
        for node in definition.nodes():  # what is around something comes first
            around = levels.get(_around(node.path), self._levels[ROOT_PATH])
            levels[node.path] = self._levels.get(node.path, around)
        self._levels = levels
        self.locked &= levels.keys()
        self.breakpoints &= levels.keys()


def _around(path: str) -> str:
    return path.rpartition('/')[0] or ROOT_PATH
