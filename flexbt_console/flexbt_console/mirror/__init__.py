# SPDX-License-Identifier: BSD-3-Clause
"""The mirror of an executive: a plain model without ROS and without a user interface, which serves them all."""
