# SPDX-License-Identifier: BSD-3-Clause
"""A bounded cache of objects that are made on first use, by name."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Key = TypeVar('Key', bound=Hashable)
Thing = TypeVar('Thing')


class WeakLruCache(Generic[Key, Thing]):
    """A cache that keeps each object that is in use, and the ``most`` recently used of the others. From any thread."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._all: weakref.WeakValueDictionary[Key, Thing] = weakref.WeakValueDictionary()
        self._last: OrderedDict[Key, Thing] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, key: Key) -> Thing | None:
        """Return the thing of this key, if there is one."""
        return self._all.get(key)

    def used(self, key: Key) -> Thing | None:
        """Return the thing of this key, if there is one; it is used now."""
        with self._lock:
            thing = self._all.get(key)
            if thing is not None:
                self._keep(key, thing)
            return thing

    def get(self, key: Key, make: Callable[[], Thing]) -> Thing:
        """Return the object of this key, made now if there is none. The caller has to hold it while it is used."""
        with self._lock:
            thing = self._all.get(key)
            if thing is None:
                thing = self._all[key] = make()
            self._keep(key, thing)
            return thing

    def _keep(self, key: Key, thing: Thing) -> None:
        self._last[key] = thing
        self._last.move_to_end(key)
        if len(self._last) > self._most:
            self._last.popitem(last=False)

    def __len__(self) -> int:
        return len(self._all)
