# SPDX-License-Identifier: BSD-3-Clause
"""The behavior server, which spins, backs up, drives straight, waits, and assists an operator."""
