# SPDX-License-Identifier: BSD-3-Clause
"""Machines written as in FlexBE, as typed Python, or as YAML, and the checks before they run."""
