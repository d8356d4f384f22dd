# SPDX-License-Identifier: BSD-3-Clause
"""What command-line programs share."""
