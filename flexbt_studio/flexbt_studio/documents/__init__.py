# SPDX-License-Identifier: BSD-3-Clause
"""Trees, machines and behaviors as texts that are edited by spans. Needs neither ROS nor a web server."""
