# SPDX-License-Identifier: BSD-3-Clause
"""The packages that stand in for FlexBE's; this directory is what :mod:`flexbt_flexbe.shim` puts on Python's path."""
