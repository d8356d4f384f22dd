# SPDX-License-Identifier: BSD-3-Clause
"""The commands of operators, and who may give them."""
