# SPDX-License-Identifier: BSD-3-Clause
"""The FlexBT operator's control station: screen, page for the browser, line mode, recordings."""
