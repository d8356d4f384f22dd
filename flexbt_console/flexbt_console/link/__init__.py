# SPDX-License-Identifier: BSD-3-Clause
"""The console's side of the operator link."""
