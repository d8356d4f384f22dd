# SPDX-License-Identifier: BSD-3-Clause
"""Shared by the demonstrations: options, processes, session, scripted operator, report and picture."""
