# SPDX-License-Identifier: BSD-3-Clause
"""``flexbe_core`` on FlexBT's engine: states, containers, behaviors, loggers and proxies."""
