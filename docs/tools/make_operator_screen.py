# SPDX-License-Identifier: BSD-3-Clause
"""Makes docs/images/operator_screen.svg: the operator's screen while a robot drives, as it is in a terminal.

The second demonstration runs in tmux; a goal is given, and the plan is confirmed. What the terminal shows while the
robot drives is the picture.

It needs tmux: python3 docs/tools/build.py --tool make_operator_screen.py
"""

from __future__ import annotations

import io
import re
import subprocess
import time
from pathlib import Path
from typing import Final

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text
from target import target

PICTURE: Final = Path(__file__).parents[1] / 'images' / 'operator_screen.svg'
COLUMNS: Final = 120
ROWS: Final = 32
DEADLINE: Final = 120.0  # seconds for each thing that the terminal is to show
TMUX: Final = ['tmux', '-L', 'flexbt-operator-screen', '-f', '/dev/null']


def tmux(*words: str) -> str:
    return subprocess.run([*TMUX, *words], check=True, capture_output=True, text=True).stdout


def wait_for(pattern: str) -> None:
    """Wait until the terminal shows what matches. Raises TimeoutError with what it shows instead."""
    end = time.monotonic() + DEADLINE
    while not re.search(pattern, shown := tmux('capture-pane', '-p')):
        if time.monotonic() > end:
            raise TimeoutError(f'the terminal does not show {pattern!r}, but:\n{shown}')
        time.sleep(0.1)


def operate() -> str:
    """Run the demonstration up to the moment of the picture; what the terminal shows then, with escape sequences."""
    tmux('new-session', '-d', '-x', str(COLUMNS), '-y', str(ROWS), 'demo --demo 2 --speed 3')
    try:
        wait_for(r'Where shall the robot go\?')
        tmux('send-keys', ':')
        wait_for('Tab completes, Esc leaves')
        tmux('send-keys', 'kitchen', 'Enter')
        wait_for(r'Is the path good\?')
        time.sleep(1.0)  # a key that comes at once is not taken for an answer
        tmux('send-keys', '1')
        tmux('send-keys', 'Enter')
        wait_for(r'x [3-9]\.\d+ y .*plan')
        return tmux('capture-pane', '-e', '-N', '-p')
    finally:
        tmux('send-keys', 'q')
        time.sleep(0.5)
        tmux('send-keys', 'q')
        wait_for_end()


def wait_for_end() -> None:
    end = time.monotonic() + DEADLINE
    while subprocess.run([*TMUX, 'has-session'], capture_output=True).returncode == 0 and time.monotonic() < end:
        time.sleep(0.1)


def picture(screen: str) -> str:
    """A screen as SVG, with the reader's own monospaced font instead of one from elsewhere."""
    template = re.sub(r'@font-face \{\{.*?\}\}', '', CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    template = template.replace('Fira Code, monospace', 'monospace')
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True)
    console.print(Text.from_ansi(screen.rstrip('\n')))
    return console.export_svg(title='console', code_format=template, unique_id='operator')


if __name__ == '__main__':
    target(__doc__, PICTURE).write_text(picture(operate()), encoding='utf-8')
