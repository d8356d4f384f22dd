# SPDX-License-Identifier: BSD-3-Clause
"""A lightweight 2D robot simulator with the standard interfaces of simulators."""
