# SPDX-License-Identifier: BSD-3-Clause
"""The user interfaces of the console, what they share, and the executable that chooses among them."""
