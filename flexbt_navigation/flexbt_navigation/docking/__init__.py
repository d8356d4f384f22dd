# SPDX-License-Identifier: BSD-3-Clause
"""The docking server, its database of docks and its control law."""
