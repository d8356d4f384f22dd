# SPDX-License-Identifier: BSD-3-Clause
"""The middleware of this process, and what FlexBT lacks with it (docs/reference/middleware.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from rclpy.utilities import get_rmw_implementation_identifier

from .fastdds import FAST_DDS, can_ignore

CYCLONE_DDS: Final = 'rmw_cyclonedds_cpp'
ZENOH: Final = 'rmw_zenoh_cpp'
_TESTED: Final = (FAST_DDS, CYCLONE_DDS)


def implementation() -> str:
    """Return the name of the middleware of this process, as in RMW_IMPLEMENTATION."""
    name: str = get_rmw_implementation_identifier()
    return name


def has_participants() -> bool:
    """Return whether identifiers of writers begin with that of their participant, as those of DDS do."""
    return implementation() != ZENOH


def losses() -> Iterator[str]:
    """Yield what is weaker than with a known version of Fast DDS."""
    if implementation() not in _TESTED:
        yield 'FlexBT has not been tested with it'
    if not can_ignore():
        yield 'messages of a process that floods are dropped after they arrive, which costs processor time and memory'
    if not has_participants():
        yield 'a server that hangs is noticed only by the deadlines of calls'
        yield 'each publisher has its own message limits, and operator names are not protected'
        yield 'a node that hangs is noticed within 1.5 s instead of 0.5 s'


def warn_of_losses(warn: Callable[[str], object]) -> None:
    """Warn in one line about what this process lacks, if anything. Nodes of a robot do that at their start."""
    if lost := '; '.join(losses()):
        warn(f'{implementation()}: {lost}')
