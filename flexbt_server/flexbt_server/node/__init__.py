# SPDX-License-Identifier: BSD-3-Clause
"""The managed node bt_server and its parameters."""

from .bt_server import BtServer
from .parameters import declare_parameters

__all__ = ['BtServer', 'declare_parameters']
