# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's onboard executive, also where tf2_ros is not installed."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType


def do_without_tf2() -> None:
    """flexbe_core imports tf2_ros; nothing that is measured uses it."""
    if importlib.util.find_spec('tf2_ros') is None:
        sys.modules['tf2_ros'] = ModuleType('tf2_ros')


if __name__ == '__main__':
    do_without_tf2()
    from flexbe_onboard import start_behavior

    start_behavior.main()
