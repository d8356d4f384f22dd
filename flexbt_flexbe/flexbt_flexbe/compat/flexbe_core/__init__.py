# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core``, on FlexBT's engine."""

from flexbt_flexbe.shim import fill

fill(__name__)
