# SPDX-License-Identifier: BSD-3-Clause
"""What the executive writes to disk: the journal for restarts, and the event log with its report."""
