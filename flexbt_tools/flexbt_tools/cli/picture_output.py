# SPDX-License-Identifier: BSD-3-Clause
"""Where and in which language a command writes a picture."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from flexbt_common.errors import ResourceError
from flexbt_common.pictures import fitted, svg
from flexbt_tools.errors import UsageError
from flexbt_tools.text_files import write_text

_FORMATS: Final = ('svg', 'dot', 'mermaid')
_SUFFIXES: Final = {'.svg': 'svg', '.dot': 'dot', '.gv': 'dot', '.mmd': 'mermaid', '.mermaid': 'mermaid'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Format and place of the picture."""
    parser.add_argument(
        '--format', choices=_FORMATS, help='default: by the name of the output file, or svg, which Graphviz makes'
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write (default: the standard output)')


def write(options: argparse.Namespace, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> None:
    """Write the picture that the options ask for, of its lines in a language. Raises UsageError."""
    chosen = options.format or _by_name(options.output or '')
    picture = _picture(chosen, dot, mermaid)
    if options.output is None:
        sys.stdout.write(picture)
    else:
        write_text(options.output, picture)


def write_file(file: str, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> None:
    """Write a picture in the language that the name of the file says, SVG otherwise. Raises UsageError."""
    write_text(file, _picture(_by_name(file), dot, mermaid))


def _by_name(file: str) -> str:
    return _SUFFIXES.get(Path(file).suffix.lower(), 'svg')


def _picture(form: str, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> str:
    text = '\n'.join(mermaid() if form == 'mermaid' else dot()) + '\n'
    try:
        return fitted(svg(text)) if form == 'svg' else text
    except ResourceError as error:
        raise UsageError(str(error)) from None
