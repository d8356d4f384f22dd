# SPDX-License-Identifier: BSD-3-Clause
"""Bounded reading of text and data from untrusted sources: JSON, YAML, messages, terminals, files."""
