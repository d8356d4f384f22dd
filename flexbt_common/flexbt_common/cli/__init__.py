# SPDX-License-Identifier: BSD-3-Clause
"""What command-line programs share."""

from .streams import abandon_stdout, keep_stdout_for_python, make_streams_safe
from .user_files import USER_DIRECTORY, home_path, node_file

__all__ = ['USER_DIRECTORY', 'abandon_stdout', 'home_path', 'keep_stdout_for_python', 'make_streams_safe', 'node_file']
