# SPDX-License-Identifier: BSD-3-Clause
"""What a state wants of the BT server, as it is known before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class BtUse:
    """One use of the BT server.

    ``files`` and ``xml`` are loaded. ``tree`` is run: an identifier, package/relative/path.xml, '' for the server's
    default tree, None when none is run. ``writes`` and ``reads`` are keys of ``blackboard`` ('' is the shared one) with
    their types, from the point of view of the state: it writes before a tree runs, and reads after it.
    """

    files: tuple[str, ...] = ()
    xml: str = ''
    tree: str | None = None
    blackboard: str = ''
    writes: Mapping[str, str] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)


@runtime_checkable
class UsesBtServer(Protocol):
    """A state that uses the BT server; tools find out by this what it needs there."""

    @property
    def bt_use(self) -> BtUse:
        """What it wants of the server."""
