# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_testing``."""
