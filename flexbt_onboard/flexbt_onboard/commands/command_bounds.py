# SPDX-License-Identifier: BSD-3-Clause
"""Limits for commands and input requests, checked before anything is stored, logged or journaled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flexbt_msgs.msg import ExecutiveCommand

COMMAND_LENGTHS: Final[Mapping[str, int]] = {
    'id': 128,
    'operator_id': 128,
    'executive_id': 128,
    'run_id': 128,
    'decision_id': 128,
    'path': 4096,
    'outcome': 256,
    'tree_run_id': 128,
    'behavior': 256,
    'grantee': 128,
    'text': ExecutiveCommand.NOTE_LENGTH,
    'reason': 1000,
}
"""Maximum characters of each string field of an ExecutiveCommand."""

ARGUMENTS: Final = 100
ARGUMENT_LENGTHS: Final[Mapping[str, int]] = {'name': 256, 'value': 10_000}
"""Maximum characters of each field of the arguments of a START or SWITCH."""

INPUTS: Final = 100
INPUT_LENGTHS: Final[Mapping[str, int]] = {'key': 256, 'type': 256, 'text': 100_000, 'data': 1_000_000}
"""Maximum characters of each field of the inputs of a START or ANSWER, and maximum bytes of their data."""

OPEN_REQUESTS: Final = 32
"""Maximum number of input requests that may wait at a time, since every status lists them. The limits of all messages
apply to their size (:mod:`flexbt_common.values.limits`)."""


def excess_of_command(command: ExecutiveCommand) -> str:
    """Return a text about the part of a command that is too large; '' if every part fits."""
    for name, limit in (('arguments', ARGUMENTS), ('inputs', INPUTS)):
        if (count := len(getattr(command, name))) > limit:
            return f'{name} has at most {limit} entries, not {count}'
    parts = [
        (command, COMMAND_LENGTHS, ''),
        *((argument, ARGUMENT_LENGTHS, 'arguments: ') for argument in command.arguments),
        *((entry, INPUT_LENGTHS, 'inputs: ') for entry in command.inputs),
    ]
    for message, lengths, where in parts:
        for field, limit in lengths.items():
            if (length := len(getattr(message, field))) > limit:
                unit = 'bytes' if field == 'data' else 'characters'
                return f'{where}{field} has at most {limit} {unit}, not {length}'
    return ''
