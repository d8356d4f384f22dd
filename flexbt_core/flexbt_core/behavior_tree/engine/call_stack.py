# SPDX-License-Identifier: BSD-3-Clause
"""Room for the nested calls by which a deep tree is ticked."""

from __future__ import annotations

import functools
import sys
import types
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar('T')

# Nested Python frames per level of a tree (a node whose tick is Python code in a base class of ours has three; its
# pre- and post-conditions have up to three more), and what host and leaves need on top.
_FRAMES_PER_LEVEL: Final = 6
_FRAMES_OF_HOST: Final = 1000

# CPython keeps the frames of Python calls in chunks of 16 KiB, which it gets from the system, and gives back, one by
# one as calls nest and return. A call whose frame is larger gets a chunk of the next power of two that holds it.
_CHUNK_BYTES: Final = 1 << 14
_SLOT_BYTES: Final = 8
_SLOTS_PER_FRAME: Final = 24
_FEW_CHUNKS: Final = 20


def with_room(call: Callable[[], T], depth: int) -> Callable[[], T]:
    """``call``, to be called instead of it when it nests as deep as a tree of ``depth`` levels.

    Raises the recursion limit if need be. It holds for the whole process, so it is only ever raised; it guards the
    C stack against recursion without end, and calls from Python to Python, which ticks are, do not use the C stack.
    """
    frames = depth * _FRAMES_PER_LEVEL
    if sys.getrecursionlimit() < frames + _FRAMES_OF_HOST:
        sys.setrecursionlimit(frames + _FRAMES_OF_HOST)
    wanted = frames * _SLOTS_PER_FRAME * _SLOT_BYTES
    if wanted <= _FEW_CHUNKS * _CHUNK_BYTES:
        return call
    # Half of the chunk is the frame of this call, which does not use it; the other half is for the calls within.
    half = _CHUNK_BYTES
    while half < wanted:
        half *= 2
    code = _call.__code__.replace(co_stacksize=half // _SLOT_BYTES)
    return functools.partial(types.FunctionType(code, globals()), call)


def _call(call: Callable[[], T]) -> T:
    return call()
