# SPDX-License-Identifier: BSD-3-Clause
"""Files of text: what is one is read, whatever else a name may mean is refused at once and with its reason."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from flexbt_core.values import TextFileError, read_text


def test_a_text_is_read_with_its_ends_of_lines_and_without_its_mark(tmp_path: Path) -> None:
    (tmp_path / 'text').write_bytes(b'\xef\xbb\xbfa\r\n\xc3\xa4')
    assert read_text(tmp_path / 'text') == 'a\r\nä' == read_text(str(tmp_path / 'text'), 8)


@pytest.mark.parametrize(
    ('name', 'why'),
    [
        ('nowhere', 'No such file'),
        ('pipe', 'pipe or device'),
        ('.', 'directory'),
        ('/dev/zero', 'pipe or device'),
        ('link', 'Too many levels'),
        ('n\0ul', 'null byte'),
        ('n' * 300, 'name too long'),
        ('long', 'longer than 8 bytes'),
        ('latin', 'byte 2 is no UTF-8'),
    ],
)
def test_what_is_no_text_is_refused_with_its_reason(tmp_path: Path, name: str, why: str) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('link')
    (tmp_path / 'long').write_bytes(bytes(9))
    (tmp_path / 'latin').write_bytes(b'a\xe4')
    with pytest.raises(TextFileError, match=why):
        read_text(tmp_path / name, 8)
