# SPDX-License-Identifier: BSD-3-Clause
"""A node on rclpy, with its executor and thread, clocks, parameters, log and health."""
