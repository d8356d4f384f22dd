# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import NODE_BYTES, run_main


def bt_server() -> int:
    """Run :mod:`flexbt_server.bt_server` and return the exit code."""
    return run_main('flexbt_server.bt_server', address_space=NODE_BYTES)
