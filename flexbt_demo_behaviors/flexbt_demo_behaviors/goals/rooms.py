# SPDX-License-Identifier: BSD-3-Clause
"""The rooms of the flat: their bounds, and the robot's place at the table in each."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Final

from flexbt_common.files import resolve_file
from flexbt_core import Place, load_places
from flexbt_core.values.text import short_repr

ROOMS: Final[Mapping[str, tuple[float, float, float, float]]] = {
    'kitchen': (0.0, 0.0, 4.5, 3.6),
    'office': (4.5, 0.0, 9.0, 3.6),
    'hall': (0.0, 3.6, 9.0, 6.0),
}
"""Minimum and maximum x and y of each room: x0, y0, x1, y1, in m."""


def room_at(x: float, y: float) -> str | None:
    """Return the room that contains a point; None for a point outside all rooms."""
    return next((name for name, (x0, y0, x1, y1) in ROOMS.items() if x0 <= x < x1 and y0 <= y < y1), None)


def table_of(room: str) -> Place:
    """Return the robot's place at the table of a room.

    Raises:
        ValueError: the room does not exist; the message lists the rooms.
    """
    places = _places()
    if room not in places:
        raise ValueError(f'there is no room {short_repr(room)}; there are {", ".join(places)}')
    return places[room]


@functools.cache
def _places() -> Mapping[str, Place]:
    return load_places(resolve_file('flexbt_demo_behaviors/goals/places.yaml'))
