# SPDX-License-Identifier: BSD-3-Clause
"""The files that the executive writes: the journal for restarts, and the event log with its reports."""
