# SPDX-License-Identifier: BSD-3-Clause
"""What the console knows, as text and as JSON."""
