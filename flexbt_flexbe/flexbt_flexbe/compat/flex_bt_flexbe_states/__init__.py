# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states``, the states of FlexBE for behavior trees: one module for each."""
