# SPDX-License-Identifier: BSD-3-Clause
"""Draws the map ``rooms``: a flat of 12 by 9 m with rooms, doors and a narrow passage. Deterministic."""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image, ImageDraw

WIDTH, HEIGHT = 12.0, 9.0  # m
RESOLUTION = 0.05  # m per pixel
WALL = 0.15  # m

# Walls as x0, y0, x1, y1 in m from the lower left corner of the flat.
WALLS = (
    (0.0, 0.0, 12.0, WALL),
    (0.0, 9.0 - WALL, 12.0, 9.0),
    (0.0, 0.0, WALL, 9.0),
    (12.0 - WALL, 0.0, 12.0, 9.0),
    # South rooms, below the corridor: office and kitchen, each with a door of 1 m.
    (0.0, 3.4, 2.2, 3.4 + WALL),
    (3.2, 3.4, 8.0, 3.4 + WALL),
    (9.0, 3.4, 12.0, 3.4 + WALL),
    (5.6, 0.0, 5.6 + WALL, 2.3),
    (5.6, 3.2, 5.6 + WALL, 3.4 + WALL),
    # North rooms, above the corridor: workshop, store behind the narrow passage, and lounge.
    (0.0, 5.4, 1.4, 5.4 + WALL),
    (2.4, 5.4, 6.4, 5.4 + WALL),
    (7.2, 5.4, 9.6, 5.4 + WALL),
    (10.6, 5.4, 12.0, 5.4 + WALL),
    (4.4, 5.4, 4.4 + WALL, 9.0),
    (8.6, 5.4, 8.6 + WALL, 9.0),
    # The narrow passage into the store: two walls, 0.8 m apart, 1.2 m long.
    (6.25, 5.4, 6.4, 6.6),
    (7.2, 5.4, 7.35, 6.6),
    # Furniture.
    (1.0, 0.9, 2.2, 1.6),
    (7.4, 1.2, 8.6, 1.9),
    (10.6, 0.15, 11.85, 1.0),
    (1.6, 7.2, 2.8, 7.9),
    (10.2, 7.4, 11.0, 8.2),
    (5.0, 4.3, 5.4, 4.7),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('directory', nargs='?', type=Path, default=Path(__file__).parent, help='instead of %(default)s')
    size = (round(WIDTH / RESOLUTION), round(HEIGHT / RESOLUTION))
    image = Image.new('L', size, 254)
    draw = ImageDraw.Draw(image)
    for x0, y0, x1, y1 in WALLS:
        left, right = round(x0 / RESOLUTION), round(x1 / RESOLUTION) - 1
        top, bottom = size[1] - round(y1 / RESOLUTION), size[1] - round(y0 / RESOLUTION) - 1
        draw.rectangle((left, top, right, bottom), fill=0)
    image.save(parser.parse_args().directory / 'rooms.png', optimize=True)


if __name__ == '__main__':
    main()
