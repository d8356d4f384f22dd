# SPDX-License-Identifier: BSD-3-Clause
"""What watches the ticks of a tree, and what Groot2 and the status stream stand on."""
