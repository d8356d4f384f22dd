# SPDX-License-Identifier: BSD-3-Clause
"""Tree files of this computer: read, listed, described. Needs no ROS."""
