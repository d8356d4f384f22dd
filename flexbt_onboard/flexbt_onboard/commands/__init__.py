# SPDX-License-Identifier: BSD-3-Clause
"""Commands of operators: what each needs and does, who may give them, and what became of them."""

from .authority import Authority
from .command_bounds import COMMAND_LENGTHS
from .command_handlers import COMMANDS
from .command_ledger import OPEN_COMMANDS, REPORT_TIME, CommandLedger
from .command_registry import Command, CommandRegistry, NeededRun
from .input_requests import InputRequests
from .operator_names import OperatorNames

__all__ = [
    'COMMANDS',
    'COMMAND_LENGTHS',
    'OPEN_COMMANDS',
    'REPORT_TIME',
    'Authority',
    'Command',
    'CommandLedger',
    'CommandRegistry',
    'InputRequests',
    'NeededRun',
    'OperatorNames',
]
