# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import NODE_BYTES, run_main


def onboard_executive() -> int:
    """See :mod:`flexbt_onboard.node.onboard_executive`; gives the exit code."""
    return run_main('flexbt_onboard.node.onboard_executive', address_space=NODE_BYTES)


def stop_guard() -> int:
    """See :mod:`flexbt_onboard.node.stop_guard`; gives the exit code."""
    return run_main('flexbt_onboard.node.stop_guard', address_space=NODE_BYTES)


def run_report() -> int:
    """See :mod:`flexbt_onboard.persistence.run_report`; gives the exit code."""
    return run_main('flexbt_onboard.persistence.run_report')
