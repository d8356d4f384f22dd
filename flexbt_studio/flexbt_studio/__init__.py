# SPDX-License-Identifier: BSD-3-Clause
"""The studio: write, check, run and watch missions in a browser; a language server for other editors."""
