# SPDX-License-Identifier: BSD-3-Clause
"""What watches the ticks of a tree, and what Groot2 and the status stream stand on."""

from .status_log import PLACES, SHIFT, Log, LogReader, StatusLog, log_reader

__all__ = ['PLACES', 'SHIFT', 'Log', 'LogReader', 'StatusLog', 'log_reader']
