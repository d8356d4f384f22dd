# SPDX-License-Identifier: BSD-3-Clause
"""The line mode, which runs one command, and the interactive prompt, which needs prompt_toolkit."""
