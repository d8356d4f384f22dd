# SPDX-License-Identifier: BSD-3-Clause
"""The start of every executable. It imports only the standard library, so it runs before anything else is loaded."""

from __future__ import annotations

import gc
import importlib
import os
import resource
import signal
import sys
from types import ModuleType
from typing import Final

NODE_BYTES: Final = 1_100_000_000
"""Bytes of address space that a node uses with its middleware and its threads; it uses a tenth of that as memory."""


def load(module: str) -> ModuleType:
    """Import the module of an executable.

    That is spared what no executable needs: collections of garbage among modules that stay, and the generator of
    message code (with its parsers), which each package of messages loads otherwise. rosidl_generator_py is made to
    work where that cannot be imported.
    """
    sys.modules.setdefault('rosidl_generator_py.generate_py_impl', None)  # type: ignore[arg-type]  # see sys.modules
    gc.disable()
    loaded = importlib.import_module(module)
    gc.freeze()
    gc.enable()
    return loaded


def run_main(module: str, *, raises_interrupt: bool = False, address_space: int = 0) -> int:
    """Import a module, which may take a second, and run its ``main()``; gives the exit code of the process.

    Until ``main()`` installs its own handler, a SIGINT ends the process by that signal (130 for a shell): Python's
    own raises KeyboardInterrupt wherever the program is, and from a callback of importlib or of the garbage collector
    that goes no further than to standard error. One that is ignored stays so, as in the background of a shell.
    With ``raises_interrupt``, ``main()`` has Python's handler.

    Where the process may have less than ``address_space`` bytes, this is said, and nothing is imported: libraries hang
    or abort when they find out by themselves. The library of matrices, which takes the more the more processors there
    are, starts no threads.
    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < address_space:
        name = os.path.basename(sys.argv[0])  # noqa: PTH119 - pathlib takes as long as the rest
        print(
            f'{name}: the limit of address space is {limit // 10**6} MB (ulimit -v), and {address_space // 10**6} MB '
            'are needed; raise it, or limit memory by a control group instead',
            file=sys.stderr,
        )
        return 1
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    main = load(module).main
    if raises_interrupt:
        signal.signal(signal.SIGINT, handler)
    exit_code: int = main()
    return exit_code
