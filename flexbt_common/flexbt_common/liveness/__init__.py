# SPDX-License-Identifier: BSD-3-Clause
"""Whether others are there."""
