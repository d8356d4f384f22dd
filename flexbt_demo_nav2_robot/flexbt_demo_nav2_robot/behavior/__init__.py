# SPDX-License-Identifier: BSD-3-Clause
"""The behavior that a program asks."""

from .ask_operator import TREE, AskOperator

__all__ = ['TREE', 'AskOperator']
