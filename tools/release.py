# SPDX-License-Identifier: BSD-3-Clause
"""Prepare a release: its date, who answers for it, and the changelog of each package, made from CHANGELOG.md.

    python3 tools/release.py 0.1.0 --maintainer 'Ann Example <ann@example.org>' --url https://forge.example/flexbt

The steps before and after are in docs/releases.md. `catkin_prepare_release` sets the version, commits and tags.
"""

from __future__ import annotations

import argparse
import datetime
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

ROOT = Path(__file__).parents[1]
UNRELEASED = 'unreleased'
FORTHCOMING = 'Forthcoming'  # what `catkin_prepare_release` replaces by version and date
REST = '* What else has changed, and what to do about it, is in CHANGELOG.md of the repository.'


@dataclass(frozen=True)
class Release:
    """A version in CHANGELOG.md. An item is the Markdown of one entry, below a heading that names its packages."""

    version: str
    date: str
    items: Sequence[tuple[str, str]]  # heading, text


def read_changelog(text: str) -> list[Release]:
    """Return the versions in `text`, the newest first."""
    releases = []
    for part in re.split(r'^## ', text, flags=re.MULTILINE)[1:]:
        title, _, body = part.partition('\n')
        found = re.fullmatch(r'\[(\d+\.\d+\.\d+)] – (\S+)', title)
        if found is None:
            raise ValueError(
                f"CHANGELOG.md: '## {title}' is not '## [VERSION] – DATE' or '## [VERSION] – {UNRELEASED}'"
            )
        items = []
        for section in re.split(r'^#{3,} ', body, flags=re.MULTILINE)[1:]:
            heading, _, entries = section.partition('\n')
            bullets = re.findall(r'^- (.*(?:\n  .*)*)', entries, re.MULTILINE)
            items += [(heading, ' '.join(bullet.split())) for bullet in bullets]
        releases.append(Release(found[1], found[2], items))
    return releases


def package_changelog(name: str, releases: Sequence[Release], forthcoming: str) -> str:
    """Return CHANGELOG.rst of a package, as `catkin_generate_changelog` would write it."""
    title = f'Changelog for package {name}'
    lines = ['^' * len(title), title, '^' * len(title)]
    for release in releases:
        label = FORTHCOMING if release.version == forthcoming else f'{release.version} ({release.date})'
        items = [f'* {_rst(text)}' for heading, text in release.items if f'`{name}`' in heading]
        lines += ['', label, '-' * len(label), *items, REST]
    return '\n'.join(lines) + '\n'


def _rst(markdown: str) -> str:
    """Return reStructuredText for one paragraph of Markdown: links as their text, code as literals."""
    text = re.sub(r'\[((?:`[^`]*`|[^]`])*)]\([^)]*\)', r'\1', markdown)
    return re.sub(
        r'`([^`]+)`(?=(\w)?)|[\\_|]',
        lambda found: f'``{found[1]}``' + ('\\ ' if found[2] else '') if found[1] else f'\\{found[0]}',
        text,
    )


def prepare(root: Path, version: str, maintainer: str, email: str, url: str) -> None:
    """Write the files of a release into the checkout `root`. Raise ValueError when the changelog lacks the version."""
    file = root / 'CHANGELOG.md'
    text = file.read_text(encoding='utf-8')
    heading = f'## [{version}] – '
    if f'{heading}{UNRELEASED}\n' not in text:
        raise ValueError(f"CHANGELOG.md has no '{heading}{UNRELEASED}'. Write what is new below that heading")
    text = text.replace(f'{heading}{UNRELEASED}\n', f'{heading}{datetime.date.today()}\n')
    releases = read_changelog(text)
    file.write_text(text, encoding='utf-8')
    _replace(root / 'CITATION.cff', r'^version: .*', f'version: {version}')
    _replace(root / 'docs' / 'conf.py', r'^release = .*', f'release = {version!r}')
    who = f'<maintainer email={quoteattr(email)}>{escape(maintainer)}</maintainer>'
    for manifest in sorted(root.glob('*/package.xml')):
        _replace(manifest, r'<maintainer .*', who)
        _replace(manifest, r'</license>(\n  <url .*)?', f'</license>\n  <url type="repository">{escape(url)}</url>')
        if (setup := manifest.parent / 'setup.py').exists():
            _replace(setup, r'^    maintainer=.*', f'    maintainer={maintainer!r},')
            _replace(
                setup, r'^    maintainer_email=.*(\n    url=.*)?', f'    maintainer_email={email!r},\n    url={url!r},'
            )
        name = re.findall('<name>(.*)</name>', manifest.read_text(encoding='utf-8'))[0]
        changelog = package_changelog(name, releases, version)
        (manifest.parent / 'CHANGELOG.rst').write_text(changelog, encoding='utf-8')


def _replace(file: Path, pattern: str, new: str) -> None:
    text, count = re.subn(pattern, lambda _: new, file.read_text(encoding='utf-8'), flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f'{file} has {count} places for {new!r}, not one')
    file.write_text(text, encoding='utf-8')


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('version', help='as in the changelog: 0.1.0')
    parser.add_argument('--maintainer', required=True, help="who answers for the packages: 'NAME <ADDRESS>'")
    parser.add_argument('--url', required=True, help='address of the repository')
    arguments = parser.parse_args()
    who = re.fullmatch(r'([^<>]+) <([^<>\s@]+@[^<>\s@]+\.[a-zA-Z]{2,})>', arguments.maintainer)
    if who is None or who[2].endswith('.invalid'):
        parser.error(
            f"--maintainer {arguments.maintainer!r} is not 'NAME <ADDRESS>' with an address that receives mail"
        )
    try:
        prepare(ROOT, arguments.version, who[1], who[2], arguments.url)
    except ValueError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    print(f'Prepared {arguments.version}. Read `git diff`, then follow docs/releases.md.')
    return 0


if __name__ == '__main__':
    sys.exit(main())
