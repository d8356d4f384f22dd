# SPDX-License-Identifier: BSD-3-Clause
"""A robot that plans its way to a goal."""
