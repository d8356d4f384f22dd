# SPDX-License-Identifier: BSD-3-Clause
"""Runs a benchmark by its name: ``python3 benchmarks NAME [OPTION...]``. Without one: what there is, room by room."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).resolve().parent
SUPPORT: Final = HERE / 'support'
"""What several of them import."""


def benchmarks() -> dict[str, Path]:
    """Return the programs by their names; what begins with ``_`` is a part of one."""
    return {script.stem: script for script in sorted(HERE.glob('*/[!_]*.py'))}


def main(arguments: list[str]) -> int:
    """Run the one that is named first, with the options after it; gives the exit code."""
    known = benchmarks()
    if not arguments or arguments[0] in ('-h', '--help'):
        print('usage: python3 benchmarks NAME [OPTION...]; of each, --help shows the options')
        for one in sorted(known.values()):
            summary = (ast.get_docstring(ast.parse(one.read_text(encoding='utf-8'))) or '').partition('\n')[0]
            print(f'  {one.parent.name + "/" + one.stem:30}{summary}')
        return 0
    name, *options = arguments
    script = known.get(name)
    if script is None:
        print(f'there is no benchmark {name!r}; there are: {", ".join(known)}', file=sys.stderr)
        return 2
    sys.argv = [str(script), *options]
    sys.path[:1] = [str(script.parent), str(SUPPORT)]
    runpy.run_path(str(script), run_name='__main__')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
