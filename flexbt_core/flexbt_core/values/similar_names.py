# SPDX-License-Identifier: BSD-3-Clause
"""Names that are not known, and what may have been meant."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

_LONGEST: Final = 100
_MOST: Final = 20


def hint(name: str, known: Collection[str]) -> str:
    """What may have been meant by a name that is not known."""
    import difflib  # rarely needed

    # The comparison takes quadratic time, and hostile files have long names.
    near = difflib.get_close_matches(str(name), list(known), n=1) if len(str(name)) <= _LONGEST else []
    if near:
        return f"; did you mean '{near[0]}'?"
    more = f', and {len(known) - _MOST} more' if len(known) > _MOST else ''
    return f' ({", ".join(sorted(known)[:_MOST])}{more})' if known else ''
