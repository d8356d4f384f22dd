# SPDX-License-Identifier: BSD-3-Clause
"""What clients of bt_navigator and waypoint_follower talk to, served by runs of trees."""
