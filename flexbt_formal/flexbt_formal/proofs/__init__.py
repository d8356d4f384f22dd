# SPDX-License-Identifier: BSD-3-Clause
"""Proofs of trees and behaviors, their reports, and their counterexamples."""
