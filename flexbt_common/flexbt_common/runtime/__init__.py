# SPDX-License-Identifier: BSD-3-Clause
"""A node on rclpy: executor thread, clocks, names and quality of service."""
