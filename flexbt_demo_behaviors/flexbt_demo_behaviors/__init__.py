# SPDX-License-Identifier: BSD-3-Clause
"""The demonstrations of FlexBT, a folder each: behaviors, trees, worlds, places, launch files and scripts."""
