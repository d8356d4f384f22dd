# SPDX-License-Identifier: BSD-3-Clause
"""Map files for tests."""

from __future__ import annotations

from pathlib import Path

import numpy
from PIL import Image

GOOD = {
    'image': 'map.png',
    'resolution': '0.05',
    'origin': '[-1.0, -2.0, 0.5]',
    'negate': '0',
    'occupied_thresh': '0.65',
    'free_thresh': '0.196',
}


def write(directory: Path, picture: bytes | Image.Image, name: str = 'map.png', **fields: str | None) -> Path:
    """Return a map in a directory; a field that is None is left out."""
    if isinstance(picture, Image.Image):
        picture.save(directory / name)
    else:
        (directory / name).write_bytes(picture)
    content = GOOD | {'image': name} | fields
    file = directory / 'map.yaml'
    file.write_text(''.join(f'{key}: {value}\n' for key, value in content.items() if value is not None))
    return file


def grey(*rows: list[int]) -> Image.Image:
    """Return an image of 8 bits, the uppermost row first."""
    return Image.fromarray(numpy.array(rows, numpy.uint8))
