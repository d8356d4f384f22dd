# SPDX-License-Identifier: BSD-3-Clause
"""A robot of real processes, started and killed, supervised by an operator, behind a bad network."""
