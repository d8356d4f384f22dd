# SPDX-License-Identifier: BSD-3-Clause
"""Skills of leaves and states: their preconditions, effects, and possible failures."""
