# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT behavior-tree server and its leaves for ROS."""
