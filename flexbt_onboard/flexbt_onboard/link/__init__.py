# SPDX-License-Identifier: BSD-3-Clause
"""The executive's side of the operator link."""
