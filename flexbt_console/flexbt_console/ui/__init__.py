# SPDX-License-Identifier: BSD-3-Clause
"""The user interfaces of the console, and the executable that chooses among them."""

from .console import main

__all__ = ['main']
