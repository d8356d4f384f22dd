# SPDX-License-Identifier: BSD-3-Clause
"""The time line of an incident: it begins with what happened first, and its axis is above and below the rows."""

from __future__ import annotations

import re

from flexbt_console.mirror.lanes import Lane, LaneEntry
from flexbt_console.recording.incidents import lanes_svg


def test_the_time_before_the_first_entry_is_left_out() -> None:
    entries = [
        LaneEntry(1, Lane.STATES, '/Drive', 'Drive', 480.0, 500.0, 'failed', 'error'),
        LaneEntry(2, Lane.STATES, '/Ask', 'Ask', 500.0, None),
    ]
    picture = lanes_svg(entries, 520.0, 500.0)
    bars = [
        (float(x), float(width))
        for x, width in re.findall(r'<rect class="\w+" x="([\d.]+)" y="\d+" width="([\d.]+)" height="16"', picture)
    ]
    assert len(bars) == 2 and bars[0][1] == bars[1][1] > 400.0 and bars[0][0] < bars[1][0]
    assert picture.count('>-10 s<') == picture.count('>0 s<') == 2
