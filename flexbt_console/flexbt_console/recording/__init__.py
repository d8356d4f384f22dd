# SPDX-License-Identifier: BSD-3-Clause
"""Runs as MCAP files, recorded from the topics of a robot and replayed without it."""
