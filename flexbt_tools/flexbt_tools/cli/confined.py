# SPDX-License-Identifier: BSD-3-Clause
"""A process that runs one command for ``bt_tool mcp`` or the studio and then ends.

``python3 -P -m flexbt_tools.cli.confined PARENT SECONDS bt_tool check FILE``: the command reads and writes files only
in the working directory, reads installed packages, starts no process, opens no connection, and ends with its parent.
Memory, processor time and the size of files are limited. This holds for what files in the directory make the command
do. It is no jail for native code.
"""

from __future__ import annotations

import ctypes
import errno
import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from flexbt_common.executables import load

TOOLS: Final = {
    'bt_tool': 'flexbt_tools.cli.bt_tool',
    'behavior_tool': 'flexbt_tools.cli.behavior_tool',
    'recorded': 'flexbt_testing.one_process.recorded',
}
"""Module of each tool. That of the last one is in a package that may be missing."""
MAX_MEMORY: Final = 2_000_000_000
MAX_FILE: Final = 10_000_000

_PR_SET_PDEATHSIG: Final = 1  # prctl(2)
_WRITING: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Audit events, https://docs.python.org/3/library/audit_events.html
_READING: Final = frozenset({'os.listdir', 'os.scandir'})
_CHANGING: Final = frozenset(
    {'os.chmod', 'os.chown', 'os.link', 'os.mkdir', 'os.remove', 'os.rename', 'os.rmdir', 'os.setxattr'}
    | {'os.truncate', 'os.utime'}
)
_FORBIDDEN: Final = frozenset(
    {'os.exec', 'os.fork', 'os.forkpty', 'os.posix_spawn', 'os.spawn', 'os.symlink', 'os.system'}
    | {'subprocess.Popen', 'socket.bind', 'socket.connect', 'socket.sendto', 'socket.sendmsg', 'socket.getaddrinfo'}
)


def main() -> int:
    """Limit this process, then run the command of its arguments and return the exit code."""
    parent, seconds, tool, *words = sys.argv[1:]
    if tool not in TOOLS:
        raise ValueError(f'{tool!r} is not one of {", ".join(TOOLS)}')
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):
        return 1  # it has ended before
    for limit, value in (
        (resource.RLIMIT_CPU, int(seconds)),
        (resource.RLIMIT_DATA, MAX_MEMORY),
        (resource.RLIMIT_FSIZE, MAX_FILE),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(limit)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(limit, (least, least))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # nodes find no others
    for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_DISCOVERY_SERVER', 'ROS_STATIC_PEERS'):
        os.environ.pop(name, None)
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    os.environ['TMPDIR'] = os.path.realpath('.')
    packages = [*sys.path, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    sys.addaudithook(_guard(os.path.realpath('.'), [f'{one}/' for one in packages if one.startswith('/')]))
    exit_code: int = load(TOOLS[tool]).main(words)
    return exit_code


def _guard(folder: str, packages: list[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """Return an audit hook that raises PermissionError for what the process may not do."""
    devices = ('/dev/urandom', '/proc/sys/', '/proc/pressure/', f'/proc/{os.getpid()}/')

    def check(path: object, *, changes: bool) -> None:
        if not isinstance(path, (str, bytes, os.PathLike)):
            return  # an open file
        given = os.path.normpath(Path.cwd() / os.fsdecode(path))
        real = os.path.realpath(given)  # /proc has links to everywhere
        if f'{real}/'.startswith(f'{folder}/') or real == os.devnull or (real.startswith(devices) and not changes):
            return
        if changes or not f'{given}/'.startswith(tuple(packages)):
            raise PermissionError(errno.EACCES, 'not in the folder of this server')

    def guard(event: str, given: tuple[Any, ...]) -> None:
        if event == 'open':
            check(given[0], changes=bool(given[2] & _WRITING))
        elif event in _READING:
            check(given[0], changes=False)
        elif event in _CHANGING:
            for path in given[:2]:
                check(path, changes=True)
        elif event in _FORBIDDEN:
            raise PermissionError(errno.EACCES, f'{event} is not allowed in this server')

    return guard


if __name__ == '__main__':
    sys.exit(main())
