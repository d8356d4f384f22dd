# SPDX-License-Identifier: BSD-3-Clause
"""The demonstrations of FlexBT: behaviors, trees, worlds and launch files.

Each has a folder of its own.
"""
