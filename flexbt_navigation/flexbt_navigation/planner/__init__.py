# SPDX-License-Identifier: BSD-3-Clause
"""The planner server and the smoother server, with their algorithms."""
