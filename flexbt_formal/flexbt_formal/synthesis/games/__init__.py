# SPDX-License-Identifier: BSD-3-Clause
"""Games of the form GR(1) between the world and the system: specifications, who wins, how, and the proof of it."""
