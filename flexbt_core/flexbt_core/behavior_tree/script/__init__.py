# SPDX-License-Identifier: BSD-3-Clause
"""The scripting language of BehaviorTree.CPP: lexer, parser, values, interpreter."""
