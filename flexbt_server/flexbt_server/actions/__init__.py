# SPDX-License-Identifier: BSD-3-Clause
"""The actions and services of the BT server."""

from .control_server import ControlServer
from .data_servers import DataServers
from .execute_server import ExecuteServer
from .load_server import LoadServer

__all__ = ['ControlServer', 'DataServers', 'ExecuteServer', 'LoadServer']
