# SPDX-License-Identifier: BSD-3-Clause
"""How machines are written."""
