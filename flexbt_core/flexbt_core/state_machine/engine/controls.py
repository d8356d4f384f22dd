# SPDX-License-Identifier: BSD-3-Clause
"""Operator settings of a run (autonomy, locks, breakpoints), and which parts of the run are paused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from flexbt_core.state_machine.model.autonomy import is_autonomous
from flexbt_core.state_machine.model.definition import ROOT_PATH, MachineDefinition, are_apart, is_inside


class Step(NamedTuple):
    """A step from a state or machine: ``how`` is 'into', 'over' or 'out'. The next transition that it holds ends it."""

    how: str
    path: str

    def holds(self, path: str) -> bool:
        """Return whether the transition out of ``path`` is held: of any node, of one that is not nested deeper, or of
        one that is less nested."""
        return self.how == 'into' or path.count('/') + (self.how == 'out') <= self.path.count('/')

    def __str__(self) -> str:
        return f'{self.how} {self.path}'

    @classmethod
    def of(cls, text: str) -> Step | None:
        """Return the step that is written as by ``str``; None for ''."""
        how, _, path = text.partition(' ')
        return cls(how, path) if text else None


STEPS: Final = ('into', 'over', 'out')


class Controls:
    """The operator's settings for one run, by the paths of its states and machines."""

    def __init__(self, definition: MachineDefinition, level: int) -> None:
        self._levels = {node.path: level for node in definition.nodes()}
        self.locked: set[str] = set()
        self.breakpoints: set[str] = set()
        self.step: Step | None = None
        """The step that is under way: each transition that it holds waits for the operator."""

    def __contains__(self, path: object) -> bool:
        """Return whether the run has a state or machine at ``path``."""
        return path in self._levels

    def level(self, path: str) -> int:
        """Return the level of a state or machine: the one that was set last for it or for a machine around
        it."""
        return self._levels[path]

    def set_level(self, level: int, top: str) -> None:
        """Set the level of a sub-tree."""
        for path in self._levels:
            if is_inside(path, top):
                self._levels[path] = level

    def levels(self) -> dict[str, int]:
        """Return the level of the root, and of each sub-tree whose level differs from its parent's."""
        return {
            path: level
            for path, level in self._levels.items()
            if path == ROOT_PATH or level != self._levels[_around(path)]
        }

    def may_pass(self, path: str, required: int) -> bool:
        """Return whether the level allows an outcome that requires ``required`` without the operator."""
        is_held = path in self.breakpoints or (self.step is not None and self.step.holds(path))
        return not is_held and is_autonomous(required, self._levels[path])

    def restore(
        self, levels: Mapping[str, int], locked: Iterable[str], breakpoints: Iterable[str], step: Step | None
    ) -> None:
        """Restore the settings of another run of the machine; ``levels`` comes from :meth:`levels`."""
        for path in sorted(levels):  # parents first
            self.set_level(levels[path], path)
        self.locked = set(locked)
        self.breakpoints = set(breakpoints)
        self.step = step

    def move_to(self, definition: MachineDefinition) -> None:
        """Switch to another machine: nodes in both keep their settings, new nodes inherit their parent's level. A step
        goes on."""
        levels: dict[str, int] = {}
        for node in definition.nodes():  # parents first
            around = levels.get(_around(node.path), self._levels[ROOT_PATH])
            levels[node.path] = self._levels.get(node.path, around)
        self._levels = levels
        self.locked &= levels.keys()
        self.breakpoints &= levels.keys()


def _around(path: str) -> str:
    return path.rpartition('/')[0] or ROOT_PATH


# The paused parts of a run: all of it (by the operator), or everything outside an active priority container.


class Pausing:
    """The parts of one run that are paused, by the paths of its states and machines.

    ``priority`` is the path of the priority container that pauses everything else. ``has_changed`` is true until the
    states have been notified.
    """

    __slots__ = ('_containers', 'has_changed', 'is_paused', 'priority')

    def __init__(self) -> None:
        self.is_paused = False
        self.priority: str | None = None
        self.has_changed = False
        self._containers: list[str] = []  # active priority containers, each inside the previous one

    def set_paused(self, is_paused: bool) -> None:
        """Pause or resume everything."""
        self.is_paused = is_paused
        self.has_changed = True

    def give_priority(self, path: str) -> None:
        """Pause everything outside a priority container."""
        self._set_containers([*self._containers, path])

    def release(self, path: str) -> None:
        """End the priority of everything in a state or machine."""
        if self._containers:
            self._set_containers([one for one in self._containers if not is_inside(one, path)])

    def holds(self, path: str) -> bool:
        """Return whether a state or machine must be paused."""
        return self.is_paused or (self.priority is not None and are_apart(path, self.priority))

    def _set_containers(self, containers: list[str]) -> None:
        self._containers = containers
        priority = containers[-1] if containers else None
        if priority != self.priority:
            self.priority = priority
            self.has_changed = True
