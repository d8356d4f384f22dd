# SPDX-License-Identifier: BSD-3-Clause
"""The thread that reads the files of trees and the values of blackboards, in the order of the goals."""

from __future__ import annotations

import threading
from typing import Final

from flexbt_common.liveness import LivelinessToken
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import WorkThread

READ_SECONDS: Final = 5.0
"""The server is not ready while what one goal names takes longer than this to be read, s: its disk may not answer."""

_FILES: Final = 'files'
"""The part of the server that is not ready then."""


def tree_reader(runtime: NodeRuntime) -> WorkThread:
    """A reader, until the end of the node. What it is given is named by what was not done: 'tree x was not read'."""
    token = LivelinessToken(runtime)
    lock = threading.Lock()
    is_open = True

    def late(what: str) -> None:
        why = f'{what} within {READ_SECONDS:g} s, goals wait: does the disk answer?' if what else ''
        with lock:
            if not is_open:  # what the token says is of another reader
                return
            if why:
                runtime.node.get_logger().warning(why)
            token.set_ready(not why, _FILES, why)

    def fault(error: BaseException) -> None:
        runtime.post(lambda: runtime.report_fault(error, 'the thread that reads trees'))

    reader = WorkThread('tree_reader', runtime.steady, READ_SECONDS, late, fault)

    def close() -> None:
        """Of the token, which the node keeps, take back what was said of a read that may never end."""
        nonlocal is_open
        reader.close()
        with lock:
            is_open = False
            token.set_ready(True, _FILES)

    runtime.on_close(close)
    return reader
