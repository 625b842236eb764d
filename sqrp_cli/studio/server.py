"""The web server of the studio: one page and its live connections, for browsers on this machine that know its token.

The only module that imports websockets. Whoever names another host, comes from another page or has no token gets an
empty answer.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import field
from http import HTTPStatus
from typing import Any

from sqrp_cli.errors import bad_option, needed
from sqrp_cli.records import dataclass

HOST = "127.0.0.1"  # no other machine reaches it
CLOSE_TIMEOUT = 1.0  # a browser that does not answer the end of a connection for so long [s] is left alone
LARGEST_MESSAGE = 1_000_000  # of what a browser sends [bytes]
MOST_WAITING = 32  # messages that may wait for a browser before it gets no more of those that the next ones replace
MOST_UNREAD = 50_000_000  # a browser for which so many characters wait is cut off: it does not read
MOST_AT_ONCE, MOST_PER_SECOND = 200, 100.0
"""How many messages of a browser are heard without a pause, and how many for long; others wait in the network."""
Tell = Callable[[str], None]


@dataclass(eq=False)
class _Browser:
    """A connection, and what waits to be sent."""

    connection: Any  # of websockets
    waiting: asyncio.Queue[str | None] = field(default_factory=asyncio.Queue)
    _size: int = 0  # of what waits
    _heard: float = 0.0  # messages above what is heard for long, at `_since`
    _since: float = field(default_factory=lambda: time.monotonic())

    def tell(self, text: str, *, passing: bool = False) -> None:
        """Send a message, see `Connections.tell`."""
        if passing and self.waiting.qsize() >= MOST_WAITING:
            return
        self._size += len(text)
        self.waiting.put_nowait(text)
        if self._size > MOST_UNREAD:
            self.connection.transport.abort()

    async def send(self) -> None:
        """Send what waits, until it is to be closed."""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while (text := await self.waiting.get()) is not None:
                await self.connection.send(text)
                self._size -= len(text)
            await self.connection.close(1001, "the studio was closed")

    async def pause(self) -> None:
        """Wait while it has sent more than is heard."""
        now = time.monotonic()
        self._heard = max(0.0, self._heard - (now - self._since) * MOST_PER_SECOND) + 1.0
        self._since = now
        await asyncio.sleep(max(0.0, self._heard - MOST_AT_ONCE) / MOST_PER_SECOND)


@dataclass(eq=False)
class Connections:
    """The connections of all browsers, and where they connect to."""

    heard: Callable[[str, Tell], Awaitable[None]]  # called with each message and how to answer it alone
    kept: dict[str, str] = field(default_factory=dict)  # the messages that a new browser gets, by kind, in order
    page: str = ""  # what the address shows
    address: str = ""  # of the page, with its token, once it is open
    socket: str = ""  # where the page connects to
    _token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    _browsers: set[_Browser] = field(default_factory=set)
    _server: Any = None

    async def open(self, port: int) -> None:
        """Listen. port: 0 for one that is free. Raises InputError for a port that is not."""
        from websockets.asyncio.server import serve

        try:
            self._server = await serve(
                self._talk,
                HOST,
                port,
                process_request=self._request,
                max_size=LARGEST_MESSAGE,
                compression=None,
                server_header=None,
                close_timeout=CLOSE_TIMEOUT,
            )
        except OSError as error:
            message = f"port {port} cannot be used: {error.strerror}"
            raise bad_option(message, mend="leave out --port: one that is free is taken") from None
        own = f"{HOST}:{next(iter(self._server.sockets)).getsockname()[1]}"
        self.address, self.socket = f"http://{own}/{self._token}/", f"ws://{own}"

    async def close(self) -> None:
        """Close all connections."""
        for browser in self._browsers:
            browser.waiting.put_nowait(None)  # to be closed once all is sent
        self._server.close()
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), 1.0)

    def tell(self, text: str, *, passing: bool = False) -> None:
        """Send a message to all browsers. passing: a slow one need not get it, as the next one replaces it."""
        for browser in self._browsers:
            browser.tell(text, passing=passing)

    def post(self, kind: str, text: str) -> None:
        """Send a message to all browsers, and keep it for those that come."""
        self.kept[kind] = text
        self.tell(text)

    def forget(self, *kinds: str) -> None:
        """Keep these messages no more."""
        for kind in kinds:
            self.kept.pop(kind, None)

    def _request(self, _connection: Any, request: Any) -> Any:  # noqa: ANN401 - of websockets
        """The page, nothing, or None to let a connection begin."""
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        headers, own = request.headers, self.socket.removeprefix("ws://")
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        path = request.path.encode()
        live = hmac.compare_digest(path, f"/{self._token}/live".encode())
        allowed = hosts == [own] and all(origin == f"http://{own}" for origin in origins)
        if live and allowed and origins:
            return None
        page = allowed and hmac.compare_digest(path, f"/{self._token}/".encode())
        status, body = (HTTPStatus.OK, self.page.encode()) if page else (HTTPStatus.NOT_FOUND, b"")
        answered = {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Connection": "close",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
        }
        return Response(status.value, status.phrase, Headers(answered), body)

    async def _talk(self, connection: Any) -> None:  # noqa: ANN401 - as above
        from websockets.exceptions import ConnectionClosed

        browser = _Browser(connection)
        self._browsers.add(browser)
        sending = asyncio.create_task(browser.send())
        for text in self.kept.values():
            browser.tell(text)
        try:
            async for message in connection:
                await browser.pause()
                if isinstance(message, str):
                    await self.heard(message, browser.tell)
        except ConnectionClosed:
            pass
        finally:
            self._browsers.discard(browser)
            sending.cancel()


def check_server() -> None:
    """Raises InputError, with the command that installs it, where the server's library is missing."""
    message = "the studio needs the Python package `websockets`, which is not installed"
    with needed(message, "pip install 'sqrp[studio]'"):
        import websockets  # noqa: F401
