# SPDX-License-Identifier: BSD-3-Clause
"""Planning of trees from goals, for one robot or a team; each tree is tested before it is returned."""
