# SPDX-License-Identifier: BSD-3-Clause
"""Real nodes in the process of a test: scripted servers, an operator, an executive, a BT server, a simulator.

Its modules are its front doors: who takes one is spared what the others import.
"""
