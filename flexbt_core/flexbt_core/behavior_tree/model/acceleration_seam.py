# SPDX-License-Identifier: BSD-3-Clause
"""The one seam by which ``acceleration/`` puts faster classes in the place of plain ones.

The engine asks :func:`acceleration` wherever it makes an object for which there may be a faster class. What is
installed has to do what the plain class does, only sooner; without it, everything works as the plain classes say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

T = TypeVar('T')


class Acceleration:
    """What may be faster. This one leaves everything as it is."""

    def class_of(self, plain: type[T]) -> type[T]:
        """The class to make objects of in the place of ``plain``."""
        return plain

    def node_class(self, plain: type[T], observers: Sequence[Callable[..., None]]) -> type[T]:
        """The class of a node without conditions, in a tree with these observers."""
        return plain

    def fit(self, nodes: Iterable[Any]) -> None:
        """Gives nodes of one tree the class that suits its observers and their conditions."""

    def prepare(self, node_classes: Iterable[type[Any]]) -> None:
        """Does now what the first observed tree with nodes of these classes would have to wait for."""


_PLAIN = Acceleration()
_installed = _PLAIN


def acceleration() -> Acceleration:
    """What is installed."""
    return _installed


def install(acceleration: Acceleration | None) -> None:
    """For all that is made from now on; None: the plain classes."""
    global _installed
    _installed = _PLAIN if acceleration is None else acceleration
