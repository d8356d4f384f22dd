# SPDX-License-Identifier: BSD-3-Clause
"""Damaged and hostile map files: one line that names file and field, soon, and whatever the bytes are."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from map_files import GOOD, grey, write
from PIL import Image

from flexbt_sim.errors import MapError
from flexbt_sim.world import load_map
from flexbt_sim.world.plane.occupancy_map import MAX_CELLS
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.waiting import processor_time


def refuse(file: Path) -> MapError:
    """Return the file has to be refused within seconds, in one line of moderate length that names it."""
    began = processor_time()
    with pytest.raises(MapError) as raised:
        load_map(file)
    assert processor_time() - began < 5.0
    text = str(raised.value)
    assert text.startswith(f'{file}: ')
    assert '\n' not in text
    assert len(text) < 1000
    return raised.value


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        *((field, None) for field in GOOD if field != 'negate'),
        *((field, value) for field in GOOD for value in ('[1, 2]', '{x: 1}', '2001-01-01', '')),
        *((field, value) for field in GOOD if field != 'image' for value in ('x', '.nan', '"nan"', '-.inf', '1e400')),
        *((field, '9' * 400) for field in GOOD if field != 'image'),
        *((field, 'true') for field in GOOD if field not in ('image', 'negate')),
        ('image', '7'),
        ('resolution', '0'),
        ('resolution', '-0.05'),
        ('resolution', '1e9'),
        ('resolution', '1e-16'),
        ('origin', '[1e300, 0.0, 0.0]'),
        ('origin', '[0.0, 0.0]'),
        ('origin', '[0.0, 0.0, 0.0, 1.0]'),
        ('origin', '[0.0, 0.0, .nan]'),
        ('origin', '[0.0, true, 0.0]'),
        ('origin', '[0.0, [], 0.0]'),
        ('occupied_thresh', '65'),
        ('occupied_thresh', '0.1'),
        ('free_thresh', '0.7'),
        ('free_thresh', '-0.1'),
        ('negate', '2'),
        ('mode', 'ternary'),
        ('mode', '[trinary]'),
        ('mode', ''),
        ('mode', '1'),
    ],
)
def test_a_bad_field_is_named(tmp_path: Path, field: str, value: str | None) -> None:
    error = refuse(write(tmp_path, grey([0, 254]), 'map.png', **{field: value}))
    assert error.field == field or {error.field, field} == {'free_thresh', 'occupied_thresh'}


@pytest.mark.parametrize('name', ['nowhere.png', '.', '..', 'map.yaml', 'x' * 300, '"a\\0b"', '/dev/zero', 'pipe'])
def test_an_image_that_is_none_is_named(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / 'pipe')
    error = refuse(write(tmp_path, grey([0]), image=name))
    assert error.field == 'image'
    assert name.strip('"').partition('\\')[0] in str(error)


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        'resolution',
        '\x00',
        'a: [',
        'x: &a [*b]',
        *HOSTILE_YAML.values(),
        '[' * 15_000,
        '{a: ' * 5_000,
        'image: ' + ':'.join(['1'] * 9_000),
        'x: ' + 'y' * 200_000,
        'x: ' + '1' * 5_000,
        'x: 2001-99-99',
        'x: !!int abc',
        '? []\n: 1',
        '!!python/object/apply:os.abort []',
    ],
)
def test_what_is_no_map_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / 'map.yaml'
    file.write_text(text)
    refuse(file)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'binary.yaml').write_bytes(bytes(range(256)))
    for file in (tmp_path / 'nowhere.yaml', tmp_path, tmp_path / 'pipe', Path('/dev/zero'), tmp_path / 'binary.yaml'):
        refuse(file)


@pytest.mark.parametrize(
    'image',
    [
        b'P5\n100000 100000\n255\n',
        b'P5\n%d 1\n255\n' % (MAX_CELLS + 1),
        b'P5\n0 5\n255\n',
        b'P5\n-1 5\n255\n',
        b'P5\n2 2\n0\n\x00\x00\x00\x00',
        b'P5\n2 2\n70000\n\x00\x00\x00\x00',
        b'P5\n2 2\n255\n\x00\x00\x00',
        b'P2\n2 2\n255\n1 2 3',
        b'P2\n2 2\n255\n1 2 3 x',
        b'P2\n2 2\n255\n1 2 3 256',
        b'Pf\n1 1\n-1.0\n\x00\x00\xc0\x7f',
        b'P5\n2',
        b'P5',
        b'',
        b'GIF89a\x01\x00\x01\x00\x00\x00\x00;',
    ],
)
def test_an_image_that_contradicts_itself_or_is_huge_is_refused(tmp_path: Path, image: bytes) -> None:
    assert refuse(write(tmp_path, image, 'map.pgm')).field == 'image'


def _encoded(mode: str, kind: str) -> bytes:
    buffer = io.BytesIO()
    Image.linear_gradient('L').resize((16, 16)).convert(mode).save(buffer, kind)
    return buffer.getvalue()


IMAGES = [
    *(_encoded(mode, 'PNG') for mode in ('1', 'L', 'LA', 'RGB', 'RGBA', 'P')),
    *(_encoded(mode, 'PPM') for mode in ('L', 'RGB', 'I')),
    _encoded('L', 'BMP'),
    b'P2\n4 4\n255\n' + b' '.join(b'%d' % number for number in range(16)),
]


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.sampled_from(IMAGES),
    st.lists(st.tuples(st.integers(0, 60), st.binary(max_size=2)), max_size=4),
    st.none() | st.integers(0, 100),
)
def test_whatever_happens_to_an_image_it_is_refused_or_read(
    tmp_path: Path, image: bytes, changes: list[tuple[int, bytes]], length: int | None
) -> None:
    for place, content in changes:  # replaced, inserted or taken out, most of it in the header
        image = image[:place] + content + image[place + 1 :]
    file = write(tmp_path, image[:length], 'map.pgm')
    try:
        world = load_map(file)
    except MapError as error:
        assert error.field == 'image'
    else:
        assert world.cells.size > 0
        assert -1 <= world.cells.min() <= world.cells.max() <= 100
