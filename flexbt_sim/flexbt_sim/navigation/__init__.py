# SPDX-License-Identifier: BSD-3-Clause
"""Planning and control. Pure."""
