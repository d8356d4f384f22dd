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

OPTION_LENGTHS: Final[Mapping[str, int]] = {'window': 16, 'place': 256, 'wanted': 20}
"""Maximum characters of the string fields of the options of a queue entry, and maximum number of outcomes."""

OUTCOME_LENGTH: Final = 256

OPEN_REQUESTS: Final = 32
"""Maximum number of input requests that may wait at a time, since every status lists them. The limits of all messages
apply to their size (:mod:`flexbt_common.values.limits`)."""


def excess_of_command(command: ExecutiveCommand) -> str:
    """Return a text about the part of a command that is too large; '' if every part fits."""
    for name, limit in (('arguments', ARGUMENTS), ('inputs', INPUTS), ('queue_options', 1)):
        if (count := len(getattr(command, name))) > limit:
            return f'{name} has at most {limit} entries, not {count}'
    parts = [
        (command, COMMAND_LENGTHS, ''),
        *((argument, ARGUMENT_LENGTHS, 'arguments: ') for argument in command.arguments),
        *((entry, INPUT_LENGTHS, 'inputs: ') for entry in command.inputs),
        *((options, OPTION_LENGTHS, 'queue_options: ') for options in command.queue_options),
    ]
    for message, lengths, where in parts:
        for field, limit in lengths.items():
            if (length := len(getattr(message, field))) > limit:
                unit = {'data': 'bytes', 'wanted': 'outcomes'}.get(field, 'characters')
                return f'{where}{field} has at most {limit} {unit}, not {length}'
    outcomes = (len(outcome) for options in command.queue_options for outcome in options.wanted)
    if (length := max(outcomes, default=0)) > OUTCOME_LENGTH:
        return f'queue_options: an outcome has at most {OUTCOME_LENGTH} characters, not {length}'
    return ''
