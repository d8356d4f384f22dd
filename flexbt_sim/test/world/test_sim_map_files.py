# SPDX-License-Identifier: BSD-3-Clause
"""Map files mean what they mean to Nav2's map_server."""

from __future__ import annotations

import math
from pathlib import Path

import numpy
import pytest
from builtin_interfaces.msg import Time
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from map_files import grey, write
from numpy.typing import NDArray
from PIL import Image

from flexbt_common.values.limits import check_limits
from flexbt_sim.errors import MapError
from flexbt_sim.messages import grid_message, map_of
from flexbt_sim.world import FREE, OCCUPIED, UNKNOWN, Pose, load_map

STOCK = Path(__file__).parents[4] / 'shared' / 'data' / 'nav2' / 'maps' / 'tb3_sandbox.yaml'
in_directory = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


def test_the_first_row_of_the_image_is_the_top_of_the_map(tmp_path: Path) -> None:
    world = load_map(write(tmp_path, grey([0, 254], [128, 205])))
    assert world.cells.tolist() == [[UNKNOWN, UNKNOWN], [OCCUPIED, FREE]]
    assert (world.width, world.height, world.resolution, world.origin) == (2, 2, 0.05, (-1.0, -2.0, 0.5))


def test_a_turned_origin_turns_the_map_about_its_lower_left_corner(tmp_path: Path) -> None:
    world = load_map(write(tmp_path, grey([254] * 4, [0] * 4), origin=f'[1.0, 2.0, {math.pi / 2}]', resolution='0.5'))
    assert world.point(0, 0) == pytest.approx((0.75, 2.25))
    assert world.point(1, 3) == pytest.approx((0.25, 3.75))
    assert [world.cell(0.75, 2.25), world.cell(0.25, 3.75)] == [(0, 0), (1, 3)]
    assert world.cells[world.cell(0.75, 3.75)] == OCCUPIED


def test_a_map_of_4000_x_4000_cells_is_read_and_a_message_can_have_it(tmp_path: Path) -> None:
    image = numpy.full((4000, 4000), 254, numpy.uint8)
    image[0] = image[:, 0] = 0
    world = load_map(write(tmp_path, Image.fromarray(image)))
    assert world.cells.shape == (4000, 4000)
    assert (world.cells[-1, 1], world.cells[0, 1]) == (OCCUPIED, FREE)
    message = grid_message(world, 'map', Time())
    check_limits(message)
    assert numpy.array_equal(map_of(message).cells, world.cells)


def test_a_larger_map_is_refused_with_the_bound_and_what_to_do(tmp_path: Path) -> None:
    file = write(tmp_path, b'P5\n4000 4001\n255\n')
    with pytest.raises(MapError, match='4000 x 4001 pixels; a map has 1 to 16000000: a coarser resolution needs fewer'):
        load_map(file)


def by_map_server(shade: int, mode: str, negate: bool, occupied: float, free: float) -> int:
    """One pixel of a grey image, as loadMapFromFile of nav2_map_server (Jazzy) computes it."""
    if mode == 'raw':
        return shade if shade <= 100 else UNKNOWN
    normalized = shade / 255.0 if negate else 1.0 - shade / 255.0
    if normalized <= free:
        return FREE
    if normalized >= occupied:
        return OCCUPIED
    return math.floor((normalized - free) / (occupied - free) * 100.0 + 0.5) if mode == 'scale' else UNKNOWN


@in_directory
@given(
    st.lists(st.integers(0, 255), min_size=1, max_size=16),
    st.sampled_from(['trinary', 'scale', 'raw', 'Scale', 'TRINARY']),
    st.sampled_from(['0', '1', 'true', 'no']),
    st.tuples(st.integers(0, 254), st.integers(0, 254)).filter(lambda pair: pair[0] != pair[1]).map(sorted),
)
def test_modes_negation_and_thresholds(
    tmp_path: Path, shades: list[int], mode: str, negate: str, thresholds: list[int]
) -> None:
    free, occupied = ((threshold + 0.5) / 255.0 for threshold in thresholds)
    file = write(
        tmp_path, grey(shades), mode=mode, negate=negate, free_thresh=repr(free), occupied_thresh=repr(occupied)
    )
    loaded = load_map(file).cells[0]
    for shade, cell in zip(shades, loaded, strict=True):
        expected = by_map_server(shade, mode.lower(), negate in ('1', 'true'), occupied, free)
        # Which way a half is rounded, rests on the last bit.
        share = (shade / 255.0 if negate in ('1', 'true') else 1.0 - shade / 255.0) - free
        is_half = mode.lower() == 'scale' and abs(share / (occupied - free) * 100.0 % 1.0 - 0.5) < 1e-6
        assert abs(cell - expected) <= is_half


