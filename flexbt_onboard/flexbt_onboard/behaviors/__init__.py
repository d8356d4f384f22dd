# SPDX-License-Identifier: BSD-3-Clause
"""Installed behaviors, how one is built, and what its states get from their host."""
