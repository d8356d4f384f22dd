# SPDX-License-Identifier: BSD-3-Clause
"""Write llms.txt, the index of the documentation for language models (https://llmstxt.org), from its pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from target import target

ROOT: Final = Path(__file__).resolve().parents[2]
PAGE: Final = ROOT / 'llms.txt'
SECTIONS: Final = {
    'Tutorials': 'tutorials',
    'How-to guides': 'how_to',
    'Reference': 'reference',
    'Explanation': 'explanation',
}
HEAD: Final = """\
# FlexBT

> Supervised robot missions on ROS 2: behavior trees (XML of BehaviorTree.CPP and Nav2) below a hierarchical state
> machine (FlexBE's), with an operator console. Trees and machines are checked, run with mocks and proved without a
> robot.

Before you write a tree or a behavior, read "The nodes of a behavior tree" and "The states". After each change run
`bt_tool check FILE.xml` or `behavior_tool check NAME` (`--json` for programs), and `bt_tool run FILE.xml`.
"""


def page() -> str:
    """Return the whole text."""
    lines = [
        HEAD,
        '- [README](README.md): what FlexBT is, and its two commands',
        '- [AGENTS](AGENTS.md): rules of this repository',
    ]
    for title, folder in SECTIONS.items():
        lines += ['', f'## {title}', '']
        for file in sorted((ROOT / 'docs' / folder).glob('*.md')):
            if file.name != 'index.md':
                lines.append(entry(file))
    return '\n'.join(lines) + '\n'


def entry(file: Path) -> str:
    """Return the line of a page: its title, and the first sentence of its text."""
    text = file.read_text(encoding='utf-8')
    title = text.partition('\n')[0].lstrip('# ')
    paragraphs = [part.strip() for part in text.split('\n\n')[1:]]
    first = next((part for part in paragraphs if re.match('[A-Za-z[]|`[^`]', part)), '')
    sentence = re.split(
        r'(?:(?<=[a-z)][.:])|(?<=\w`[.:]))\s', re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', ' '.join(first.split()))
    )[0]
    about = f': {sentence}' if sentence.endswith('.') else ''
    return f'- [{title}]({file.relative_to(ROOT)}){about}'


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
