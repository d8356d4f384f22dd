# SPDX-License-Identifier: BSD-3-Clause
"""What command-line programs share."""

from .arguments import HintingArgumentParser
from .signals import restored_signals
from .streams import abandon_stdout, is_full, keep_stdout_for_python, make_streams_safe, report_full_output
from .user_files import USER_DIRECTORY, home_path, node_file

__all__ = [
    'USER_DIRECTORY',
    'HintingArgumentParser',
    'abandon_stdout',
    'home_path',
    'is_full',
    'keep_stdout_for_python',
    'make_streams_safe',
    'node_file',
    'report_full_output',
    'restored_signals',
]
