# SPDX-License-Identifier: BSD-3-Clause
"""Benches, random machines and a reference model."""
