# SPDX-License-Identifier: BSD-3-Clause
"""Text of unknown origin, made fit for a field of a message."""

from __future__ import annotations


def sendable(text: str, limit: int | None = None) -> str:
    """``text`` as the middleware can send it: without NUL, which would cut it off on the other side, and without lone
    surrogates (bytes of a terminal or of a file name that are no UTF-8), with which no message can be sent at all.

    Of a text of more than ``limit`` characters the middle is left out, and it is said how much that is.
    """
    if limit is not None and len(text) > limit:
        half = limit // 2
        text = f'{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}'
    return text.replace('\0', '\ufffd').encode('utf-8', 'replace').decode('utf-8')
