# SPDX-License-Identifier: BSD-3-Clause
"""Launch and parameter files for real robots, and the command flexbt: doctor, init, manifest."""
