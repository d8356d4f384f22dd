# SPDX-License-Identifier: BSD-3-Clause
"""What only makes it faster: scripts as Python code, and nodes whose stores of a status are no calls.

``install()`` puts it into the engine, through the seam ``model/acceleration_seam``. The engine works without this
folder; ``FLEXBT_ACCELERATION=0`` leaves it out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeVar

from flexbt_core.behavior_tree.engine import Conditions
from flexbt_core.behavior_tree.model import acceleration_seam
from flexbt_core.behavior_tree.script import BoundScript, CompiledScript
from flexbt_core.behavior_tree.status_log import LogReader

from .compact_log import CompactLogReader
from .node_classes import class_for, fit, logging_class
from .specialized_conditions import SpecializedConditions
from .specialized_scripts import SpecializedBoundScript, SpecializedScript

T = TypeVar('T')

_FASTER: Final[dict[type[Any], type[Any]]] = {
    BoundScript: SpecializedBoundScript,
    CompiledScript: SpecializedScript,
    Conditions: SpecializedConditions,
    LogReader: CompactLogReader,
}


class Accelerated(acceleration_seam.Acceleration):
    """Faster classes for all that there are some for."""

    def class_of(self, plain: type[T]) -> type[T]:
        return _FASTER.get(plain, plain)

    def node_class(self, plain: type[T], observers: Sequence[Callable[..., None]]) -> type[T]:
        return class_for(plain, observers, None)

    def fit(self, nodes: Iterable[Any]) -> None:
        for node in nodes:
            fit(node)

    def prepare(self, node_classes: Iterable[Any]) -> None:
        for node_class in node_classes:
            logging_class(node_class, False)


def install() -> None:
    """Makes faster what is made from now on."""
    acceleration_seam.install(Accelerated())


__all__ = ['Accelerated', 'install']
