# SPDX-License-Identifier: BSD-3-Clause
"""Names that are not known, and what may have been meant."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final

_LONGEST: Final = 100
_MOST: Final = 20


def similar_names(name: str, known: Iterable[str], most: int = 1) -> list[str]:
    """The known names that ``name`` may be a slip of, best first."""
    import difflib  # rarely needed

    # The comparison takes quadratic time, and hostile files have long names.
    return difflib.get_close_matches(name, list(known), n=most) if len(name) <= _LONGEST else []


def hint(name: object, known: Collection[str], otherwise: str | None = None) -> str:
    """What may have been meant by a name that is not known; where nothing is near, ``otherwise``, or what there is."""
    if near := similar_names(str(name), known):
        return f'; did you mean {near[0]!r}?'
    if otherwise is not None:
        return otherwise
    more = f', and {len(known) - _MOST} more' if len(known) > _MOST else ''
    return f' ({", ".join(sorted(known)[:_MOST])}{more})' if known else ''
