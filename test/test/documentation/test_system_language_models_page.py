# SPDX-License-Identifier: BSD-3-Clause
"""The set-ups of clients in "Let a language model write missions": each command starts the server from any folder."""

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / 'docs' / 'how_to' / 'language_models.md').read_text(encoding='utf-8')
COMMANDS = {
    *re.findall(r"sh -c '(.*)'", PAGE),
    *(json.loads(args)[1] for args in re.findall(r'"args": (\[.*?\])', PAGE)),
}


@pytest.mark.skipif('FLEXBT_ROOT' not in os.environ, reason='built by colcon alone, without tools/env.sh')
@pytest.mark.parametrize('command', sorted(COMMANDS))
def test_the_command_of_a_client_finds_the_workspace(tmp_path: Path, command: str) -> None:
    command = command.replace('/ws', str(ROOT)).replace('mcp missions', 'mcp --help')
    environment = {name: value for name, value in os.environ.items() if name != 'FLEXBT_ROOT'}
    done = subprocess.run(
        ['sh', '-c', command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, '') and 'bt_tool mcp' in done.stdout, command
