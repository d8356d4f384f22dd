# SPDX-License-Identifier: BSD-3-Clause
"""Installed behaviors, the construction of their runs, and the services that states get from their host."""
