"""The server of the page: on this machine alone, and for its own page alone.

A browser lets any page that it shows open a websocket to any server that it can reach, this one included. So whoever
connects has to call the server by a name of this machine (which a page that has its name pointed here cannot) and to
come from a page that this very server has sent. An SSH tunnel keeps both true, at whatever port it ends.
"""

from __future__ import annotations

import http
import io
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from mimicbench.core.errors import MimicbenchError

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HOST = "127.0.0.1"
NAMES = ("127.0.0.1", "localhost", "::1")
"""What this machine may be called by who asks for the page."""
NEEDED = ("viser", "mjviser", "websockets", "trimesh")


def refusal(headers: Mapping[str, str], opens_websocket: bool) -> str | None:
    """Why a request is refused; None if it is not.

    Args:
        headers: Of the request, by any case that the mapping understands.
        opens_websocket: Whether it asks for more than a file.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if _name(f"//{host}") not in NAMES:
        return "this page is only served to this machine: open it as http://localhost"
    if origin is None:
        return "only the page of this viewer may connect" if opens_websocket else None
    if urlsplit(origin).netloc != host:
        return "only the page of this viewer may connect"
    return None


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def open_server(port: int) -> viser.ViserServer:
    """Serve the page at `port`, or the next that is free. Raises MimicbenchError if what it needs is not installed."""
    try:
        import viser
    except ModuleNotFoundError as error:
        raise _missing(error) from None
    with _guarded() as calls, redirect_stdout(io.StringIO()):  # it would print where else it could be opened
        server = viser.ViserServer(host=HOST, port=port, verbose=False)
    # of who asks for no page, such as a monitor that sends HEAD, it would print tracebacks
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    # a page may ask for a tunnel that shows it to everybody: not this one
    server.request_share_url = _no_tunnel
    if not calls:
        close_server(server)
        raise MimicbenchError(
            f"viser {viser.__version__} opens its websockets in another way than the one that is guarded here; "
            "run `pip install 'mimicbench[view]'` for a version that is known"
        )
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stop serving."""
    with redirect_stdout(io.StringIO()):
        server.stop()


def _no_tunnel(verbose: bool = True) -> None:
    """What becomes of the wish to be seen from elsewhere."""


def check_installed() -> None:
    """Raises MimicbenchError if what the viewer needs is not installed."""
    try:
        for name in NEEDED:
            __import__(name)
    except ModuleNotFoundError as error:
        raise _missing(error) from None


def _missing(error: ModuleNotFoundError) -> MimicbenchError:
    if error.name is None or error.name.partition(".")[0] not in NEEDED:
        raise error
    return MimicbenchError(f"the viewer needs {error.name}; run `pip install 'mimicbench[view]'`")


@contextmanager
def _guarded() -> Iterator[list[int]]:
    """Within it, websocket servers that are opened refuse strangers; the list has the port of each.

    viser has no setting for that, and opens its server itself.
    """
    import websockets.asyncio.server as library

    original, calls = library.serve, []

    def serve(handler: Any, host: Any = None, port: Any = None, *, process_request: Any = None, **more: Any) -> Any:
        calls.append(port)
        return original(handler, host, port, process_request=_checked(process_request), **more)

    library.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield calls
    finally:
        library.serve = original


def _checked(answer: Callable[[ServerConnection, Request], Response | None]) -> Any:
    """The same answers, but for who is refused; and nobody may show the page within theirs."""

    def process(connection: ServerConnection, request: Request) -> Response | None:
        asks = request.headers.get("Upgrade", "").lower() == "websocket"
        why = refusal(request.headers, asks)
        if why is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{why}\n")
        response = answer(connection, request)
        if response is not None:
            response.headers["X-Frame-Options"] = "DENY"
            response.headers["X-Content-Type-Options"] = "nosniff"
        return response

    return process
