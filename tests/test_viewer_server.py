"""The viewer's server: for this machine alone, and for its own page alone."""

import socket
import urllib.request

import pytest

for name in ("viser", "mjviser"):
    pytest.importorskip(name, reason=f"{name} is not installed: pip install 'mimicbench[view]'")

from mimicbench.viewer.server import close_server, open_server, refusal  # noqa: E402

OWN = {"Host": "localhost:8080", "Origin": "http://localhost:8080"}


@pytest.mark.parametrize(
    ("headers", "websocket", "refused"),
    [
        (OWN, True, False),
        ({"Host": "127.0.0.1:9000", "Origin": "http://127.0.0.1:9000"}, True, False),
        ({"Host": "[::1]:8080"}, False, False),
        ({"Host": "localhost:8080"}, False, False),
        ({"Host": "localhost:8080"}, True, True),
        ({**OWN, "Origin": "http://localhost:3000"}, True, True),
        ({**OWN, "Origin": "https://evil.example"}, True, True),
        ({**OWN, "Origin": "null"}, True, True),
        ({**OWN, "Origin": "http://localhost:8080.evil.example"}, True, True),
        ({"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, True, True),
        ({"Host": "localhost.evil.example"}, False, True),
        ({"Host": "[::1"}, False, True),
        ({}, False, True),
    ],
)
def test_who_is_refused(headers, websocket, refused):
    assert (refusal(headers, websocket) is not None) == refused


@pytest.fixture(scope="module")
def server():
    """An empty page."""
    found = open_server(18080)
    yield found
    close_server(found)


def fetched(port, path, host):
    """Status and body of a plain request, whose path no client has tidied."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as line:
        line.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        answer = b""
        while part := line.recv(1 << 16):
            answer += part
    return int(answer.split()[1]), answer


@pytest.mark.parametrize(
    "path",
    ["/../../../../../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/etc/passwd", "/..%5c..%5cetc/passwd", "//etc/passwd"],
)
def test_no_path_leads_out_of_the_page(server, path):
    status, answer = fetched(server.get_port(), path, "localhost")
    assert status == 404 and b"root:" not in answer


def test_the_page_is_for_this_machine(server):
    port = server.get_port()
    status, answer = fetched(port, "/", f"localhost:{port}")
    assert status == 200 and b"X-Frame-Options: DENY" in answer
    assert fetched(port, "/", "evil.example")[0] == 403
    outside = [info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    for address in {one for one in outside if not one.startswith("127.")}:
        with pytest.raises(OSError):
            socket.create_connection((address, port), timeout=5).close()


@pytest.mark.parametrize("origin", [None, "https://evil.example", "http://localhost:1"])
def test_no_other_page_may_connect(server, origin):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with pytest.raises(InvalidStatus) as refused, connect(f"ws://localhost:{server.get_port()}", origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_its_own_page_may_connect(server):
    from websockets.sync.client import connect

    url = f"localhost:{server.get_port()}"
    import viser

    with connect(f"ws://{url}", origin=f"http://{url}", subprotocols=[f"viser-v{viser.__version__}"]) as line:
        assert isinstance(line.recv(timeout=30), bytes)


def test_nobody_opens_a_tunnel(server):
    assert server.request_share_url() is None
    with urllib.request.urlopen(f"http://localhost:{server.get_port()}/") as page:
        assert page.status == 200
