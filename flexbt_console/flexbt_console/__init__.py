# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT operator's control station: mirror and terminal console."""
