# SPDX-License-Identifier: BSD-3-Clause
"""Text and data from untrusted sources, with bounds: JSON, YAML, messages, terminals, files."""
