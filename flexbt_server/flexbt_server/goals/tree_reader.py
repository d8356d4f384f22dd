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
processor either, the disk does not answer, and the server is not ready."""

SLOW_SECONDS: Final = 60.0
"""What is only slow, so that the thread uses the processor, is logged; after this time, s, the server is not ready
either: it may never end."""

_FILES: Final = 'files'
"""The part of the server that is not ready then."""

_SLOW: Final = 'it is still being read: smaller files, or a faster computer'


def tree_reader(runtime: NodeRuntime) -> WorkThread:
    """A reader, until the end of the node. What it is given is named by what was not done: 'tree x was not read'."""
    token = LivelinessToken(runtime)
    lock = threading.Lock()
    is_open, told = True, ''

    def late(work: LateWork | None) -> None:
        nonlocal told
        reason = _reason(work)
        with lock:
            if not is_open or reason == told:  # once it is closed, what the token says is of another reader
                return
            told, why = reason, ''
            if work is not None:
                why = f'{work.what} within {work.seconds:g} s, goals wait: {reason}'
                runtime.node.get_logger().warning(why)
            token.set_ready(reason in ('', _SLOW), _FILES, why)

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


def _reason(work: LateWork | None) -> str:
    """Why it takes so long; '' when it does not."""
    if work is None:
        return ''
    if not work.uses_processor:
        return 'does the disk answer?'
    return _SLOW if work.seconds < SLOW_SECONDS else 'it is still being read, and may never end'
