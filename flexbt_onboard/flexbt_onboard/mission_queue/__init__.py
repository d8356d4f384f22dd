# SPDX-License-Identifier: BSD-3-Clause
"""The mission queue: behaviors that run one after the other when no other runs."""
