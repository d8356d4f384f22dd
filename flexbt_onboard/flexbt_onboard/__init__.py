# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT onboard executive: runs supervised behaviors on the robot."""
