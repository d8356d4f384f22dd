# SPDX-License-Identifier: BSD-3-Clause
"""Classes that are made of the classes of nodes: each once, for as long as the class exists of which it is made."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

_KEPT: Final = '_derived_classes'


def kept_by_class(make: Callable[..., type[Any]]) -> Callable[..., type[Any]]:
    """As functools.cache, for a function that derives from the class that is its first argument: what it makes goes
    with that class, where a proof or a reload has made one for a time only."""

    @functools.wraps(make)
    def made(plain: type[Any], *rest: Any) -> type[Any]:
        known = plain.__dict__.get(_KEPT)
        if known is None:
            known = {}
            setattr(plain, _KEPT, known)
        found: type[Any] | None = known.get((make, rest))
        return found or known.setdefault((make, rest), make(plain, *rest))

    return made
