# SPDX-License-Identifier: BSD-3-Clause
"""The nodes: simulator and navigation servers."""
