# SPDX-License-Identifier: BSD-3-Clause
"""Files of text: what is one is read, whatever else a name may mean is refused at once and with its reason; what is
written is there as a whole, or not at all."""

from __future__ import annotations

import os
import resource
import stat
import threading
from pathlib import Path

import pytest

from flexbt_core.values.text_files import TextFileError, open_private, open_regular, read_text, write_text


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
        ('latin', 'byte 2 is not UTF-8'),
    ],
)
def test_what_is_no_text_is_refused_with_its_reason(tmp_path: Path, name: str, why: str) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('link')
    (tmp_path / 'long').write_bytes(bytes(9))
    (tmp_path / 'latin').write_bytes(b'a\xe4')
    with pytest.raises(TextFileError, match=why):
        read_text(tmp_path / name, 8)


def test_what_does_not_fit_onto_the_disk_leaves_the_file_that_was_there_and_no_other(tmp_path: Path) -> None:
    file = tmp_path / 'text'
    write_text(file, 'old')
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(OSError, match=rf'File too large: .{file}'):
            write_text(file, 'new' * 100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (list(tmp_path.iterdir()), file.read_text()) == ([file], 'old')
    with pytest.raises(UnicodeEncodeError):
        write_text(file, '\ud800')
    assert (list(tmp_path.iterdir()), file.read_text()) == ([file], 'old')
    for wrong in (tmp_path / 'no' / 'text', file / 'text', tmp_path):
        with pytest.raises(OSError, match=rf': .{wrong}.$'):
            write_text(wrong, 'new')


def test_permissions_and_links_last_and_what_is_no_file_is_written_to(tmp_path: Path) -> None:
    for name in ('file', 'link', 'new', 'later'):  # both links lead to names, the last to one that is not there yet
        if name in ('link', 'later'):
            (tmp_path / name).symlink_to('file' if name == 'link' else 'target')
        write_text(tmp_path / name, name)
        if name == 'file':
            (tmp_path / 'file').chmod(0o604)
    assert [(tmp_path / name).read_text() for name in ('file', 'new', 'target')] == ['link', 'new', 'later']
    assert (tmp_path / 'link').is_symlink() and (tmp_path / 'later').is_symlink()
    assert stat.S_IMODE((tmp_path / 'file').stat().st_mode) == 0o604
    os.mkfifo(tmp_path / 'pipe')
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append((tmp_path / 'pipe').read_text()))
    reader.start()
    write_text(tmp_path / 'pipe', 'through')
    reader.join()
    write_text('/dev/null', 'away')
    assert heard == ['through'] and Path('/dev/null').is_char_device()


def test_an_opener_refuses_what_is_no_file_and_never_waits(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    for name in (pipe, '/dev/zero', tmp_path):
        with pytest.raises(TextFileError, match='give a regular file'):
            open_regular(name, os.O_RDONLY)
    with pytest.raises(OSError):
        open_private(pipe, os.O_WRONLY | os.O_CREAT)  # nobody reads it


def test_a_private_file_is_for_the_user_alone_and_no_link_is_followed(tmp_path: Path) -> None:
    with open(tmp_path / 'new', 'w', opener=open_private) as new:
        assert os.fstat(new.fileno()).st_mode & 0o777 == 0o600
    (tmp_path / 'link').symlink_to(tmp_path / 'new')
    with pytest.raises(OSError):
        open_private(tmp_path / 'link', os.O_WRONLY)
