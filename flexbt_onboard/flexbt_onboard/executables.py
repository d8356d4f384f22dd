# SPDX-License-Identifier: BSD-3-Clause
"""Entry points of the package's executables; each imports its module when it runs."""

from flexbt_common.executables import NODE_BYTES, run_main


def onboard_executive() -> int:
    """Run :mod:`flexbt_onboard.node.onboard_executive`; return its exit code."""
    return run_main('flexbt_onboard.node.onboard_executive', address_space=NODE_BYTES)


def stop_guard() -> int:
    """Run :mod:`flexbt_onboard.node.stop_guard`; return its exit code."""
    return run_main('flexbt_onboard.node.stop_guard', address_space=NODE_BYTES)


def run_report() -> int:
    """Run :mod:`flexbt_onboard.persistence.run_report`; return its exit code."""
    return run_main('flexbt_onboard.persistence.run_report')
