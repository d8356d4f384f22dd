# SPDX-License-Identifier: BSD-3-Clause
"""Networks and bad links for tests."""
