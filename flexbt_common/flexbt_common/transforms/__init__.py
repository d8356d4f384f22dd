# SPDX-License-Identifier: BSD-3-Clause
"""Frames and the transforms between them: a buffer with the rules of tf2, and what fills it from ``tf``."""

from .buffer import HISTORY, TransformBuffer
from .listener import BROADCASTERS, TRANSFORM_TIMEOUT, TransformListener, take_transforms, transformed
from .rigid_transform import Rigid

__all__ = [
    'BROADCASTERS',
    'HISTORY',
    'TRANSFORM_TIMEOUT',
    'Rigid',
    'TransformBuffer',
    'TransformListener',
    'take_transforms',
    'transformed',
]
