# SPDX-License-Identifier: BSD-3-Clause
"""Make docs/images/operator_screen.svg: the operator's screen in a terminal while a robot drives.

The second demonstration runs in tmux. The program gives a goal, confirms the plan, and draws what the terminal shows
while the robot drives.

It needs tmux: python3 docs/tools/build.py --tool make_operator_screen.py
"""

from __future__ import annotations

import html
import io
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text
from target import target

PICTURE: Final = Path(__file__).parents[1] / 'images' / 'operator_screen.svg'
COLUMNS: Final = 120
ROWS: Final = 32
DEADLINE: Final = 120.0  # seconds for each text that the terminal must show
CELL_WIDTH: Final = 12.2  # of Rich's SVG, like the next three
CELL_HEIGHT: Final = 24.4
BASELINE: Final = 18.5
TEXT: Final = r'<text (class="[^"]+" )x="([\d.]+)" y="([\d.]+)" textLength="[\d.]+"( clip-path="[^"]+")>([^<]*)</text>'
DOT: Final = (
    6.6  # a little more than half a cell's width and a quarter of its height: nothing shines through between them
)
TMUX: Final = ['tmux', '-L', 'flexbt-operator-screen', '-f', '/dev/null']


def tmux(*words: str) -> str:
    return subprocess.run([*TMUX, *words], check=True, capture_output=True, text=True).stdout


def wait_for(pattern: str) -> None:
    """Wait until the terminal shows a match. Raises TimeoutError with its text."""
    end = time.monotonic() + DEADLINE
    while not re.search(pattern, shown := tmux('capture-pane', '-p')):
        if time.monotonic() > end:
            raise TimeoutError(f'the terminal does not show {pattern!r}, but:\n{shown}')
        time.sleep(0.1)


def operate() -> str:
    """Run the demonstration up to the picture, and return the terminal's text with its escape sequences."""
    tmux('new-session', '-d', '-x', str(COLUMNS), '-y', str(ROWS), 'demo --demo 2 --speed 3')
    try:
        wait_for(r'Where shall the robot go\?')
        tmux('send-keys', ':')
        wait_for('Tab completes, Esc leaves')
        tmux('send-keys', 'kitchen', 'Enter')
        wait_for(r'Is the path good\?')
        time.sleep(1.0)  # a key that comes at once is not an answer
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
    """Return a screen as SVG, with the reader's own monospaced font instead of one from elsewhere."""
    template = re.sub(r'@font-face \{\{.*?\}\}', '', CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    template = template.replace('Fira Code, monospace', 'monospace')
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True)
    console.print(Text.from_ansi(screen.rstrip('\n')))
    drawn = console.export_svg(title='console', code_format=template, unique_id='operator')
    return re.sub(TEXT, lambda found: ''.join(placed(*found.groups())), drawn)


def placed(attributes: str, x: str, y: str, rest: str, content: str) -> Iterator[str]:
    """Yield a text of one style with each sign at the place of its cell, whichever font a reader has for it.

    Signs beyond ASCII come from another font where the monospaced one lacks them, and are as wide as that has them:
    what comes behind them would move. Braille and lines of frames are drawn.
    """
    cells = html.unescape(content).replace('\n', '')
    left, top = float(x), float(y) - BASELINE
    shapes: list[str] = []
    for found in re.finditer(r'[ -~\xa0]+|.', cells):
        text, begin, count = found[0], left + CELL_WIDTH * found.start(), found.end() - found.start()
        if '\u2800' <= text <= '\u28ff':
            shapes += [f'M{begin + across:.2f} {top + down:.2f}h{DOT}v{DOT}h-{DOT}z' for across, down in dots(text)]
        elif text in '│─':
            line = f'{begin + CELL_WIDTH / 2 - 0.6:.2f} {top:.2f}h1.2v{CELL_HEIGHT}h-1.2z'
            across = f'{begin:.2f} {top + CELL_HEIGHT / 2:.2f}h{CELL_WIDTH}v1.2h-{CELL_WIDTH}z'
            shapes.append(f'M{line if text == "│" else across}')
        elif text.isascii() or '\xa0' in text:
            if text.strip():
                length = f'textLength="{CELL_WIDTH * count:.1f}"'
                yield f'<text {attributes}x="{begin:.1f}" y="{y}" {length}{rest}>{html.escape(text)}</text>'
        else:
            yield f'<text {attributes}x="{begin + CELL_WIDTH / 2:.1f}" y="{y}" text-anchor="middle"{rest}>{text}</text>'
    if shapes:
        yield f'<path {attributes}d="{"".join(shapes)}"/>'


def dots(sign: str) -> Iterator[tuple[float, float]]:
    """Return where the dots of a sign of braille are in its cell: two columns of four."""
    for bit, (column, row) in enumerate(((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))):
        if ord(sign) >> bit & 1:
            yield column * CELL_WIDTH / 2, row * CELL_HEIGHT / 4


if __name__ == '__main__':
    target(__doc__, PICTURE).write_text(picture(operate()), encoding='utf-8')
