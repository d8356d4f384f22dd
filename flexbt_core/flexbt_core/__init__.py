# SPDX-License-Identifier: BSD-3-Clause
"""The engines without ROS: behavior trees, hierarchical state machines, clocks and bounded values."""
