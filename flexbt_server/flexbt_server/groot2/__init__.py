# SPDX-License-Identifier: BSD-3-Clause
"""What Groot2 understands: its protocol for running trees, the XML that describes them, and log files (``.btlog``).

Nothing here needs ROS. A program of one's own shows a tree to Groot2 by::

    with Groot2Server(1667) as groot2:
        with groot2.watch(tree):
            tree.tick_while_running(wait)
"""
