# SPDX-License-Identifier: BSD-3-Clause
"""Write the generated pages and build the documentation into out/docs.

Sphinx and its dependencies are installed beside the workspace's packages.
Run it in a shell with the environment of the workspace (`make docs`). Other options are passed to Sphinx.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).resolve().parents[1]
REQUIREMENTS: Final = DOCS / 'requirements.txt'
PACKAGES: Final = DOCS.parent / '.venv' / 'docs'
GENERATED: Final = (
    'make_architecture.py',
    'make_bounds.py',
    'make_bt_nodes.py',
    'make_commands.py',
    'make_console.py',
    'make_parameters.py',
    'make_states.py',
    'make_world_files.py',
)
"""Programs that write pages from the code. Tests compare the committed pages with their output."""

OUTPUT: Final = DOCS.parent / 'out' / 'docs'


def install() -> None:
    """Install the pinned packages into a separate directory, unless they are installed.

    colcon and Sphinx need different versions of docutils, so the virtual environment does not work.
    """
    stamp = PACKAGES / 'stamp'
    wanted = f'{hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()} {sys.version}'
    if stamp.exists() and stamp.read_text(encoding='utf-8') == wanted:
        return
    print('installing Sphinx and its extensions', flush=True)
    shutil.rmtree(PACKAGES, ignore_errors=True)
    pip = [sys.executable, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check', '--no-input', '--no-deps']
    subprocess.run([*pip, '--target', PACKAGES, '--requirement', REQUIREMENTS], check=True)
    stamp.write_text(wanted, encoding='utf-8')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    what = 'only run this program of this directory with its arguments; for programs that need these packages'
    parser.add_argument('--tool', nargs=argparse.REMAINDER, metavar='FILE', help=what)
    arguments, options = parser.parse_known_args()
    if arguments.tool == []:
        parser.error('--tool needs the name of a program')
    install()
    search = os.pathsep.join(filter(None, [str(PACKAGES), os.environ.get('PYTHONPATH')]))
    environment = os.environ | {'PYTHONPATH': search}
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
