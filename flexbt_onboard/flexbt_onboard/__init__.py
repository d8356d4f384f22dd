# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT hierarchical state machine and the onboard behavior executive."""
