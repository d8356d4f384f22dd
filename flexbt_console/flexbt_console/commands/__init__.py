# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the console. Parsing, help, completion, sending and showing derive from one registry. Needs no
ROS."""
