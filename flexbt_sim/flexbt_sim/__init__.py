# SPDX-License-Identifier: BSD-3-Clause
"""A light 2D robot simulator and navigation servers with the interfaces of Nav2."""
