# SPDX-License-Identifier: BSD-3-Clause
"""Where and in which language a command writes a picture."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from flexbt_common.errors import ResourceError
from flexbt_common.pictures import svg
from flexbt_tools.errors import UsageError

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
    chosen = options.format or _SUFFIXES.get(Path(options.output or '').suffix.lower(), 'svg')
    text = '\n'.join(mermaid() if chosen == 'mermaid' else dot()) + '\n'
    try:
        picture = svg(text) if chosen == 'svg' else text
    except ResourceError as error:
        raise UsageError(str(error)) from None
    if options.output is None:
        sys.stdout.write(picture)
        return
    try:
        Path(options.output).write_text(picture, encoding='utf-8')
    except OSError as error:
        raise UsageError(f'{options.output}: cannot be written: {error.strerror}') from error
