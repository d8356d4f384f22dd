# SPDX-License-Identifier: BSD-3-Clause
"""XML text to elements to definitions; formats 3 and 4."""
