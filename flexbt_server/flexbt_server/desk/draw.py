# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool draw``: trees as a picture, by Graphviz, or as its source or that of Mermaid."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from flexbt_common.escaping import one_line
from flexbt_server.behavior_tree import NodeKind, TreeKey, TreeLibrary
from flexbt_server.desk import arguments, outline
from flexbt_server.desk.errors import ExitCode, UsageError
from flexbt_server.desk.files import read_library
from flexbt_server.desk.outline import Item, items_of

_LAYOUT_TIMEOUT_S: Final = 120.0

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

Graphs = Sequence[tuple[TreeKey, Sequence[Item]]]
"""The trees of a picture."""


def dot_lines(graphs: Graphs, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Graphviz."""
    yield 'digraph {'
    yield '  graph [ordering=out, fontname="Helvetica", color="#999999"]'
    yield '  node [style=filled, color="#555555", fontname="Helvetica", fontsize=11]'
    yield '  edge [color="#555555", arrowsize=0.6]'
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph cluster_{number} {{'
        yield f'    label={_dot_text([key.id])}'
        for position, item in enumerate(items):
            shape, _, colour = _LOOKS[item.kind]
            label = _dot_text(_label(item, with_ports))
            yield f'    t{number}n{position} [shape={shape}, fillcolor="{colour}", label={label}]'
            if item.parent is not None:
                yield f'    t{number}n{item.parent} -> t{number}n{position}'
        yield '  }'
    yield '}'


def mermaid_lines(graphs: Graphs, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Mermaid."""
    yield 'flowchart TD'
    for kind, (_, _, colour) in _LOOKS.items():
        yield f'  classDef {kind.value} fill:{colour},stroke:#555'
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph t{number}["{_mermaid_text([key.id])}"]'
        for position, item in enumerate(items):
            opening, closing = _LOOKS[item.kind][1].split('|')
            label = f'{opening}{_mermaid_text(_label(item, with_ports))}{closing}'
            yield f'    t{number}n{position}{label}:::{item.kind.value}'
            if item.parent is not None:
                yield f'    t{number}n{item.parent} --> t{number}n{position}'
        yield '  end'


def _label(item: Item, with_ports: bool) -> list[str]:
    lines = [item.name, f'({item.type})'] if item.name else [item.type]
    return lines + (item.attributes() if with_ports else [])


def _dot_text(lines: Sequence[str]) -> str:
    # Graphviz reads entities in a label, so the ampersand is one.
    shown = (one_line(line).replace('&', '&amp;').replace('\\', '\\\\').replace('"', '\\"') for line in lines)
    text = '\\n'.join(shown)
    return f'"{text}"'


def _mermaid_text(lines: Sequence[str]) -> str:
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
    """The picture that Graphviz makes. Raises UsageError when it is not installed, or fails."""
    program = shutil.which('dot')
    if program is None:
        raise UsageError(
            'pictures are made by Graphviz, whose program "dot" is not installed: apt install graphviz (or its like), '
            'or use --format mermaid or --format dot, which need nothing'
        )
    try:
        done = subprocess.run(  # noqa: S603
            [program, '-Tsvg'],
            input=dot_source.encode(),
            capture_output=True,
            check=False,
            timeout=_LAYOUT_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        raise UsageError(f'{program} did not end within {_LAYOUT_TIMEOUT_S:g} s; draw one tree (--tree ID)') from None
    if done.returncode:
        raise UsageError(f'{program} failed: {done.stderr.decode(errors="replace").strip()}')
    return done.stdout.decode()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    outline.add_arguments(parser)
    parser.add_argument(
        '--format', choices=_FORMATS, help='svg needs Graphviz (default: by the name of the output file, or svg)'
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write (default: the standard output)')
    parser.add_argument('--ports', action='store_true', help='also the ports that the file gives')
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    chosen = options.format or _SUFFIXES.get(Path(options.output or '').suffix.lower(), 'svg')
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    picture = draw(library, outline.chosen_trees(library, options), chosen, expand=options.expand, ports=options.ports)
    if options.output is None:
        sys.stdout.write(picture)
        return ExitCode.OK
    try:
        Path(options.output).write_text(picture, encoding='utf-8')
    except OSError as error:
        raise UsageError(f'{options.output}: cannot be written: {error.strerror}') from error
    return ExitCode.OK


def draw(library: TreeLibrary, keys: Sequence[TreeKey], format: str, *, expand: bool, ports: bool) -> str:
    """A picture of trees in a format: svg, dot or mermaid. Raises UsageError."""
    graphs = [(key, list(items_of(library, key, expand=expand))) for key in keys]
    lines: Callable[..., Iterator[str]] = mermaid_lines if format == 'mermaid' else dot_lines
    text = '\n'.join(lines(graphs, with_ports=ports)) + '\n'
    return svg(text) if format == 'svg' else text