def test_a_threshold_itself_is_occupied_or_free(tmp_path: Path) -> None:
    file = write(tmp_path, grey([51, 153, 204]), negate='1', free_thresh='0.2', occupied_thresh='0.8')
    assert load_map(file).cells.tolist() == [[FREE, UNKNOWN, OCCUPIED]]


def test_mode_and_negate_may_be_left_out(tmp_path: Path) -> None:
    world = load_map(write(tmp_path, grey([0, 128, 255]), negate=None, mode=None))
    assert world.cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


@pytest.mark.parametrize('text', ['1e-16', '-1.22465e-16', '5e-2', '"0.05"', '1', '.5', '+1.5', '0.050000'])
def test_numbers_as_yaml_cpp_reads_and_writes_them(tmp_path: Path, text: str) -> None:
    """YAML 1.1, which PyYAML follows, takes 1e-16 for text; map_saver writes such numbers."""
    number = float(text.strip('"'))
    assert load_map(write(tmp_path, grey([0]), origin=f'[{text}, 0, {text}]')).origin == (number, 0.0, number)


@pytest.mark.parametrize('text', ['1e-3', '5e-2', '"0.05"', '1', '.5', '+1.5', '0.050000'])
def test_resolutions_as_yaml_cpp_reads_and_writes_them(tmp_path: Path, text: str) -> None:
    assert load_map(write(tmp_path, grey([0]), resolution=text)).resolution == float(text.strip('"'))


def as_png(cells: NDArray[numpy.int8], mode: str) -> Image.Image:
    """Return what map_saver writes."""
    rows = cells[::-1].astype(int)
    if mode == 'raw':
        return Image.fromarray(numpy.where(rows == UNKNOWN, 255, rows).astype(numpy.uint8))
    shades = numpy.where(rows == UNKNOWN, 205, numpy.rint(255 * (1 - rows / 100))).astype(numpy.uint8)
    if mode == 'trinary':
        return Image.fromarray(shades)
    return Image.fromarray(numpy.dstack([shades, numpy.where(rows == UNKNOWN, 0, 255).astype(numpy.uint8)]))


COORDINATE = st.floats(-1e6, 1e6)


@in_directory
@given(
    st.data(),
    st.integers(1, 12),
    st.integers(1, 12),
    st.sampled_from(['trinary', 'scale', 'raw']),
    st.floats(1e-3, 10.0),
    st.tuples(COORDINATE, COORDINATE, st.floats(-math.pi, math.pi)),
)
def test_what_is_saved_is_loaded(
    tmp_path: Path,
    data: st.DataObject,
    height: int,
    width: int,
    mode: str,
    resolution: float,
    origin: tuple[float, float, float],
) -> None:
    values = st.sampled_from([UNKNOWN, FREE, OCCUPIED]) if mode == 'trinary' else st.integers(UNKNOWN, OCCUPIED)
    row = st.lists(values, min_size=width, max_size=width)
    cells = numpy.array(data.draw(st.lists(row, min_size=height, max_size=height)), numpy.int8)
    thresholds = {} if mode == 'trinary' else {'free_thresh': '0', 'occupied_thresh': '1'}
    picture = as_png(cells, mode)
    name = 'map.png' if picture.mode == 'LA' else data.draw(st.sampled_from(['map.png', 'map.pgm', 'map.bmp']))
    file = write(
        tmp_path, picture, name, mode=mode, resolution=repr(resolution), origin=str(list(origin)), **thresholds
    )
    world = load_map(file)
    assert (world.cells == cells).all()
    assert world.cells.dtype == numpy.int8
    assert (world.resolution, world.origin) == (resolution, Pose(*origin))


