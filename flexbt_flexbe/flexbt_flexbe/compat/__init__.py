# SPDX-License-Identifier: BSD-3-Clause
"""Packages of FlexBE's names; this directory is what :mod:`flexbt_flexbe.shim` puts on Python's path. Their modules are
in a table there.
"""
