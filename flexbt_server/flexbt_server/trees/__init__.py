# SPDX-License-Identifier: BSD-3-Clause
"""The trees and blackboards that the server holds, and the types of their ports."""
