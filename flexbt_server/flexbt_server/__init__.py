# SPDX-License-Identifier: BSD-3-Clause
"""The BT server loads behavior trees and runs them."""
