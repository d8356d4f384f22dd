# SPDX-License-Identifier: BSD-3-Clause
"""Skills of leaves and states: what they need, what they bring about, and how they may fail."""
