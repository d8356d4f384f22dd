# SPDX-License-Identifier: BSD-3-Clause
"""The trees and blackboards of the server, and the types of their ports."""
