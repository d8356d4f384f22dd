# SPDX-License-Identifier: BSD-3-Clause
"""The process that sends one message to one address, or names the services of addresses.

It reads a task as JSON from standard input: addresses are secrets, which neither a command line nor a log may have.
apprise waits for services without limits, and writes addresses into its log. So it runs here only: without standard
error, ended by SIGALRM, and with an answer of fixed words. The process goes on when its program ends or is killed, and
notes itself that a message is delivered.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
import signal
import sys
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final

from flexbt_console.alerts.delivered import SEND_SECONDS, mark_delivered

_ANSWER: Final = re.compile(r"error\s*[=:]\s*(\d{3})\b|\((\d{3}), b['\"]")
_ERRNO: Final = re.compile(r'\[Errno (\d{1,3})\]')
_CERTAIN: Final = (
    ('Name or service not known', 'its name is not known'),
    ('Temporary failure in name resolution', 'its name cannot be looked up'),
    ('certificate', 'its certificate is not valid'),
    ('Connection refused', 'it refused the connection'),
)


def reason(text: str) -> tuple[str, bool]:
    """Return why apprise could not send, from its log, in words that cannot contain an address. The service certainly
    does not have the message if the second part is True."""
    if found := _ANSWER.search(text):
        code = int(found[1] or found[2])
        return (
            f'it answered {code} {HTTPStatus(code).phrase if found[1] and code in {*HTTPStatus} else ""}'.rstrip(),
            True,
        )
    for word, told in _CERTAIN:
        if word in text:
            return told, True
    if 'timed out' in text:
        return 'it did not answer in time', False
    return os.strerror(int(found[1])) if (found := _ERRNO.search(text)) else 'apprise could not send it', False


def do(task: dict[str, Any]) -> dict[str, Any]:
    """Carry out a task, and return the answer."""
    import apprise

    heard = io.StringIO()
    logging.getLogger().addHandler(logging.StreamHandler(heard))
    logging.getLogger('apprise').setLevel(logging.DEBUG)
    if 'addresses' in task:
        known = [apprise.Apprise.instantiate(address) for address in task['addresses']]
        return {'services': ['' if one is None else str(one.service_name) for one in known]}
    sender = apprise.Apprise()
    if not sender.add(task['address']):
        return {'reason': 'apprise does not know such an address', 'is_certain': True}
    heard.truncate(heard.seek(0))
    if not sender.notify(task['body'], task['title'], task['type'], apprise.NotifyFormat.TEXT):
        why, is_certain = reason(heard.getvalue())
        return {'reason': why, 'is_certain': is_certain}
    return {'is_recorded': mark_delivered(Path(task['state']), task['calls']) if task['calls'] else True}


def main() -> None:
    """Read the task, and write the answer."""
    signal.setitimer(signal.ITIMER_REAL, SEND_SECONDS)  # ends the process
    for number in (signal.SIGINT, signal.SIGTERM):  # which are for the program: a message is sent to its end
        signal.signal(number, signal.SIG_IGN)
    try:
        answer = do(json.loads(sys.stdin.buffer.read()))
    except Exception as error:  # of a plug-in; its text may contain the address
        answer = {'reason': f'apprise failed with {type(error).__name__}'}
    print(json.dumps(answer), flush=True)


if __name__ == '__main__':
    main()
