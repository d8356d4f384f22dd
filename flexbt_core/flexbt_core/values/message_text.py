# SPDX-License-Identifier: BSD-3-Clause
"""Text of unknown origin, made fit for a field of a message."""

from __future__ import annotations

import re
from typing import Final

_UNSENDABLE: Final = re.compile('[\0\ud800-\udc7f\udd00-\udfff]')
"""NUL, and surrogates that stand for no byte."""


def sendable(text: str, limit: int | None = None) -> str:
    """``text`` as the middleware can send it: without NUL, which would cut it off on the other side, and without lone
    surrogates, with which no message can be sent at all.

    Python makes surrogates of the bytes of a terminal or a file name that its encoding lacks: of all but ASCII, where
    the locale has nothing else. They are taken for UTF-8, and replaced where they are none.

    Of a text of more than ``limit`` characters the middle is left out, and it is said how much that is.
    """
    if limit is not None and len(text) > limit:
        half = limit // 2
        text = f'{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}'
    return _UNSENDABLE.sub('\ufffd', text).encode('utf-8', 'surrogateescape').decode('utf-8', 'replace')
