# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT behavior-tree engine, its ROS leaves, and the behavior-tree server."""
