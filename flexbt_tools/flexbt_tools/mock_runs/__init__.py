# SPDX-License-Identifier: BSD-3-Clause
"""Trees that run without a robot, with mocks."""
