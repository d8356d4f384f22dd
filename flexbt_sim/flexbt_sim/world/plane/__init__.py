# SPDX-License-Identifier: BSD-3-Clause
"""The plane: maps, shapes, bodies on them, how far they are apart, and how far beams get."""
