# SPDX-License-Identifier: BSD-3-Clause
"""Access to the page: checks of the headers Host and Origin, and the token; and the allowed rate of wrong ones."""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import secrets
import socket
import ssl
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from flexbt_console.commands.spec import Role
from flexbt_console.errors import UsageError
from flexbt_core.values.text import short_repr

from .users import User, Users

CLOSED_HEADERS: Final = {
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
}
"""Headers of each answer, so that pages of other sites cannot read it or learn about this one."""


GUESSES: Final = 5
"""Wrong tokens from one address that are answered at once."""

GUESS_SECONDS: Final = 2.0
"""Time after which one more guess is checked once the maximum is used up, s."""

_ADDRESSES: Final = 4096


def source_of(address: str | None) -> str:
    """Return the key of the source of an address: for IPv6 its first 64 bits, since one client may own all of them."""
    known = _address((address or '').partition('%')[0])
    if isinstance(known, ipaddress.IPv6Address):
        return str(known.ipv4_mapped or ipaddress.ip_network((known, 64), strict=False))
    return str(known or address or '')


class WrongTokens:
    """The delay before a token is checked, which grows with the wrong tokens from the same source.

    A right token adds no delay, so its owner waits only if another client guesses from the same source.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._paid_at: OrderedDict[str, float] = OrderedDict()

    def wait(self, source: str) -> float:
        """Return the seconds until the next token from this source is checked."""
        return max(0.0, self._paid_at.get(source, 0.0) - (GUESSES - 1) * GUESS_SECONDS - self._now())

    def note(self, source: str) -> None:
        """Note a wrong token from this source."""
        self._paid_at[source] = max(self._paid_at.pop(source, 0.0), self._now()) + GUESS_SECONDS
        if len(self._paid_at) > _ADDRESSES:
            self._paid_at.popitem(last=False)


@dataclass(frozen=True)
class Access:
    """``address`` is where it listens, ``names`` are further names of the computer; an empty ``token`` means none.
    With ``users`` each has a token of his own. ``certificate``: it is served by HTTPS.

    A page of another site reaches this server in two ways: by its own address, which the browser sends in ``Origin``;
    and under a name of its own that it lets point to us (DNS rebinding), which is the ``Host``. So Host is an address
    or a name of this computer, and Origin the same. Requests that no browser sends are stopped by the token alone.
    """

    address: str = '127.0.0.1'
    token: str = ''
    names: frozenset[str] = frozenset({'localhost'})
    users: Users | None = None
    certificate: ssl.SSLContext | None = None

    @classmethod
    def of(cls, address: str, token: str = '') -> Access:
        """Return the access for a listening address: beyond this computer it always has a token, generated if missing.

        Raises:
            UsageError: it is neither an address of the Internet protocol nor ``localhost``.
        """
        known = _address(address)
        if known is None and address != 'localhost':
            raise UsageError(f'--address {address!r}: give an IP address, such as 127.0.0.1 or 0.0.0.0')
        is_local = known is None or known.is_loopback
        own = {'localhost'} if is_local else {'localhost', socket.gethostname(), socket.getfqdn()}
        return cls(address, token or ('' if is_local else secrets.token_urlsafe(24)), frozenset(map(str.lower, own)))

    def knows_host(self, host: str) -> bool:
        """Return whether a header ``Host`` names this computer."""
        try:
            name = urlsplit(f'//{host}').hostname or ''
        except ValueError:
            return False
        return name in self.names or _address(name) is not None

    def knows_origin(self, origin: str | None, host: str) -> bool:
        """Return whether a header ``Origin`` is the page of this server; without the header no page asked."""
        return origin is None or origin in (f'http://{host}', f'https://{host}')

    def user_of(self, token: object) -> User | None:
        """Return the user with this token, ANYBODY where all are one, or None if the token is wrong."""
        text = token if isinstance(token, str) else ''
        if self.users is not None:
            return self.users.with_token(text)
        received = text.encode(errors='replace')  # JSON may hold lone surrogates
        is_right = not self.token or hmac.compare_digest(received, self.token.encode(errors='surrogateescape'))
        return ANYBODY if is_right else None

    def wait(self, wrong: WrongTokens, source: str) -> float:
        """Return the seconds until the next token from a source is checked; the token of a user cannot be guessed."""
        return wrong.wait(source) if self.users is None else 0.0

    def admits(self, user: User) -> bool:
        """Return whether a user that was admitted still is."""
        return self.users is None or self.users.has(user)

    def page_address(self, port: int) -> str:
        """Return the address to open in a browser. The token follows ``#``: browsers do not send that part."""
        host = {'0.0.0.0': socket.gethostname(), '::': socket.gethostname()}.get(self.address, self.address)  # noqa: S104
        shown = f'[{host}]' if ':' in host else host
        scheme = 'http' if self.certificate is None else 'https'
        token = self.token if self.users is None else ''
        return f'{scheme}://{shown}:{port}/' + (f'#token={token}' if token else '')


ANYBODY: Final = User('', Role.MAINTAINER)
"""The user where all are one."""


def certificate_problem(own: ssl.SSLContext, file: str) -> str:
    """Return why clients that trust a certificate do not accept it, such as that it has expired; '' if they do."""
    trusting = ssl.create_default_context(cafile=file)
    trusting.check_hostname, trusting.verify_flags = False, ssl.VerifyFlags.VERIFY_X509_PARTIAL_CHAIN
    to_client, to_server = ssl.MemoryBIO(), ssl.MemoryBIO()
    client, server = trusting.wrap_bio(to_client, to_server), own.wrap_bio(to_server, to_client, server_side=True)
    try:
        for side in (client, server, client):
            with contextlib.suppress(ssl.SSLWantReadError):
                side.do_handshake()
    except ssl.SSLCertVerificationError as error:
        return error.verify_message
    return ''


def guard(access: Access) -> Middleware:
    """Return an aiohttp middleware that refuses requests from pages of other servers."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not access.knows_host(request.host):
            raise web.HTTPMisdirectedRequest(text=f'this server is not called {short_repr(request.host)}')
        if not access.knows_origin(request.headers.get('Origin'), request.host):
            raise web.HTTPForbidden(text='a page of another site may not use this server')
        return await handler(request)

    return check


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None
