# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states``, the states of FlexBE for behavior trees."""

from flexbt_flexbe.shim import fill

fill(__name__)
