# SPDX-License-Identifier: BSD-3-Clause
"""Missions and requests for synthesis in files, and what a robot asks of this package."""
