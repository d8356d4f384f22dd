# SPDX-License-Identifier: BSD-3-Clause
"""States for FlexBT behaviors: behavior trees, operator input and generic ones."""
