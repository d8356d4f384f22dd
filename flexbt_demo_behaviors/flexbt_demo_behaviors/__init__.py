# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors, trees and launch files of the FlexBT demonstrations."""
