# SPDX-License-Identifier: BSD-3-Clause
"""What only makes it faster."""