@pytest.mark.parametrize(
    'image',
    [
        b'P2\n# by hand\n3 1\n255\n0 128 254\n',
        b'P5\n3 1\n255\n\x00\x80\xfe',
        b'P5\n3 1\n65535\n\x00\x00\x80\x00\xfe\x00',
        b'P2 3 1 1000 0 500 995',
        b'P2\n3 1\n15\n0 8 15\n',
        b'P3\n3 1\n255\n0 0 0 128 128 128 254 254 254\n',
    ],
    ids=['plain', 'binary', '16 bit', '10 bit', '4 bit', 'colour'],
)
def test_portable_images_of_every_kind(tmp_path: Path, image: bytes) -> None:
    assert load_map(write(tmp_path, image, 'map.pgm')).cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


@pytest.mark.parametrize('mode', ['L', 'LA', 'RGB', 'RGBA', 'P', 'I;16'])
def test_png_images_of_every_kind(tmp_path: Path, mode: str) -> None:
    deep = Image.fromarray(numpy.array([[0, 32768, 65000]], numpy.uint16))
    image = deep if mode == 'I;16' else grey([0, 128, 254]).convert(mode)
    assert image.mode == mode
    assert load_map(write(tmp_path, image)).cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


def test_black_and_white(tmp_path: Path) -> None:
    assert load_map(write(tmp_path, grey([0, 255]).convert('1'))).cells.tolist() == [[OCCUPIED, FREE]]


def test_colours_count_by_their_brightness(tmp_path: Path) -> None:
    """ITU-R BT.709: green is bright, blue is dark."""
    image = Image.fromarray(numpy.array([[[0, 255, 0], [255, 0, 0], [0, 0, 255]]], numpy.uint8))
    world = load_map(write(tmp_path, image, mode='scale', free_thresh='0', occupied_thresh='1'))
    assert world.cells.tolist() == [[29, 79, 93]]


@pytest.mark.parametrize('mode', ['LA', 'RGBA', 'P', 'L'])
def test_what_is_not_opaque_is_unknown_except_in_raw_mode(tmp_path: Path, mode: str) -> None:
    image = Image.fromarray(numpy.array([[[0, 255], [0, 254], [255, 0], [50, 255]]], numpy.uint8)).convert(mode)
    if mode in ('P', 'L'):  # one colour of the palette, or one shade, is transparent
        image = grey([0, 7, 7, 50]).convert(mode)
        image.info['transparency'] = 7
    image.save(tmp_path / 'transparent.png')
    for name, opaque in (('trinary', [OCCUPIED, OCCUPIED]), ('scale', [OCCUPIED, OCCUPIED]), ('raw', [0, 50])):
        cells = load_map(write(tmp_path, grey([0]), image='transparent.png', mode=name)).cells[0].tolist()
        assert [cells[0], cells[3]] == opaque
        if name != 'raw':
            assert cells[1:3] == [UNKNOWN, UNKNOWN]


def test_an_image_is_named_relative_to_the_file_or_absolutely(tmp_path: Path) -> None:
    maps, images = tmp_path / 'maps', tmp_path / 'images'
    maps.mkdir()
    images.mkdir()
    grey([0]).save(images / 'flat.png')
    for name in ('../images/flat.png', str(images / 'flat.png')):
        assert load_map(write(maps, grey([254]), image=name)).cells.tolist() == [[OCCUPIED]]


@pytest.mark.skipif(not STOCK.exists(), reason="Nav2's map is not beside the project")
def test_the_sandbox_of_nav2() -> None:
    """Its size, its place and its nine columns are those of Nav2's documentation."""
    world = load_map(STOCK)
    assert (world.width, world.height, world.resolution, world.origin) == (384, 384, 0.05, (-10.0, -10.0, 0.0))
    known = numpy.argwhere(world.cells != UNKNOWN)
    assert known.min(axis=0).tolist() == [384 - 1 - 236, 141]
    assert known.max(axis=0).tolist() == [384 - 1 - 132, 254]
    assert all(world.clearance(x, y) < 0.15 for x in (-1.1, 0.0, 1.1) for y in (-1.1, 0.0, 1.1))
    assert all(world.cells[world.cell(x, y)] == FREE for x, y in [(-2.0, -0.5), (0.0, 2.0), (1.78, -0.57)])
