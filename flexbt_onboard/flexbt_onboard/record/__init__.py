# SPDX-License-Identifier: BSD-3-Clause
"""Who did what and when, and what is made of it."""
