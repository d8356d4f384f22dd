# SPDX-License-Identifier: BSD-3-Clause
"""The command ``studio``: serve the studio for a folder until it is ended."""

from __future__ import annotations

import secrets
import shutil
import subprocess
import sys
from importlib.resources import as_file, files
from pathlib import Path

from flexbt_common.command_line import SuggestingArgumentParser
from flexbt_common.files import home_path
from flexbt_console.errors import UsageError
from flexbt_console.ui.console import main as console
from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.server import run_web
from flexbt_core.values.text import one_line
from flexbt_studio.errors import StudioError

from .groot2_robot import robot_name
from .web_server import StudioServer, editor_folder, workbench_for


def main() -> int:
    """Run the command, and return its exit code: 0, or 2 if it cannot be done as written."""
    parser = SuggestingArgumentParser(prog='studio', description='Write, check, run and watch missions in a browser.')
    parser.add_argument('folder', nargs='?', default='.', help='folder of the project (default: this one)')
    parser.add_argument('--port', type=int, default=0, help='port of the page; 0 chooses a free one (default)')
    parser.add_argument('--address', default='127.0.0.1', help='address to listen at (default: %(default)s)')
    parser.add_argument(
        '--operate', action='store_true', help="serve the operator's page as well, and show what runs on the robots"
    )
    parser.add_argument(
        '--groot2',
        metavar='HOST:PORT',
        help="show what a program of BehaviorTree.CPP runs that serves Groot2's protocol (usual port: 1667)",
    )
    parser.add_argument(
        '--recordings',
        default='',
        metavar='FOLDER',
        help='folder of recordings, logs of trees and incidents (default: recordings of the project, or ~/.ros/flexbt)',
    )
    parser.add_argument(
        '--get-editor',
        action='store_true',
        help='install the text editor CodeMirror by npm, in the versions and with the hashes of a lock file, and end',
    )
    options = parser.parse_args()
    try:
        if options.get_editor:
            return get_editor()
        programs = [robot_name(options.groot2)] if options.groot2 else []
        if options.operate and programs:
            raise UsageError('--groot2 is for a studio without --operate; there, watch a program by a command (Ctrl+K)')
        if options.operate and options.recordings:
            raise UsageError('--recordings is for a studio without --operate; there, use the folder recordings')
        if options.operate:
            return console(
                ['web', '--studio', options.folder, '--port', str(options.port), '--address', options.address]
            )
        access = Access.of(options.address, secrets.token_urlsafe(24))
        editor = editor_folder()
        if editor is None:
            print('the text editor CodeMirror is not installed, a plain one is used: studio --get-editor', flush=True)
        run_web(
            StudioServer(
                workbench_for(options.folder), access, editor, programs=programs, recordings=options.recordings
            ).application(),
            access,
            options.port,
            print_address,
        )
    except (UsageError, StudioError) as error:
        print(one_line(f'studio: {error}'), file=sys.stderr)
        return 2
    return 0


def print_address(address: str) -> None:
    """Print the address of the page."""
    print(f'the studio is at {address}  (Ctrl-C ends it)', flush=True)


def get_editor() -> int:
    """Install CodeMirror where :func:`.web_server.editor_folder` finds it. Return npm's exit code."""
    npm = shutil.which('npm')
    if npm is None:
        raise UsageError('npm is not installed; install it, or do without: the studio has a plain text editor')
    target = Path(sys.prefix if sys.prefix != sys.base_prefix else home_path('~/.local'), 'share', 'flexbt_studio')
    try:
        target.mkdir(parents=True, exist_ok=True)
        with as_file(files('flexbt_studio') / 'page') as page:
            for name in ('package.json', 'package-lock.json'):
                shutil.copy(page / name, target / name)
    except OSError as error:
        raise UsageError(f'{error.filename}: cannot be written: {error.strerror}') from error
    words = ['ci', '--ignore-scripts', '--no-audit', '--no-fund', '--omit=dev']
    code = subprocess.run([npm, *words], cwd=target, check=False).returncode  # noqa: S603
    if code:
        (target / 'package-lock.json').unlink()  # it stands for what is installed
    return code
