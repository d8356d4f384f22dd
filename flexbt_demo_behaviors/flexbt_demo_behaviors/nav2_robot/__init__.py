# SPDX-License-Identifier: BSD-3-Clause
"""A robot of Nav2 under an operator: trees, a program, and a behavior that the program calls."""
