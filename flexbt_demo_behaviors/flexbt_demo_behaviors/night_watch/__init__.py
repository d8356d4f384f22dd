# SPDX-License-Identifier: BSD-3-Clause
"""Two robots watch a building at night, under one operator."""
