# SPDX-License-Identifier: BSD-3-Clause
"""Map files: what map_server's fields mean, and that no damaged file gets past them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from flexbt_sim.errors import MapError
from flexbt_sim.occupancy_map import FREE, OCCUPIED, UNKNOWN, load_map

GOOD = {
    'image': 'map.png',
    'resolution': '0.05',
    'origin': '[-1.0, -2.0, 0.5]',
    'negate': '0',
    'occupied_thresh': '0.65',
    'free_thresh': '0.196',
}
STOCK = Path(__file__).parents[3] / 'shared' / 'data'


def write(directory: Path, picture: bytes | Image.Image, name: str = 'map.png', **fields: str | None) -> Path:
    """A map in a directory; a field that is None is left out."""
    if isinstance(picture, Image.Image):
        picture.save(directory / name)
    else:
        (directory / name).write_bytes(picture)
    content = GOOD | {'image': name} | fields
    file = directory / 'map.yaml'
    file.write_text(''.join(f'{key}: {value}\n' for key, value in content.items() if value is not None))
    return file


def grey(*rows: list[int]) -> Image.Image:
    return Image.fromarray(numpy.array(rows, numpy.uint8))


def test_thresholds_and_directions(tmp_path: Path) -> None:
    """Dark is occupied; the first row of the image is the top of the map."""
    world = load_map(write(tmp_path, grey([0, 254], [128, 205])))
    assert world.cells.tolist() == [[UNKNOWN, UNKNOWN], [OCCUPIED, FREE]]
    assert world.resolution == 0.05
    assert world.origin == (-1.0, -2.0, 0.5)
    negated = load_map(write(tmp_path, grey([0, 254], [128, 205]), negate='1'))
    assert negated.cells.tolist() == [[UNKNOWN, OCCUPIED], [FREE, OCCUPIED]]


@given(st.lists(st.integers(0, 255), min_size=1, max_size=16), st.booleans())
def test_modes_by_the_formulas_of_map_server(
    tmp_path_factory: pytest.TempPathFactory, values: list[int], negate: bool
) -> None:
    directory = tmp_path_factory.mktemp('map')
    flag = str(int(negate))
    raw = load_map(write(directory, grey(values), mode='raw', negate=flag)).cells[0]
    trinary = load_map(write(directory, grey(values), mode='trinary', negate=flag)).cells[0]
    scale = load_map(write(directory, grey(values), mode='scale', negate=flag)).cells[0]
    for index, value in enumerate(values):
        probability = value / 255.0 if negate else (255 - value) / 255.0
        assert raw[index] == (value if value <= 100 else UNKNOWN)
        if probability > 0.65:
            assert trinary[index] == scale[index] == OCCUPIED
        elif probability < 0.196:
            assert trinary[index] == scale[index] == FREE
        else:
            assert trinary[index] == UNKNOWN
            assert abs(scale[index] - (1 + 98 * (probability - 0.196) / (0.65 - 0.196))) <= 0.51


def test_transparency_is_unknown_in_scale_mode(tmp_path: Path) -> None:
    image = Image.fromarray(numpy.array([[[128, 255], [128, 128]]], numpy.uint8))
    assert image.mode == 'LA'
    assert load_map(write(tmp_path, image, mode='scale')).cells[0, 1] == UNKNOWN
    assert load_map(write(tmp_path, image, mode='scale')).cells[0, 0] != UNKNOWN


@pytest.mark.parametrize(
    'image',
    [
        b'P2\n# by hand\n2 1\n255\n0 254\n',
        b'P5\n2 1\n255\n\x00\xfe',
        b'P5\n2 1\n65535\n\x00\x00\xfe\x00',
        b'P2\n2 1\n15\n0 15\n',
        b'P3\n2 1\n255\n0 0 0 254 254 254\n',
    ],
    ids=['plain', 'binary', '16 bit', 'other maximum', 'colour'],
)
def test_portable_images_of_every_kind(tmp_path: Path, image: bytes) -> None:
    assert load_map(write(tmp_path, image, 'map.pgm')).cells.tolist() == [[OCCUPIED, FREE]]


@pytest.mark.parametrize('mode', ['1', 'L', 'RGB', 'RGBA', 'P', 'I;16'])
def test_png_images_of_every_kind(tmp_path: Path, mode: str) -> None:
    deep = Image.fromarray(numpy.array([[0, 65000]], numpy.uint16))
    image = deep if mode == 'I;16' else grey([0, 254]).convert(mode)
    assert image.mode == mode
    assert load_map(write(tmp_path, image)).cells.tolist() == [[OCCUPIED, FREE]]


@pytest.mark.parametrize('name', ['map.png', 'map.pgm'])
def test_a_shade_of_grey_in_16_bits(tmp_path: Path, name: str) -> None:
    image = Image.fromarray(numpy.array([[0, 32768, 65000]], numpy.uint16))
    assert load_map(write(tmp_path, image, name)).cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('image', None),
        ('image', '[1]'),
        ('image', 'nowhere.png'),
        ('image', '.'),
        ('image', 'map.yaml'),
        ('resolution', None),
        ('resolution', 'fine'),
        ('resolution', '.nan'),
        ('resolution', '.inf'),
        ('resolution', '0'),
        ('resolution', '-0.05'),
        ('resolution', '1' + '0' * 400),
        ('resolution', 'true'),
        ('origin', None),
        ('origin', '[0.0, 0.0]'),
        ('origin', '[0.0, 0.0, .nan]'),
        ('origin', '{x: 1}'),
        ('occupied_thresh', None),
        ('occupied_thresh', '65'),
        ('free_thresh', '0.7'),
        ('free_thresh', '-0.1'),
        ('negate', 'perhaps'),
        ('mode', 'ternary'),
        ('mode', '[trinary]'),
    ],
)
def test_a_bad_field_is_named(tmp_path: Path, field: str, value: str | None) -> None:
    file = write(tmp_path, grey([0, 254]), 'map.png', **{field: value})
    with pytest.raises(MapError) as raised:
        load_map(file)
    assert str(file) in str(raised.value)
    assert raised.value.field == field or field in str(raised.value)


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        '\x00',
        'a: [',
        '- ' * 5_000,
        '[' * 5_000,
        'x: ' + 'y' * 200_000,
        'x: ' + '1' * 5_000,
        '!!python/object:os.x {}',
    ],
)
def test_what_is_no_map_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / 'map.yaml'
    file.write_text(text)
    with pytest.raises(MapError, match=r'map\.yaml'):
        load_map(file)


def test_a_missing_file_and_a_huge_image_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match='nowhere'):
        load_map(tmp_path / 'nowhere.yaml')
    with pytest.raises(MapError, match=r'pixels|decompression'):
        load_map(write(tmp_path, b'P5\n100000 100000\n255\n', 'huge.pgm'))


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_image_is_refused_or_read(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever happens to the bytes of a PNG: a map of the size that it says, or an error that names the file."""
    buffer = io.BytesIO()
    grey(*([0, 254] * 8 for _ in range(16))).save(buffer, 'PNG')
    content = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    try:
        world = load_map(write(tmp_path, bytes(content)))
    except MapError as error:
        assert 'map.png' in str(error)
    else:
        assert world.cells.size > 0


@pytest.mark.skipif(not STOCK.is_dir(), reason='the shared data are not beside the project')
def test_the_stock_map_of_nav2() -> None:
    files = sorted(STOCK.rglob('*.yaml'))
    maps = [load_map(file) for file in files if 'image:' in file.read_text()]
    assert maps
    for world in maps:
        assert world.obstacles.any()
        assert (world.cells == FREE).any()
