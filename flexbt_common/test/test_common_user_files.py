# SPDX-License-Identifier: BSD-3-Clause
"""Files of a user who may have no home directory."""

from __future__ import annotations

import pwd
import tempfile
from pathlib import Path
from typing import NoReturn

import pytest

from flexbt_common.files import USER_DIRECTORY, home_path

TEMPORARY = Path(tempfile.gettempdir())


@pytest.mark.parametrize(
    ('path', 'expected'),
    [
        (USER_DIRECTORY, TEMPORARY / '.ros' / 'flexbt'),
        ('~', TEMPORARY),
        ('~nobody.of.this.name/runs', TEMPORARY / 'runs'),
        ('/var/~/runs', Path('/var/~/runs')),
        ('runs/~', Path('runs/~')),
    ],
)
def test_who_has_no_home_writes_among_temporary_files(
    monkeypatch: pytest.MonkeyPatch, path: str, expected: Path
) -> None:
    def no_account(number: int) -> NoReturn:
        raise KeyError(number)  # as for the number of a user that /etc/passwd does not have

    monkeypatch.delenv('HOME', raising=False)
    monkeypatch.setattr(pwd, 'getpwuid', no_account)
    assert home_path(path) == expected


def test_who_has_a_home_writes_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    assert home_path(USER_DIRECTORY) == tmp_path / '.ros' / 'flexbt'
