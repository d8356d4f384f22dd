# SPDX-License-Identifier: BSD-3-Clause
"""States, outcomes, userdata, autonomy and definitions."""
