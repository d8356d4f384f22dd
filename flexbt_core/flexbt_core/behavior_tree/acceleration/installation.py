# SPDX-License-Identifier: BSD-3-Clause
"""The faster classes, as the seam ``model/acceleration_seam`` installs them. The engine works without this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeVar

from flexbt_core.behavior_tree.engine.conditions import Conditions
from flexbt_core.behavior_tree.engine.observers import LogReader
from flexbt_core.behavior_tree.model.acceleration_seam import Acceleration
from flexbt_core.behavior_tree.script.interpreter import BoundScript, CompiledScript

from .node_classes import CompactLogReader, class_for, fit, logging_class
from .specialized_scripts import SpecializedBoundScript, SpecializedConditions, SpecializedScript

T = TypeVar('T')

_FASTER: Final[dict[type[Any], type[Any]]] = {
    BoundScript: SpecializedBoundScript,
    CompiledScript: SpecializedScript,
    Conditions: SpecializedConditions,
    LogReader: CompactLogReader,
}


class Accelerated(Acceleration):
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
