# SPDX-License-Identifier: BSD-3-Clause
"""GR(1) games between the world and the system: specifications, the winner, its strategy, and the proof."""
