# SPDX-License-Identifier: BSD-3-Clause
"""The program of a fork that acts as a Python process: it interprets the command line like the interpreter."""

from __future__ import annotations

import faulthandler
import runpy
import sys
from pathlib import Path
from types import ModuleType

# Imports of test programs: a fork of a process that has loaded them need not load them again.
import flexbt_common.calls.action_call
import flexbt_common.calls.goal_server
import flexbt_common.calls.links
import flexbt_common.calls.service_call
import flexbt_common.lifecycle.liveliness
import flexbt_common.lifecycle.managed_node
import flexbt_common.lifecycle.presence
import flexbt_common.runtime.node_runtime  # noqa: F401


def main() -> int:
    """Run ``-c TEXT``, ``-m MODULE`` or ``FILE`` with the arguments that follow, and return the exit code."""
    faulthandler.enable()
    how, *rest = sys.argv[1:]
    if how == '-c':
        text, *arguments = rest
        sys.argv, sys.path[0] = [how, *arguments], ''
        program = sys.modules['__main__'] = ModuleType('__main__')
        exec(compile(text, '<string>', 'exec'), program.__dict__)  # noqa: S102  # that of a test
    elif how == '-m':
        module, *arguments = rest
        sys.argv, sys.path[0] = [module, *arguments], str(Path.cwd())
        runpy.run_module(module, run_name='__main__', alter_sys=True)
    else:
        sys.argv, sys.path[0] = [how, *rest], str(Path(how).parent)
        runpy.run_path(how, run_name='__main__')
    return 0
