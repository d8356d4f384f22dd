# SPDX-License-Identifier: BSD-3-Clause
"""Packages with FlexBE's names. :mod:`flexbt_flexbe.shim` puts this directory on Python's path and has the table of
their modules.
"""
