# SPDX-License-Identifier: BSD-3-Clause
"""Fuzzing of all readers: ``python3 -m flexbt_testing.fuzzing --seconds 600``."""
