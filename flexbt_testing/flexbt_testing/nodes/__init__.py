# SPDX-License-Identifier: BSD-3-Clause
"""Real nodes in the process of a test: scripted servers, an operator, an executive, a BT server, a simulator."""
