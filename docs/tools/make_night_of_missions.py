# SPDX-License-Identifier: BSD-3-Clause
"""Make the pictures of docs/tutorials/night_of_missions.md: the queue, the decision on a phone, the incident's page.

The commands of the page run in a terminal as a reader types them. A test runs them in the same way.

It needs selenium, Chromium and its driver.
"""

from __future__ import annotations

import contextlib
import os
import pty
import re
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from target import target

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / 'docs' / 'tutorials' / 'night_of_missions.md'
IMAGES: Final = ROOT / 'docs' / 'images'
DEADLINE: Final = 300.0
"""Seconds for each command and each awaited event, also on a busy machine."""

PHONE: Final = (390, 844)

_FENCE: Final = '```'
_ASKS_ROBOT: Final = re.compile(r'^(console (?:status|queue|force)\b[^#]*)')


def free_port() -> int:
    with socket.socket() as one:
        one.bind(('127.0.0.1', 0))
        return int(one.getsockname()[1])


class Night:
    """The commands of the page, run in a terminal with ``home`` as the home directory, at free ports."""

    def __init__(self, home: Path) -> None:
        self.folder, self.home = home / 'night', home
        self.port = free_port()
        text = PAGE.read_text(encoding='utf-8').replace('8499', str(free_port()))
        text = text.replace('console web ', f'console web --port {self.port} ').replace('8465', str(self.port))
        blocks = re.findall(rf'^{_FENCE}sh\n(.*?)^{_FENCE}$', text, re.MULTILINE | re.DOTALL)
        self.commands = [line for block in blocks for line in block.splitlines() if line.strip()]
        self.folder.mkdir(parents=True)
        for name, body in re.findall(rf'^`([a-z]+\.\w+)`.*?\n\n{_FENCE}\w+\n(.*?)^{_FENCE}$', text, re.M | re.S):
            (self.folder / name).write_text(body, encoding='utf-8')
        self._said, self._number = '', 0
        self._terminal, inner = pty.openpty()
        environment = os.environ | {'HOME': str(home), 'TERM': 'xterm-256color', 'PS1': ''}
        self._shell = subprocess.Popen(
            ['bash', '--norc', '--noprofile', '--noediting', '-i'],
            cwd=ROOT,
            env=environment,
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
        )
        os.close(inner)
        threading.Thread(target=self._listen, daemon=True).start()
        self.run('stty -echo rows 40 columns 120')

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self._terminal, 65_536):
                self._said += data.decode(errors='replace')

    def type(self, text: str) -> None:
        """Type into the terminal."""
        os.write(self._terminal, text.encode())

    def run(self, line: str, while_it_runs: Callable[[], None] = lambda: None) -> str:
        """Run a command, and return what it prints. Raises RuntimeError if it fails."""
        self._number += 1
        begin, mark = len(self._said), re.compile(rf'@(\d+)@{self._number}@')
        command = re.sub(r'\s+#.*$', '', line)
        after = '' if command.endswith('&') else ';'
        self.type(f"{command}{after} printf '@%s@%s@' $? {self._number}\n")
        while_it_runs()
        code = self.wait_for(lambda: mark.search(self._said, begin), line)[1]
        said = self._said[begin:]
        if code != '0':
            raise RuntimeError(f'{line}: exit code {code}\n{said}')
        return said

    def wait_for(self, found: Callable[[], Any], what: str) -> Any:
        """Wait until ``found`` returns something, and return it. Raises TimeoutError.

        What takes long to find out, by a command, is asked less often: the robot needs the processors.
        """
        begin = asked = time.monotonic()
        while not (value := found()):
            now = time.monotonic()
            if now > begin + DEADLINE:
                raise TimeoutError(f'{what}: not within {DEADLINE:g} s\n{self._said[-3000:]}')
            time.sleep(max(0.1, 3.0 * (now - asked)))
            asked = time.monotonic()
        return value

    def incidents(self) -> list[Path]:
        """Return the folders of the incidents, the oldest first."""
        return sorted(one.parent for one in self.home.glob('.ros/flexbt/incidents/2*/incident.json'))

    def calls(self) -> str:
        """Return what the receiver has printed."""
        file = self.folder / 'calls.log'
        return file.read_text(encoding='utf-8') if file.exists() else ''

    def steps(self) -> Iterator[tuple[str, str]]:
        """Run the commands; yield each with what it has printed. What a reader waits for is waited for before."""
        for line in self.commands:
            command = _ASKS_ROBOT.sub(rf'\1 --timeout {DEADLINE:g} ', line.replace(' --timeout 60', ''))
            if line.startswith('tail -f calls.log'):
                self.wait_for(lambda: 'decision=' in self.calls(), 'the call')
                yield line, self.calls()
            elif line.startswith('console replay'):
                yield line, self.run(line, self._look_at_replay)
            elif line.startswith('kill '):
                yield line, self.run(f'{line}; wait')
            else:
                if line == 'console queue release':
                    self.wait_for(self._is_ready, 'the nodes')
                if line.startswith('console queue  '):
                    self.wait_for(lambda: 'is empty' in self.run('console queue --timeout 60'), 'the end of the queue')
                    self.wait_for(
                        lambda: any('"fault"' in (one / 'incident.json').read_text() for one in self.incidents()),
                        'the incident of the fault',
                    )
                yield line, self.run(command)

    def _is_ready(self) -> bool:
        said = self.run(f'console status --timeout {DEADLINE:g}')
        return all(f'{node} ok' in said for node in ('/bt_server', '/navigation', '/simulator'))

    def _look_at_replay(self) -> None:
        begin = len(self._said)
        self.wait_for(lambda: '\x1b[?1049h' in self._said[begin:], 'the replay')  # it has the whole terminal
        self.type('q')

    def close(self) -> None:
        """End what the shell has started."""
        for pid in subprocess.run(
            ['ps', '-s', str(self._shell.pid), '-o', 'pid='], capture_output=True, text=True
        ).stdout.split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
        self._shell.wait()
        os.close(self._terminal)


def main(directory: Path) -> None:
    """Spend the night and write the pictures."""
    from make_operator_page import Page

    with tempfile.TemporaryDirectory() as home:
        night = Night(Path(home))
        try:
            for line, _ in night.steps():
                if line.startswith('tail -f'):
                    address = re.findall(r'http://\S+decision=\S+', night.calls())[0]
                    for size, name in (((1400, 950), 'mission_queue.png'), (PHONE, 'decision_on_phone.png')):
                        page = Page(address, size)
                        page.wait_text('decision-line', 'cannot be reached')
                        page.wait_text('queue', 'archive')
                        page.wait_text('pose', r'x \d')
                        if size == PHONE:
                            page.resize(size)
                            page.picture('light', directory / name)
                        else:
                            page.part('#queue-pane', directory / name)
                        page.driver.quit()
                elif line.startswith('console incidents latest'):
                    found = [one for one in night.incidents() if one.name.endswith('_fault')]
                    page = Page((found[0] / 'incident.html').as_uri())
                    page.picture('light', directory / 'incident_page.png')
                    page.driver.quit()
        finally:
            night.close()


if __name__ == '__main__':
    main(target(__doc__, IMAGES))
