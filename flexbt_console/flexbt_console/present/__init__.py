# SPDX-License-Identifier: BSD-3-Clause
"""The console's knowledge as text, JSON, trees and maps, and the events between two views. Needs no ROS."""
