# SPDX-License-Identifier: BSD-3-Clause
"""The full screen of the operator, on Textual."""
