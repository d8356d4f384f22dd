# SPDX-License-Identifier: BSD-3-Clause
"""The actions of bt_navigator and waypoint_follower, served by runs of trees."""
