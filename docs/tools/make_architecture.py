# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/explanation/architecture.md: packages and folders, from the import contracts and the docstrings.

It needs no built workspace.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from target import target

ROOT: Final = Path(__file__).resolve().parents[2]
PAGE: Final = ROOT / 'docs' / 'explanation' / 'architecture.md'
HEAD: Final = """\
# Architecture

Packages and their folders, from the import contracts in `pyproject.toml`, which `make lint` enforces
(`docs/tools/make_architecture.py` writes this page). A folder has one purpose and imports only from folders below it.

## Packages

A package may import packages below it, but none in the same item.
"""
ON_FOLDERS: Final = """\
Folders of a package are listed by layers, the top one first. The contracts also cover modules, and list what needs no
ROS and what needs no engine.
"""


def summary(package: Path) -> str:
    """Return the first sentence of the docstring of a package."""
    doc = ast.get_docstring(ast.parse((package / '__init__.py').read_text(encoding='utf-8'))) or ''
    text = re.split(r'(?<=[.]) (?=[A-Z`])', ' '.join(doc.partition('\n\n')[0].split()))[0]
    return re.sub(r':\w+:`([^`]+)`', r'`\1`', text).replace('``', '`')


def folders(package: Path, layer_of: dict[str, int], depth: int = 0) -> Iterator[str]:
    """Return a package and its folders, the top layer first, each with its purpose, as a nested list."""
    yield f'{"  " * depth}- `{package.name}`: {summary(package)}'
    inner = [folder for folder in package.iterdir() if (folder / '__init__.py').exists()]
    names = {folder: '.'.join(folder.relative_to(ROOT).parts[1:]) for folder in inner}
    for folder in sorted(inner, key=lambda folder: (layer_of.get(names[folder], 0), folder.name)):
        yield from folders(folder, layer_of, depth + 1)


def page() -> str:
    """Return the whole page."""
    settings = tomllib.loads((ROOT / 'pyproject.toml').read_text(encoding='utf-8'))['tool']['importlinter']
    packages = settings['root_packages']
    contracts = settings['contracts']
    [layers] = [
        rule['layers']
        for rule in contracts
        if rule['type'] == 'layers' and not rule.get('containers') and set(packages) >= {rule['layers'][-1]}
    ]
    layer_of = {
        name: place
        for rule in contracts
        if rule['type'] == 'layers'
        for place, layer in enumerate(rule['layers'])
        for name in layer.split(' | ')
    }
    rows = (', '.join(f'`{name.strip()}`' for name in layer.split('|')) for layer in layers)
    lines = [HEAD, *(f'{place}. {row}' for place, row in enumerate(rows, 1)), '', '## Folders', '', ON_FOLDERS]
    for name in packages:
        lines += folders(ROOT / name / name, layer_of)
    return '\n'.join(lines) + '\n'


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
