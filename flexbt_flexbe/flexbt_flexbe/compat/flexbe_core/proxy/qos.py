# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.qos``."""

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from flexbt_flexbe.proxy import QOS_DEFAULT, QOS_LATCH, QOS_LOSSY

__all__ = ['QOS_DEFAULT', 'QOS_LATCH', 'QOS_LOSSY', 'QoSDurabilityPolicy', 'QoSProfile', 'QoSReliabilityPolicy']
