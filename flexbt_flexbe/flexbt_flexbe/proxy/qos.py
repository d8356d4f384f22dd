# SPDX-License-Identifier: BSD-3-Clause
"""Qualities of service, under FlexBE's names."""

from __future__ import annotations

from typing import Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

QOS_DEFAULT: Final = QoSProfile(depth=10)
QOS_LATCH: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
QOS_LOSSY: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
