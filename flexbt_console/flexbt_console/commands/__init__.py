# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the console: how they are written, completed and built."""
