# SPDX-License-Identifier: BSD-3-Clause
"""Follow all that can happen to a tree or to a machine, with the real engines."""
