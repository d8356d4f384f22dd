# SPDX-License-Identifier: BSD-3-Clause
"""Further bases for nodes of one's own: functions, coroutines, work on a thread."""

from .coroutine import CoroutineAction
from .simple import SimpleAction, SimpleDecorator, simple_action, simple_condition, simple_decorator
from .threaded import ThreadedAction

__all__ = [
    'CoroutineAction',
    'SimpleAction',
    'SimpleDecorator',
    'ThreadedAction',
    'simple_action',
    'simple_condition',
    'simple_decorator',
]
