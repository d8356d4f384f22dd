# SPDX-License-Identifier: BSD-3-Clause
"""Commands of operators: who may give them, what each requires and does, and its result."""
