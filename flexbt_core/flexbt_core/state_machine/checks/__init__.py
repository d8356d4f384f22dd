# SPDX-License-Identifier: BSD-3-Clause
"""A machine as a whole: targets, conditions, data flow, endings."""
