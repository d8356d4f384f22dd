# SPDX-License-Identifier: BSD-3-Clause
"""The thread that reads the files of trees and the values of blackboards, in the order of the goals."""

from __future__ import annotations

import threading
from typing import Final

from flexbt_common.liveness import LivelinessToken
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import LateWork, WorkThread

READ_SECONDS: Final = 5.0
"""What one goal names should be read within this time, s. When it is not, and the thread that reads does not use the
processor either, the disk does not answer, and the server is not ready; what is only slow is logged."""

_FILES: Final = 'files'
"""The part of the server that is not ready then."""


def tree_reader(runtime: NodeRuntime) -> WorkThread:
    """A reader, until the end of the node. What it is given is named by what was not done: 'tree x was not read'."""
    token = LivelinessToken(runtime)
    lock = threading.Lock()
    is_open = True

    def late(work: LateWork | None) -> None:
        is_ready, why = work is None or work.is_slow, ''
        if work is not None:
            reason = 'it is still being read' if is_ready else 'does the disk answer?'
            why = f'{work.what} within {work.seconds:g} s, goals wait: {reason}'
        with lock:
            if not is_open:  # what the token says is of another reader
                return
            if why:
                runtime.node.get_logger().warning(why)
            token.set_ready(is_ready, _FILES, why)

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
