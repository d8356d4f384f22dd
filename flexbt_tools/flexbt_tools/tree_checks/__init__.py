# SPDX-License-Identifier: BSD-3-Clause
"""Checks for errors and suspicious parts of tree files."""
