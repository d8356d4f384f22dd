# SPDX-License-Identifier: BSD-3-Clause
"""The node types, one family a file."""
