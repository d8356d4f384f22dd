# SPDX-License-Identifier: BSD-3-Clause
"""A bench, random machines and a reference model for the state-machine engine. Needs no ROS."""
