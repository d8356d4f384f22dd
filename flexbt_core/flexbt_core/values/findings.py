# SPDX-License-Identifier: BSD-3-Clause
"""The record of a finding for programs. All tools print it with ``--json``.

``docs/reference/findings.md`` describes it for users.
"""

from __future__ import annotations

import re
from typing import Final, TypedDict


class FindingRecord(TypedDict):
    """One finding.

    ``rule`` identifies its kind. ``severity`` is ``error``, ``warning``, ``info`` or ``ok``. Lines and columns count
    from 1, and are 0 if it has no place in a file. ``end_line`` and ``end_column`` are the place behind the last
    character; they equal the start if only that is known. ``node`` is the element, node, state or key. ``fix`` says
    what to do; '' if ``message`` says all that is known.
    """

    rule: str
    severity: str
    file: str
    line: int
    column: int
    end_line: int
    end_column: int
    node: str
    message: str
    fix: str


_PLACE: Final = re.compile(r'(?P<file>[^:\n]+\.\w+):(?P<line>\d{1,9})(?::(?P<column>\d{1,9}))?: ')
_END: Final = re.compile(r' \((?P<file>[^:()\n]+\.\w+):(?P<line>\d{1,9})\)$')


def finding_record(
    rule: str,
    severity: str,
    message: str,
    *,
    file: str = '',
    start: tuple[int, int] = (0, 0),
    end: tuple[int, int] = (0, 0),
    node: str = '',
    fix: str = '',
) -> FindingRecord:
    """Return the record of a finding, from ``start`` to ``end`` (line and column) in ``file``. Without ``file`` take
    the place from a message that begins with ``file:line: `` or ``file:line:column: ``, or ends with ``(file:line)``.

    Without ``fix`` take what the message says after its last semicolon: messages say what is wrong, then what to do.
    """
    if not file:
        if found := _PLACE.match(message):
            file, start = found['file'], (int(found['line']), int(found['column'] or 1))
            message = message[found.end() :]
        elif found := _END.search(message):
            file, start = found['file'], (int(found['line']), 1)
    return FindingRecord(
        rule=rule,
        severity=severity,
        file=file,
        line=start[0],
        column=start[1],
        end_line=end[0] or start[0],
        end_column=end[1] or start[1],
        node=node,
        message=message,
        fix=fix or message.rpartition('; ')[2] * ('; ' in message),
    )
