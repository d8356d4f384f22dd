# SPDX-License-Identifier: BSD-3-Clause
"""Releases: one version everywhere, and what `tools/release.py` writes, as the tools of ROS read it."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from catkin_pkg.changelog import get_changelog_from_path  # type: ignore[import-untyped]
from catkin_pkg.package import parse_package  # type: ignore[import-untyped]

ROOT = Path(__file__).parents[3]
TIMEOUT_S = 120
MAINTAINER, EMAIL, URL = "Ann O'Example & Co", 'ann@example.org', 'https://forge.example/flexbt?a&b'
CATKIN = 'from catkin_pkg.cli.prepare_release import main; main()'


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a repository of what a release changes, with an unreleased version on top of the changelog."""
    files = ['CHANGELOG.md', 'CITATION.cff', 'docs/conf.py', 'tools/release.py']
    files += [str(file.relative_to(ROOT)) for name in ('package.xml', 'setup.py') for file in ROOT.glob(f'*/{name}')]
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / file, tmp_path / file)
    changelog = tmp_path / 'CHANGELOG.md'
    text = re.sub(r'^## \[.*', '## [7.8.9] – unreleased', changelog.read_text('utf-8'), count=1, flags=re.MULTILINE)
    changelog.write_text(text, encoding='utf-8')
    git(tmp_path, 'init', '--quiet')
    commit(tmp_path)
    return tmp_path


def git(directory: Path, *words: str) -> str:
    command = ['git', '-c', 'user.name=Ann', '-c', f'user.email={EMAIL}', *words]
    return subprocess.run(
        command, cwd=directory, capture_output=True, text=True, timeout=TIMEOUT_S, check=True
    ).stdout.strip()


def commit(directory: Path) -> None:
    git(directory, 'add', '--all')
    git(directory, 'commit', '--quiet', '--message', 'state')


def release(directory: Path, version: str = '7.8.9', who: str = f'{MAINTAINER} <{EMAIL}>') -> tuple[int, str]:
    """Return exit code and errors of `tools/release.py`."""
    command = [sys.executable, 'tools/release.py', version, '--maintainer', who, '--url', URL]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    return done.returncode, done.stderr


def versions(directory: Path) -> set[str]:
    """Return the versions that packages, citation and documentation name."""
    patterns = {
        '*/package.xml': '<version>(.*)</version>',
        '*/setup.py': "version='(.*)'",
        'CITATION.cff': r'^version: (.*)',
        'docs/conf.py': r"^release = '(.*)'",
    }
    return {
        found
        for place, pattern in patterns.items()
        for file in directory.glob(place)
        for found in re.findall(pattern, file.read_text(encoding='utf-8'), re.MULTILINE) or [f'{file} has none']
    }


def test_there_is_one_version() -> None:
    assert len(versions(ROOT)) == 1


def test_licenses_are_spdx_identifiers() -> None:
    manifests = [*ROOT.glob('*/package.xml'), *ROOT.glob('underlay/*/package.xml')]
    assert {license for manifest in manifests for license in parse_package(manifest).licenses} == {'BSD-3-Clause'}


def test_a_release_is_prepared_as_the_tools_of_ros_expect(checkout: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert release(checkout) == (0, '')
    commit(checkout)
    options = ['--version', '7.8.9', '--no-push', '--non-interactive']
    identity = dict(os.environ)
    for role in ('AUTHOR', 'COMMITTER'):
        identity |= {f'GIT_{role}_NAME': 'Ann', f'GIT_{role}_EMAIL': EMAIL}
    subprocess.run([sys.executable, '-c', CATKIN, *options], cwd=checkout, env=identity, timeout=TIMEOUT_S, check=True)
    assert git(checkout, 'tag', '--points-at', 'HEAD') == '7.8.9'
    assert git(checkout, 'status', '--porcelain') == ''
    assert versions(checkout) == {'7.8.9'}
    capfd.readouterr()

    text = (checkout / 'CHANGELOG.md').read_text(encoding='utf-8')
    assert re.search(r'^## \[7\.8\.9] – \d{4}-\d\d-\d\d$', text, re.MULTILINE)
    sections = re.split(r'^#{3,} (.*)\n', text, flags=re.MULTILINE)
    for manifest in checkout.glob('*/package.xml'):
        package = parse_package(manifest)
        assert [(who.name, who.email) for who in package.maintainers] == [(MAINTAINER, EMAIL)]
        assert [one.url for one in package.urls] == [URL]
        changelog = get_changelog_from_path(manifest.parent / 'CHANGELOG.rst', package.name)
        (items,) = changelog.get_content_of_version('7.8.9')
        pairs = zip(sections[1::2], sections[2::2], strict=True)
        entries = [
            body.count('\n- ') + body.startswith('- ') for heading, body in pairs if f'`{package.name}`' in heading
        ]
        assert len(items.bullets) == sum(entries) + 1, package.name
    assert capfd.readouterr().err == ''  # complaints of docutils about the markup
    for setup in checkout.glob('*/setup.py'):
        calls = (node for node in ast.walk(ast.parse(setup.read_text('utf-8'))) if isinstance(node, ast.keyword))
        said = {call.arg: call.value for call in calls}
        named = [ast.literal_eval(said[name]) for name in ('maintainer', 'maintainer_email', 'url')]
        assert named == [MAINTAINER, EMAIL, URL]


def test_a_release_with_the_same_maintainer_changes_no_more_than_the_version(checkout: Path) -> None:
    assert release(checkout) == (0, '')
    commit(checkout)
    changelog = checkout / 'CHANGELOG.md'
    text = changelog.read_text(encoding='utf-8')
    changelog.write_text(text.replace('## [7.8.9]', '## [8.0.0] – unreleased\n\n### Added\n\n## [7.8.9]'), 'utf-8')
    commit(checkout)
    assert release(checkout, '8.0.0') == (0, '')
    changed = {Path(line.split()[-1]).name for line in git(checkout, 'status', '--porcelain').splitlines()}
    assert changed == {'CHANGELOG.md', 'CHANGELOG.rst', 'CITATION.cff', 'conf.py'}
    rst = (checkout / 'flexbt_core' / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert re.findall(r'^Forthcoming$|^7\.8\.9 \(\d{4}-\d\d-\d\d\)$', rst, re.MULTILINE)[0] == 'Forthcoming'


def test_what_cannot_be_released_is_refused_and_nothing_is_changed(checkout: Path) -> None:
    for version, who, code, said in (
        ('7.8.8', f'Ann <{EMAIL}>', 1, "CHANGELOG.md has no '## [7.8.8] – unreleased'"),
        ('7.8.9', 'Ann', 2, "'Ann' is not 'NAME <ADDRESS>'"),
        ('7.8.9', 'Ann <ann@flexbt.invalid>', 2, 'with an address that receives mail'),
    ):
        ended, errors = release(checkout, version, who)
        assert (ended, said in errors) == (code, True), errors
    assert git(checkout, 'status', '--porcelain') == ''
