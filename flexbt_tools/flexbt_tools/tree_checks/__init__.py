# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong, or suspicious, in tree files."""
