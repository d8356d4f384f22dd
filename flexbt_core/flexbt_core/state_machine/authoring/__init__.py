# SPDX-License-Identifier: BSD-3-Clause
"""Writing machines: in Python as in FlexBE, typed, or in YAML - and the checks that they pass."""
