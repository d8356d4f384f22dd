# SPDX-License-Identifier: BSD-3-Clause
"""The node ``simulator``, a world on ROS, with the topics of its robots and the standard services of simulators."""
