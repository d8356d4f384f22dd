# SPDX-License-Identifier: BSD-3-Clause
"""The onboard executive runs supervised behaviors on the robot."""
