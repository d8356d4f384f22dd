# SPDX-License-Identifier: BSD-3-Clause
"""Names that are not known, and what may have been meant."""

from __future__ import annotations

import difflib
from collections.abc import Collection


def hint(name: str, known: Collection[str]) -> str:
    """What may have been meant by a name that is not known."""
    near = difflib.get_close_matches(str(name), list(known), n=1)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f' ({", ".join(sorted(known))})' if known else ''
