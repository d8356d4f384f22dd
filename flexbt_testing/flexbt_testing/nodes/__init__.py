# SPDX-License-Identifier: BSD-3-Clause
"""Real nodes in the process of a test, such as scripted servers, an operator, an executive and a BT server."""
