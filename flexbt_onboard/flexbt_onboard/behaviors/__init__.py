# SPDX-License-Identifier: BSD-3-Clause
"""What an installed behavior is, and how one is built."""
