# SPDX-License-Identifier: BSD-3-Clause
"""Where a thread that ticks a tree is: in the code of which node."""

from __future__ import annotations

import sys
import threading

from flexbt_core.behavior_tree import TreeNode


def node_on_stack(thread: threading.Thread) -> TreeNode | None:
    """The innermost node whose methods are on the stack of ``thread``; None when there is none."""
    frame = sys._current_frames().get(thread.ident or 0)
    while frame is not None:
        owner = frame.f_locals.get('self')
        if isinstance(owner, TreeNode):
            return owner
        frame = frame.f_back
    return None
