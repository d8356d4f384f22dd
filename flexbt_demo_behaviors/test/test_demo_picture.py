# SPDX-License-Identifier: BSD-3-Clause
"""The summary picture: every layer is drawn where the map says."""

from pathlib import Path

import numpy as np
from PIL import Image

from flexbt_demo_behaviors.demonstration import (
    DRIVEN,
    NOT_REACHED,
    PLANNED,
    REACHED,
    START,
    DemoPicture,
    GoalMark,
    MapImage,
    draw_picture,
    write_picture,
)


def picture(**changes: object) -> DemoPicture:
    cells = np.zeros((40, 80), dtype=np.int8)
    cells[:, 0] = 100
    cells[20:, 60:] = -1
    values: dict[str, object] = {
        'title': 'A title',
        'map': MapImage(cells, resolution=0.1, origin=(-4.0, -2.0)),
        'start': (-3.0, -1.0),
        'planned': [[(-3.0, -1.0), (0.0, -1.0)], [(0.0, -1.0), (0.0, 1.0)]],
        'driven': [(-3.0, -0.8), (-1.0, -0.8)],
        'goals': [GoalMark('A', 0.0, 1.0, 1.57, True), GoalMark('B', 2.0, -1.5, 0.0, False)],
    }
    return DemoPicture(**{**values, **changes})  # type: ignore[arg-type]


def count(image: Image.Image, color: tuple[int, int, int]) -> int:
    return int((np.asarray(image) == color).all(axis=2).sum())


def test_every_layer_is_there() -> None:
    whole = draw_picture(picture())
    bare = draw_picture(picture(planned=[], driven=[], goals=[]))
    for color in (PLANNED, DRIVEN, REACHED, NOT_REACHED):
        assert count(whole, color) > count(bare, color) + 100
    assert count(whole, START) > 100


def test_points_lie_where_the_map_has_them() -> None:
    image = np.asarray(
        draw_picture(picture(planned=[], goals=[], start=(-30.0, 0.0), driven=[(-3.9, 1.9), (3.9, 1.9)]))
    )
    legend = 60  # rows at the bottom
    rows, columns = np.nonzero((image[:-legend] == DRIVEN).all(axis=2))
    unknown_rows, unknown_columns = np.nonzero((image[:-legend] == (206, 212, 218)).all(axis=2))
    assert rows.size > 0
    # The line runs along the top edge of the map: y points up. The unknown quarter is at the top right.
    assert rows.max() < 80
    assert columns.max() - columns.min() > 0.9 * 7.8 / 8.0 * 900
    assert unknown_rows.min() <= rows.min()
    assert unknown_columns.min() > image.shape[1] / 2


def test_it_is_written_as_a_small_png(tmp_path: Path) -> None:
    file = tmp_path / 'new' / 'demo.png'
    write_picture(picture(), file)
    with Image.open(file) as image:
        assert image.format == 'PNG'
    assert file.stat().st_size < 60_000
