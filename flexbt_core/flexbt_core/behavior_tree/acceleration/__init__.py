# SPDX-License-Identifier: BSD-3-Clause
"""Faster classes for scripts and observed nodes. The engine works without this folder."""
