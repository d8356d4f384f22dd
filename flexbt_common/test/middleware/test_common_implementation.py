# SPDX-License-Identifier: BSD-3-Clause
"""Each middleware has what it has, and what a process lacks is told in one line."""

from __future__ import annotations

from typing import Final

import pytest
from rclpy.utilities import get_rmw_implementation_identifier

from flexbt_common.middleware import fastdds, implementation
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import CYCLONE_DDS, ZENOH
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received, guid_prefix_of

WRITER: Final = bytes(range(16))
NOT_IGNORED: Final = 'dropped after they arrive'


def use(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Let this process have another middleware, as far as Python can tell."""
    for module in (fastdds, implementation):
        monkeypatch.setattr(module, 'get_rmw_implementation_identifier', lambda: name)


@pytest.mark.parametrize(
    ('name', 'process', 'participant', 'lost'),
    [
        (FAST_DDS, WRITER[:8], WRITER[:12], []),
        (CYCLONE_DDS, WRITER[:12], WRITER[:12], [NOT_IGNORED]),
        (
            ZENOH,
            WRITER,
            UNKNOWN_WRITER,
            ['not been tested', NOT_IGNORED, 'deadlines of calls', 'names are not protected', '1.5 s'],
        ),
        ('rmw_other_cpp', WRITER[:12], WRITER[:12], ['not been tested', NOT_IGNORED]),
    ],
)
def test_what_a_writer_tells_and_what_is_lost(
    monkeypatch: pytest.MonkeyPatch, name: str, process: bytes, participant: bytes, lost: list[str]
) -> None:
    use(monkeypatch, name)
    monkeypatch.setattr(implementation, 'can_ignore', lambda: name == FAST_DDS)
    received = Received(b'', 0, WRITER, 0.0)
    assert (received.process, received.participant, guid_prefix_of(WRITER)) == (process, participant, participant)
    unknown = Received(b'', 0, UNKNOWN_WRITER, 0.0)
    assert (unknown.process, unknown.participant) == (UNKNOWN_WRITER, UNKNOWN_WRITER)
    found = list(implementation.losses())
    assert len(found) == len(lost) and all(part in text for part, text in zip(lost, found, strict=True)), found
    lines: list[str] = []
    implementation.warn_of_losses(lines.append)
    assert [line.partition(': ')[0] for line in lines] == [name] * bool(lost)


def test_a_version_of_fast_dds_that_cannot_ignore_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, FAST_DDS)
    monkeypatch.setattr(fastdds, '_IGNORE', {'libfastdds.so.99': ''})
    (line,) = implementation.losses()
    assert NOT_IGNORED in line


def test_this_process_can_ignore_only_with_fast_dds() -> None:
    assert implementation.implementation() == get_rmw_implementation_identifier()
    assert not fastdds.can_ignore() or implementation.implementation() == FAST_DDS
