# SPDX-License-Identifier: BSD-3-Clause
"""The interactive prompt: a line to type on, the present state below it, events above it."""
