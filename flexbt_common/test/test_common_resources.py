# SPDX-License-Identifier: BSD-3-Clause
"""File names that may come from another process: what is found, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexbt_common.errors import ResourceError
from flexbt_common.files import resolve_file


@pytest.fixture
def share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the share directory of a package 'fixture_pkg' in a prefix of its own."""
    prefix = tmp_path / 'prefix'
    index = prefix / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'fixture_pkg').touch()
    share = prefix / 'share/fixture_pkg'
    (share / 'trees').mkdir(parents=True)
    (share / 'trees/main.xml').write_text('<root/>')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    return share


def test_a_file_of_a_package_is_found(share: Path) -> None:
    assert resolve_file('fixture_pkg/trees/main.xml') == share / 'trees/main.xml'


def test_an_absolute_path_needs_an_allowed_directory(tmp_path: Path, share: Path) -> None:
    (tmp_path / 'mine').mkdir()
    tree = tmp_path / 'mine/tree.xml'
    tree.touch()
    assert resolve_file(str(tree), [tmp_path / 'mine']) == tree
    with pytest.raises(ResourceError, match='allowed_directories'):
        resolve_file(str(tree), [tmp_path / 'min'])


@pytest.mark.parametrize(
    ('name', 'fragment'),
    [
        ('', 'not a file name'),
        ('fixture_pkg', 'package/relative/path'),
        ('fixture_pkg/trees/../../../../secret.xml', r'\.\.'),
        ('fixture_pkg/trees/mian.xml', "did you mean 'main.xml'"),
        ('fixture_pkg/trees', 'not a file'),
        ('fixtur_pkg/trees/main.xml', "did you mean 'fixture_pkg'"),
        ('file:///etc/passwd', 'not a file name'),
        ('file:/etc/passwd', 'no installed package'),
        ('../fixture_pkg/trees/main.xml', 'expected package/relative/path or an absolute path'),
        ('./trees/main.xml', 'expected package/relative/path or an absolute path'),
        ('fixture_pkg/trees/main.xml\0.txt', 'not a file name'),
        ('fixture_pkg//trees/main.xml', 'not a file name'),
        ('fixture_pkg//', 'not a file name'),
        ('fixture_pkg/.', 'not a file'),
        ('fixture_pkg/trees/' + 'x' * 300, 'too long'),
        ('fixture_pkg/' + 'x/' * 3000, 'at most 4096'),
        ('x' * 10_000_000, 'at most 4096'),
        ('/' + 'x/' * 500, 'more than 100 directories'),
        ('fixture_pkg/\udcff.xml', 'not a file name'),
    ],
)
def test_refused_with_the_reason(share: Path, name: str, fragment: str) -> None:
    with pytest.raises(ResourceError, match=fragment):
        resolve_file(name)


def test_links_do_not_lead_out(tmp_path: Path, share: Path) -> None:
    outside = tmp_path / 'outside'
    outside.mkdir()
    (outside / 'secret.xml').touch()
    (share / 'linked').symlink_to(outside)
    (share / 'trees/alias.xml').symlink_to(outside / 'secret.xml')
    allowed = tmp_path / 'allowed'
    allowed.mkdir()
    (allowed / 'secret.xml').symlink_to(outside / 'secret.xml')
    for name in ('fixture_pkg/linked/secret.xml', 'fixture_pkg/trees/alias.xml', str(allowed / 'secret.xml')):
        with pytest.raises(ResourceError):
            resolve_file(name, [allowed])


def test_links_that_go_round_in_circles_are_no_files(tmp_path: Path) -> None:
    (tmp_path / 'a.xml').symlink_to(tmp_path / 'b.xml')
    (tmp_path / 'b.xml').symlink_to(tmp_path / 'a.xml')
    (tmp_path / 'directory').symlink_to(tmp_path / 'directory')
    for name in ('a.xml', 'directory/a.xml'):
        with pytest.raises(ResourceError, match='no such file'):
            resolve_file(str(tmp_path / name), [tmp_path])


_PARTS = st.sampled_from(
    ['fixture_pkg', 'trees', 'main.xml', 'linked', 'loop', 'alias.xml', 'allowed', '', '.', '..', '~', '\0', 'a' * 300]
)
_TEXTS = st.lists(_PARTS | st.text(max_size=5), max_size=8).map('/'.join)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=_TEXTS, within=st.sampled_from(['', 'fixture_pkg/', 'fixture_pkg//', '/', '//', 'SHARE/', 'ALLOWED/']))
def test_whatever_the_text_it_leads_to_a_file_inside_or_is_refused(
    tmp_path: Path, share: Path, text: str, within: str
) -> None:
    allowed = tmp_path / 'allowed'
    if not allowed.exists():
        allowed.mkdir()
        (tmp_path / 'secret.xml').touch()
        for place in (share, allowed):
            (place / 'linked').symlink_to(tmp_path)
            (place / 'loop').symlink_to(place / 'loop')
            (place / 'alias.xml').symlink_to(tmp_path / 'secret.xml')
    name = within.replace('SHARE', str(share)).replace('ALLOWED', str(allowed)) + text
    try:
        found = resolve_file(name, [allowed])
    except ResourceError as error:
        assert len(str(error)) < 5 * len(name) + 1000
    else:
        real = Path(os.path.realpath(found))
        assert real.is_file()
        assert real.is_relative_to(os.path.realpath(allowed if name.startswith('/') else share))
