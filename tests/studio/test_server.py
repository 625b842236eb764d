"""Who gets anything of the studio: a browser on this machine with the token, from the studio's own page."""

from __future__ import annotations

import http.client
import json

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect


def answer(studio, path: str, **headers: str) -> tuple[int, bytes]:
    """Status and body of a GET request."""
    connection = http.client.HTTPConnection(studio.host, timeout=10)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    return response.status, response.read()


def test_the_address_with_the_token_is_the_page(studio):
    status, body = answer(studio, f"/{studio.token}/")
    assert status == 200
    assert b'<section id="studio"' in body
    assert studio.token.encode() not in body


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/wrong/", {}),
        ("/{token}", {}),
        ("/{token}x/", {}),
        ("/{token}/live", {}),
        ("/{token}/../etc/passwd", {}),
        ("/{token}/", {"Host": "evil.test"}),
        ("/{token}/", {"Host": "localhost:{port}"}),
        ("/{token}/", {"Origin": "http://evil.test"}),
        ("/{token}/", {"Origin": "null"}),
    ],
)
def test_anything_else_gets_nothing(studio, path, headers):
    port = studio.host.rpartition(":")[2]
    filled = {name: value.format(port=port) for name, value in headers.items()}
    assert answer(studio, path.format(token=studio.token), **filled) == (404, b"")


@pytest.mark.parametrize(
    ("path", "origin"),
    [
        ("/{token}/live", "http://evil.test"),
        ("/{token}/live", None),
        ("/{token}/live", "https://{host}"),
        ("/wrong/live", "http://{host}"),
        ("/{token}/", "http://{host}"),
    ],
)
def test_no_connection_from_another_page_or_without_the_token(studio, path, origin):
    where = f"ws://{studio.host}{path.format(token=studio.token)}"
    with pytest.raises(InvalidStatus), connect(where, origin=origin and origin.format(host=studio.host)):
        pass


def test_the_page_of_the_studio_is_told_the_cell(studio):
    where = f"ws://{studio.host}/{studio.token}/live"
    with connect(where, origin=f"http://{studio.host}", max_size=None) as own:
        told = {json.loads(own.recv(timeout=30))["do"] for _ in range(2)}
        assert told == {"state", "cell"}


NOT_FINITE = '{"do": "hold", "number": 1, "move": {"kind": "camera", "name": "cam1", "position": [NaN, 0, 0]}}'
NO_REQUESTS = [
    "",
    "{",
    "[]",
    '{"do": "leave"}',
    '{"do": "put"}',
    '{"do": "undo", "more": 1}',
    '{"do": "task", "text": 5, "by": "time"}',
    NOT_FINITE,
]


@pytest.mark.parametrize("text", NO_REQUESTS)
def test_a_request_that_is_none_is_refused(studio, text):
    where = f"ws://{studio.host}/{studio.token}/live"
    with connect(where, origin=f"http://{studio.host}", max_size=None) as own:
        own.send(text)
        while (message := json.loads(own.recv(timeout=30)))["do"] != "refused":
            pass
        assert "not understood" in message["problems"][0]["message"]


def test_it_listens_on_this_machine_only(studio):
    assert studio.host.startswith("127.0.0.1:")
