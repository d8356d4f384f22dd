# SPDX-License-Identifier: BSD-3-Clause
"""The start of every executable. It imports only the standard library, and runs before anything else is loaded."""

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
"""Address space that a node uses with its middleware and threads, bytes; it uses a tenth of that as memory."""


def skip_message_generator() -> None:
    """Let no package of messages load the generator of message code with its parsers, with the first message that is
    sent. rosidl_generator_py supports a failed import of this generator.
    """
    sys.modules.setdefault('rosidl_generator_py.generate_py_impl', None)  # type: ignore[arg-type]  # see sys.modules


def load(module: str) -> ModuleType:
    """Import the module of an executable.

    This skips two things that no executable needs: garbage collections among modules that stay, and
    :func:`skip_message_generator`.
    """
    skip_message_generator()
    gc.disable()
    loaded = importlib.import_module(module)
    gc.freeze()
    gc.enable()
    return loaded


def run_main(module: str, *, raises_interrupt: bool = False, address_space: int = 0) -> int:
    """Import a module, which may take a second, and run its ``main()``. Return the exit code of the process.

    Until ``main()`` installs a handler, SIGINT ends the process by that signal (130 in a shell). Python's default
    handler would raise KeyboardInterrupt anywhere: raised in a callback of importlib or of the garbage collector, it is
    only printed to standard error. An ignored SIGINT stays ignored, as for background jobs of a shell.
    With ``raises_interrupt``, ``main()`` runs with Python's handler.

    A standard stream that was closed before, as by ``<&-`` in a shell, is that of the null device: it has nothing to
    read, takes any text, and is no terminal.

    If the limit of the process is below ``address_space`` bytes, print that and import nothing: libraries hang or abort
    without memory. The matrix library starts no threads, since its memory grows with the number of processors.
    """
    for stream, mode in {'stdin': 'r', 'stdout': 'w', 'stderr': 'w'}.items():
        if getattr(sys, stream) is None:
            setattr(sys, stream, open(os.devnull, mode))  # noqa: PTH123, SIM115 - it stays open; pathlib is slow
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < address_space:
        name = os.path.basename(sys.argv[0])  # noqa: PTH119 - pathlib's import is slow
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
