# SPDX-License-Identifier: BSD-3-Clause
"""The layer below the nodes: rclpy's private parts, Fast DDS, messages from any participant, the default context."""
