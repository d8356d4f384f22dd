# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that are made while the executive runs: searched for by another process, and kept as data."""

from .flexbe_server import serve_flexbe
from .machine_store import MachineStore
from .synthesis_server import SynthesisServer
from .synthesizer import SearchSettings, Synthesizer

__all__ = ['MachineStore', 'SearchSettings', 'SynthesisServer', 'Synthesizer', 'serve_flexbe']
