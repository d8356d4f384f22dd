# SPDX-License-Identifier: BSD-3-Clause
"""Who watches the ticks of a tree."""
