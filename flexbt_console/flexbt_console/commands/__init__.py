# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the console: their registry, and what is derived from it. Without ROS."""

from .command_builder import CommandBuilder
from .command_line import COMMON_OPTIONS, check, parse
from .completion import Offer, candidates, offers
from .help import EXIT_CODES, command_help, overview, prompt_command_help, prompt_help
from .operator_values import (
    autonomy_level,
    full_namespace,
    load_places,
    parameter_value,
    port_number,
    start_input,
    value_text,
)
from .registry import COMMANDS, build, find
from .shell_completion import TypedLine, as_typed, completion_script, read_line, shell_words
from .showing import SCAN_PERIOD
from .spec import (
    DECISION,
    UNSEEN,
    Answers,
    Argument,
    Ask,
    AskedRobot,
    CommandedRobot,
    CommandLine,
    CommandSpec,
    Known,
    LinkNeed,
    Mode,
    NobodyAsked,
    Option,
    Send,
    Show,
    Shown,
    Typed,
)

__all__ = [
    'COMMANDS',
    'COMMON_OPTIONS',
    'DECISION',
    'EXIT_CODES',
    'SCAN_PERIOD',
    'UNSEEN',
    'Answers',
    'Argument',
    'Ask',
    'AskedRobot',
    'CommandBuilder',
    'CommandLine',
    'CommandSpec',
    'CommandedRobot',
    'Known',
    'LinkNeed',
    'Mode',
    'NobodyAsked',
    'Offer',
    'Option',
    'Send',
    'Show',
    'Shown',
    'Typed',
    'TypedLine',
    'as_typed',
    'autonomy_level',
    'build',
    'candidates',
    'check',
    'command_help',
    'completion_script',
    'find',
    'full_namespace',
    'load_places',
    'offers',
    'overview',
    'parameter_value',
    'parse',
    'port_number',
    'prompt_command_help',
    'prompt_help',
    'read_line',
    'shell_words',
    'start_input',
    'value_text',
]
