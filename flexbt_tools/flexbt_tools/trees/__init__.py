# SPDX-License-Identifier: BSD-3-Clause
"""What people at the desk do with tree files, without ROS: check, show, draw, describe node types, run with mocks.

The executable ``bt_tool`` is :mod:`flexbt_tools.cli.bt_tool`.
"""
