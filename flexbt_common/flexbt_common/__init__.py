# SPDX-License-Identifier: BSD-3-Clause
"""What every FlexBT node shares: typed values, action calls with deadlines, liveliness, start and stop."""
