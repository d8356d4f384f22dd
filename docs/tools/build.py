# SPDX-License-Identifier: BSD-3-Clause
"""Write the generated pages and build the documentation into out/docs.

Sphinx and its dependencies are installed beside the workspace's packages.
Run it in a shell with the environment of the workspace (`make docs`). Other options are passed to Sphinx.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(DOCS.parent / 'tools'))
from workspace.side_packages import environment_with  # noqa: E402

REQUIREMENTS: Final = DOCS / 'requirements.txt'
PACKAGES: Final = DOCS.parent / '.venv' / 'docs'
"""colcon and Sphinx need different versions of docutils, so the virtual environment does not work."""
GENERATED: Final = (
    'make_architecture.py',
    'make_bounds.py',
    'make_bt_nodes.py',
    'make_commands.py',
    'make_console.py',
    'make_llms.py',
    'make_parameters.py',
    'make_states.py',
    'make_world_files.py',
)
"""Programs that write pages from the code. Tests compare the committed pages with their output."""

OUTPUT: Final = DOCS.parent / 'out' / 'docs'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    what = 'only run this program of this directory with its arguments; for programs that need these packages'
    parser.add_argument('--tool', nargs=argparse.REMAINDER, metavar='FILE', help=what)
    arguments, options = parser.parse_known_args()
    if arguments.tool == []:
        parser.error('--tool needs the name of a program')
    environment = environment_with(REQUIREMENTS, PACKAGES)
    if arguments.tool:
        tool = [sys.executable, DOCS / 'tools' / arguments.tool[0], *arguments.tool[1:]]
        return subprocess.run(tool, env=environment, check=False).returncode
    for name in GENERATED:
        subprocess.run([sys.executable, DOCS / 'tools' / name], check=True)
    sphinx = [sys.executable, '-m', 'sphinx', '--fail-on-warning', '--jobs', 'auto', '--quiet']
    command = [*sphinx, '--doctree-dir', OUTPUT / 'doctrees', *options, DOCS, OUTPUT / 'html']
    code = subprocess.run(command, env=environment, check=False).returncode
    if code == 0:
        print(f'the documentation is {OUTPUT / "html" / "index.html"}')
    return code


if __name__ == '__main__':
    sys.exit(main())
