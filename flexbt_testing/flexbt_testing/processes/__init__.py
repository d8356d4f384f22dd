# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a robot, for tests."""
