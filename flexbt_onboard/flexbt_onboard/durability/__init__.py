# SPDX-License-Identifier: BSD-3-Clause
"""What survives a crash."""
