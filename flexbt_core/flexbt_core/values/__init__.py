# SPDX-License-Identifier: BSD-3-Clause
"""Text and data from others, with bounds: JSON, YAML, terminal-safe and message-safe text."""
