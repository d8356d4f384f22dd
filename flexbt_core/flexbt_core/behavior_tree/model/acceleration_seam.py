# SPDX-License-Identifier: BSD-3-Clause
"""The one seam by which ``acceleration/`` puts faster classes in the place of plain ones.

The engine asks :func:`acceleration` wherever it makes an object for which there may be a faster class. What is
installed has to do what the plain class does, only sooner; without it, everything works as the plain classes say.
FLEXBT_ACCELERATION=0 leaves the folder out, as does its absence.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Any, TypeVar

T = TypeVar('T')


class Acceleration:
    """What may be faster. This one leaves everything as it is."""

    def class_of(self, plain: type[T]) -> type[T]:
        """Return the class to make objects of in the place of ``plain``."""
        return plain

    def node_class(self, plain: type[T], observers: Sequence[Callable[..., None]]) -> type[T]:
        """Return the class of a node without conditions, in a tree with these observers."""
        return plain

    def fit(self, nodes: Iterable[Any]) -> None:
        """Give nodes of one tree the class that suits its observers and their conditions."""

    def prepare(self, node_classes: Iterable[type[Any]]) -> None:
        """Do now what the first observed tree with nodes of these classes would have to wait for."""


_PLAIN = Acceleration()
_installed: Acceleration | None = None  # until the first question


def acceleration() -> Acceleration:
    """Return what is installed: on the first call the folder ``acceleration``, if it is there and wanted."""
    global _installed
    if _installed is None:
        _installed = _find()
    return _installed


def _find() -> Acceleration:
    if os.environ.get('FLEXBT_ACCELERATION', '1') == '0':
        return _PLAIN
    package = f'{__package__.rpartition(".")[0]}.acceleration'
    try:
        accelerated: Acceleration = import_module(f'{package}.installation').Accelerated()
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        return _PLAIN
    return accelerated


def install(acceleration: Acceleration | None) -> None:
    """Use this for all that is made from now on; None: the plain classes."""
    global _installed
    _installed = _PLAIN if acceleration is None else acceleration
