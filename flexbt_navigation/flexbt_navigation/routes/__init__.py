# SPDX-License-Identifier: BSD-3-Clause
"""The route server, its graph, and how routes are planned and tracked."""
