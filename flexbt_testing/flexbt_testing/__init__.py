# SPDX-License-Identifier: BSD-3-Clause
"""What tests stand on: scripted servers, operators, processes, bad links, random trees and machines."""
