# SPDX-License-Identifier: BSD-3-Clause
"""Print words, sentences and average sentence length of the pages.

Words include headings and tables. Sentences are those of paragraphs and lists that end with a full stop or a colon.
Code blocks, front matter, comments and the change log are left out. With a limit, the exit code
is 1 if a page exceeds it or has a table cell that holds a paragraph.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
PATTERNS: Final = ('*.md', '[a-z]*/README.md', 'docs/**/*.md')
PARAGRAPH_WORDS: Final = 40
"""A table cell with more words than this is a paragraph."""

FRONT_MATTER: Final = re.compile(r'\A---\n.*?\n---\n', re.DOTALL)
COMMENT: Final = re.compile(r'<!--.*?-->', re.DOTALL)
FENCE: Final = re.compile(r'^ *(`{3,}|~{3,}).*?^ *\1 *$', re.DOTALL | re.MULTILINE)
ITEM: Final = re.compile(r'\s*(?:[-*+]|\d+\.) +')
SENTENCE_END: Final = re.compile(r'(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)["\')*]* +(?=["\'(*`]*[A-Z`0-9])')
FINISHED: Final = re.compile(r'[.!?:]["\')*`]*$')
WORD: Final = re.compile(r"[^\W_][\w'’.,:/-]*")


@dataclass
class Page:
    """The counts of one page."""

    name: str
    words: int = 0
    sentences: list[str] = field(default_factory=list)
    long_cells: list[str] = field(default_factory=list)

    @property
    def average(self) -> float:
        """Average number of words in a sentence."""
        return sum(map(count, self.sentences)) / len(self.sentences) if self.sentences else 0.0


def count(text: str) -> int:
    """Return the number of words; code in backquotes is one word."""
    return len(WORD.findall(re.sub(r'`[^`]*`', 'code', text)))


def plain(text: str) -> str:
    """Return the text that a reader sees: the text of links, no pictures."""
    text = re.sub(r'!\[[^\]]*\]\([^)]*\)', '', text)
    return re.sub(r'\[((?:[^\]\[]|\[[^\]]*\])*)\]\([^)]*\)', r'\1', text)


def measure(path: Path) -> Page:
    """Count words and sentences of the page at ``path``."""
    page = Page(str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path))
    text = path.read_text(encoding='utf-8')
    for left_out in (FRONT_MATTER, COMMENT, FENCE):
        text = left_out.sub('\n', text)
    blocks: list[str] = ['']
    for line in map(plain, text.splitlines()):
        if line.lstrip().startswith('|'):
            cells = re.split(r'(?<!\\)\|', line.strip().strip('|'))
            page.words += sum(map(count, cells))
            page.long_cells += [cell.strip() for cell in cells if count(cell) > PARAGRAPH_WORDS]
            blocks.append('')
        elif line.startswith('#'):
            page.words += count(line)
            blocks.append('')
        elif not line.strip() or ITEM.match(line):
            blocks.append(ITEM.sub('', line, count=1))
        else:
            blocks[-1] += f' {line.strip()}'
    for block in blocks:
        page.words += count(block)
        page.sentences += [one for one in SENTENCE_END.split(block.strip()) if count(one) and FINISHED.search(one)]
    return page


def main() -> int:
    """Print the figures of the pages and compare them with the limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('pages', nargs='*', type=Path, help='pages to measure; default: all')
    parser.add_argument('--readme-limit', type=float, metavar='WORDS', help='longest average of README.md')
    parser.add_argument('--limit', type=float, metavar='WORDS', help='longest average of every other page')
    parser.add_argument(
        '--longest', type=int, default=0, metavar='N', help='also print the N longest sentences of a page'
    )
    parser.add_argument('--cells', action='store_true', help='also print table cells that hold a paragraph')
    arguments = parser.parse_args()
    paths = arguments.pages or sorted(
        path for pattern in PATTERNS for path in ROOT.glob(pattern) if path.name != 'CHANGELOG.md'
    )
    total, exceeded = Page('total'), False
    print('  words sentences average longest cells page')
    for path in paths:
        page = measure(path.resolve())
        limit = arguments.readme_limit if page.name == 'README.md' else arguments.limit
        is_too_long = limit is not None and page.average > limit
        exceeded |= is_too_long or (limit is not None and bool(page.long_cells))
        show(page, f'  above {limit:g}' if is_too_long else '')
        for sentence in sorted(page.sentences, key=count, reverse=True)[: arguments.longest]:
            print(f'      {count(sentence)}: {sentence}')
        for cell in page.long_cells if arguments.cells else []:
            print(f'      cell of {count(cell)}: {cell}')
        total.words += page.words
        total.sentences += page.sentences
        total.long_cells += page.long_cells
    show(total)
    return int(exceeded)


def show(page: Page, note: str = '') -> None:
    """Print the figures of ``page`` in a line."""
    longest = max(map(count, page.sentences), default=0)
    print(
        f'{page.words:7} {len(page.sentences):9} {page.average:7.1f} {longest:7} {len(page.long_cells):5} '
        f'{page.name}{note}'
    )


if __name__ == '__main__':
    sys.exit(main())
