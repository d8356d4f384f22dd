# SPDX-License-Identifier: BSD-3-Clause
"""The whole system in one process, on one simulated clock, decided by one seed, without middleware.

:class:`.world.World` is what tests use. :func:`install` has to be called before rclpy or FlexBT is imported; the pytest
plugin (``-p flexbt_testing.one_process.plugin``) does it.

It does not find faults of DDS, of memory, of real signals, or of real time.
"""

from .product import install
from .scheduler import StuckWorldError

__all__ = ['StuckWorldError', 'install']
