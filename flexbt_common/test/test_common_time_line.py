# SPDX-License-Identifier: BSD-3-Clause
"""A time line as a picture."""

from __future__ import annotations

import re

import pytest

from flexbt_common.pictures.time_line import time_line


@pytest.mark.parametrize('begin', [0.0, 1e5, 1e7])
@pytest.mark.parametrize('seconds', [0.01, 1.0, 1e6])
def test_each_tick_has_its_own_label_however_late_it_is(begin: float, seconds: float) -> None:
    picture = time_line(['of a mission'], [('row', '/row')], [], {}, (begin, begin + seconds), 0.0)
    labels = re.findall(r'>([\d.]+) s</text>', picture)
    assert labels[::2] == labels[1::2], 'above and below'
    assert 5 <= len(set(labels)) == len(labels) // 2
    assert sorted(set(map(float, labels))) == [float(label) for label in labels[::2]]
