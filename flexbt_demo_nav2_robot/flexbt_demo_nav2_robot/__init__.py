# SPDX-License-Identifier: BSD-3-Clause
"""A robot of Nav2, and an operator on top."""
