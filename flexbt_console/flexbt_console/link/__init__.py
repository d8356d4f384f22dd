# SPDX-License-Identifier: BSD-3-Clause
"""The console's side of the operator link. ROS messages become records of the mirror, and commands become messages."""
