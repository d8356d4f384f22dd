# SPDX-License-Identifier: BSD-3-Clause
"""System tests of FlexBT across processes."""
