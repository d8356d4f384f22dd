# SPDX-License-Identifier: BSD-3-Clause
"""The plane: maps, shapes and bodies, their distances, and ray casting."""
