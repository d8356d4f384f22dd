# SPDX-License-Identifier: BSD-3-Clause
"""ASCXML, the language of the automata of a model: its files, expressions, types of data and events."""
