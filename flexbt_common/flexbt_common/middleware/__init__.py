# SPDX-License-Identifier: BSD-3-Clause
"""What a node stands on: rclpy's private parts, Fast DDS, messages from any participant, and the default context."""
