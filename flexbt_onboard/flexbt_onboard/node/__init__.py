# SPDX-License-Identifier: BSD-3-Clause
"""The executive as a ROS node."""
