# SPDX-License-Identifier: BSD-3-Clause
"""The user interfaces of the console."""
