# SPDX-License-Identifier: BSD-3-Clause
"""Every link between the pages leads somewhere: to a file of the repository, and to a heading of it."""

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[3]
LINK = re.compile(r'!?\[(?:[^\]\[]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?[^)]*\)')
ELSEWHERE = re.compile(r'[a-z][a-z+.-]*:|//')
INCLUDE = re.compile(r'^```\{include\} (\S+)\n(?::relative-docs: (\S+)\n)?', re.MULTILINE)
"""The file, and how links of it begin that are moved along with it."""


def pages() -> list[Path]:
    """Return the pages that this repository has."""
    return sorted(
        file for pattern in ('*.md', '*/README.md', 'docs/**/*.md', '.github/**/*.md') for file in ROOT.glob(pattern)
    )


def prose(page: Path) -> Iterator[str]:
    """Yield the lines of a page outside of fenced blocks, without what stands in backquotes."""
    fence = ''
    for line in page.read_text(encoding='utf-8').splitlines():
        mark = re.match(r'\s*(`{3,}|~{3,})', line)
        if mark and not fence:
            fence = mark[1]
        elif mark and mark[1].startswith(fence):
            fence = ''
        elif not fence:
            yield line


def links(page: Path) -> Iterator[tuple[str, str, str]]:
    """Yield the links of a page within the repository: as they are written, their paths ('' for the page itself), and
    their anchors.
    """
    for line in prose(page):
        for link in LINK.findall(re.sub(r'`[^`]*`', '``', line)):
            if not ELSEWHERE.match(link):
                path, _, anchor = unquote(link).partition('#')
                yield link, path, anchor


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub and the documentation site make them of the text."""
    counted: Counter[str] = Counter()
    found: set[str] = set()
    for line in prose(page):
        heading = re.match(r'#{1,6} +(.*?)\s*#*$', line)
        if heading:
            text = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', heading[1])
            slug = re.sub(r'[^\w\- ]', '', text.lower()).replace(' ', '-')
            found.add(f'{slug}-{counted[slug]}' if counted[slug] else slug)
            counted[slug] += 1
    return found


@pytest.mark.parametrize('page', pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_links(page: Path) -> None:
    broken: list[str] = []
    for link, path, anchor in links(page):
        target = page.parent / path if path else page
        if not target.resolve().is_relative_to(ROOT):
            broken.append(f'{link}: outside of the repository')
        elif not target.exists():
            broken.append(f'{link}: there is no such file')
        elif anchor and anchor not in anchors(target):
            broken.append(f'{link}: {target.relative_to(ROOT)} has no such heading')
    assert not broken


def test_every_page_of_the_documentation_is_in_a_table_of_contents() -> None:
    docs = ROOT / 'docs'
    listed = {docs / 'index.md'}
    for page in docs.rglob('*.md'):
        for entries in re.findall(
            r'^```\{toctree\}\n(.*?)^```', page.read_text(encoding='utf-8'), re.MULTILINE | re.DOTALL
        ):
            names = [line for line in entries.splitlines() if line and not line.startswith(':')]
            listed |= {page.parent / f'{name}.md' for name in names}
    assert listed == set(docs.rglob('*.md'))


def test_the_files_and_tests_that_are_named_exist() -> None:
    pages = '\n'.join(
        page.read_text(encoding='utf-8') for page in (ROOT / 'CONTRIBUTING.md', *ROOT.glob('docs/explanation/*.md'))
    )
    files = set(re.findall(r'`((?:flexbt_|docs|test|tools|benchmarks)[\w./]*/[\w./]*)`', pages))
    assert len(files) > 20
    assert [
        name for name in files if not any((ROOT / top / name).exists() for top in ('', name.partition('/')[0]))
    ] == []
    modules = set(re.findall(r'`(test_\w+|\w+(?=\.py\b[^`]*`))', pages))
    assert len(modules) > 10
    places = ('flexbt_*', 'test', 'benchmarks', 'tools', 'docs')
    assert modules - {file.stem for place in places for file in ROOT.glob(f'{place}/**/*.py')} == set()


def test_what_is_included_exists_and_its_links_lead_to_pages_of_the_site_as_well() -> None:
    for page in pages():
        for name, moved in INCLUDE.findall(page.read_text(encoding='utf-8')):
            included = page.parent / name
            assert included.exists(), f'{page.relative_to(ROOT)}: {name}'
            for link, path, _ in links(included):
                is_moved = moved and path.startswith(moved)
                assert is_moved or (page.parent / path).exists(), f'{name}: {link}: there is no {page.parent / path}'


@pytest.mark.parametrize(
    ('program', 'page'), [('make_architecture.py', 'docs/explanation/architecture.md'), ('make_llms.py', 'llms.txt')]
)
def test_a_generated_page_is_what_its_program_writes(tmp_path: Path, program: str, page: str) -> None:
    subprocess.run([sys.executable, ROOT / 'docs' / 'tools' / program, tmp_path / 'page.md'], check=True)
    written = (tmp_path / 'page.md').read_text(encoding='utf-8')
    assert (ROOT / page).read_text(encoding='utf-8') == written, f'run docs/tools/{program}'


def test_sentences_are_short_and_no_table_cell_holds_a_paragraph() -> None:
    tool = ROOT / 'docs' / 'tools' / 'sentence_lengths.py'
    command: list[str | Path] = [sys.executable, tool, '--readme-limit', '20', '--limit', '22', '--cells']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
