# SPDX-License-Identifier: BSD-3-Clause
"""What of a run is paused: all of it by the operator, or what is apart from a priority container that is active."""

from __future__ import annotations

from flexbt_core.state_machine.model import are_apart, is_inside


class Pausing:
    """Of one run, by the paths of its states and machines.

    ``priority`` is the path of the priority container for which everything else is paused. ``has_changed`` until the
    states have been told.
    """

    __slots__ = ('_containers', 'has_changed', 'is_paused', 'priority')

    def __init__(self) -> None:
        self.is_paused = False
        self.priority: str | None = None
        self.has_changed = False
        self._containers: list[str] = []  # priority containers that are active, each inside the one before

    def set_paused(self, is_paused: bool) -> None:
        """Pause everything, or let it go on."""
        self.is_paused = is_paused
        self.has_changed = True

    def give_priority(self, path: str) -> None:
        """Pause everything that is apart from a priority container."""
        self._set_containers([*self._containers, path])

    def release(self, path: str) -> None:
        """Nothing of what is in a state or machine has priority any more."""
        if self._containers:
            self._set_containers([one for one in self._containers if not is_inside(one, path)])

    def holds(self, path: str) -> bool:
        """Whether a state or machine is to be paused."""
        return self.is_paused or (self.priority is not None and are_apart(path, self.priority))

    def _set_containers(self, containers: list[str]) -> None:
        self._containers = containers
        priority = containers[-1] if containers else None
        if priority != self.priority:
            self.priority = priority
            self.has_changed = True
