"""Who gets anything of the studio: a browser on this machine with the token, from the studio's own page."""

from __future__ import annotations

import http.client
import inspect
import json
import shlex
import signal
import subprocess
import sys

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from sqrp_cli.cli.main import run
from sqrp_cli.platform.interrupts import heed_signals
from sqrp_cli.show.terminal import console
from sqrp_cli.studio.messages import _FIELDS
from sqrp_cli.studio.session import Studio
from tests.studio.conftest import TASK
from tests.studio.hand import ROOT


def answer(studio, path: str, **headers: str) -> tuple[int, bytes]:
    """Status and body of a GET request."""
    connection = http.client.HTTPConnection(studio.host, timeout=120)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    return response.status, response.read()


def test_ctrl_c_inside_a_callback_whose_exceptions_are_lost_closes_the_studio(cell, monkeypatch):
    class Lost:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def lose(told: str) -> None:
        if "Ctrl-C" in told:
            Lost()

    monkeypatch.setattr(console, "note", lose)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs tests in the background
    heed_signals()
    try:
        assert run(["studio", str(cell), "--no-browser", TASK]) == 0
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def test_the_address_with_the_token_is_the_page(studio):
    status, body = answer(studio, f"/{studio.token}/")
    assert status == 200
    assert b'<section id="studio"' in body
    assert studio.token.encode() not in body
    assert studio.host.startswith("127.0.0.1:")  # of this machine only


@pytest.mark.parametrize(("path", "headers"), [
    ("/", {}), ("/wrong/", {}), ("/{token}", {}), ("/{token}x/", {}), ("/{token}/live", {}),
    ("/{token}/../etc/passwd", {}), ("/{token}/", {"Host": "evil.test"}), ("/{token}/", {"Host": "localhost:{port}"}),
    ("/{token}/", {"Origin": "http://evil.test"}), ("/{token}/", {"Origin": "null"}),
])  # fmt: skip
def test_anything_else_gets_nothing(studio, path, headers):
    port = studio.host.rpartition(":")[2]
    filled = {name: value.format(port=port) for name, value in headers.items()}
    assert answer(studio, path.format(token=studio.token), **filled) == (404, b"")


@pytest.mark.parametrize(("path", "origin"), [
    ("/{token}/live", "http://evil.test"), ("/{token}/live", None), ("/{token}/live", "https://{host}"),
    ("/wrong/live", "http://{host}"), ("/{token}/", "http://{host}"),
])  # fmt: skip
def test_no_connection_from_another_page_or_without_the_token(studio, path, origin):
    where = f"ws://{studio.host}{path.format(token=studio.token)}"
    with pytest.raises(InvalidStatus), connect(where, origin=origin and origin.format(host=studio.host)):
        pass


def live(studio):
    """A connection of our own."""
    where = f"ws://{studio.host}/{studio.token}/live"
    return connect(where, origin=f"http://{studio.host}", max_size=None)


def test_the_page_of_the_studio_is_told_the_cell(studio):
    with live(studio) as own:
        told = {json.loads(own.recv(timeout=120))["do"] for _ in range(2)}
        assert told == {"state", "cell"}


NO_REQUESTS = [
    "", "{", "[]", '{"do": "leave"}', '{"do": "put"}', '{"do": "undo", "more": 1}',
    '{"do": "task", "text": 5, "by": "time"}', r'{"do": "program", "file": "a\u0000.yaml"}',
    '{"do": "hold", "number": 1, "move": {"kind": "camera", "name": "cam1", "position": [NaN, 0, 0]}}',
]  # fmt: skip


@pytest.mark.parametrize("text", NO_REQUESTS)
def test_a_request_that_is_none_is_refused(studio, text):
    with live(studio) as own:
        own.send(text)
        while (message := json.loads(own.recv(timeout=120)))["do"] != "refused":
            pass
        assert "not understood" in message["problems"][0]["message"]


@pytest.fixture
def own(studio):
    """A connection of our own, which is told of a ranking that is done."""
    with live(studio) as connection:
        heard(connection, "detail")
        yield connection


def heard(own, do: str, number: int | None = None):
    """The next message of a kind, about a ranking or sketch of a number."""
    while (message := json.loads(own.recv(timeout=120)))["do"] != do or number not in (None, message.get("number")):
        assert message["do"] != "problems"
    return message


def asked(own, do: str, **fields) -> None:
    own.send(json.dumps({"do": do, **fields}))


def test_every_word_of_a_browser_does_something():
    obeyed = inspect.getsource(Studio.obey)
    assert not [do for do in _FIELDS if f'"{do}"' not in obeyed]


@pytest.mark.parametrize("path", ["", ".", "cameras.", "cameras.cam1.", ".."])
def test_a_value_without_a_path_is_refused(own, path):
    asked(own, "set", path=path, value="{}")
    assert heard(own, "refused")["problems"][0]["code"] == "unknown-value"


def test_what_is_taken_in_hand_and_left_where_it_is_changes_no_figure_and_ends_no_ranking(own):
    asked(own, "task", text="pickup object=g2", by="q_eoi")
    state = heard(own, "state")
    heard(own, "detail")
    still, number = state["handles"]["camera"]["cam1"], state["number"]
    asked(own, "hold", move=still, number=1)
    sketch = heard(own, "sketch")
    assert sketch["was"] == {"q_eoi": sketch["seen"]["q_eoi"], "q_avg": pytest.approx(sketch["seen"]["q_avg"])}
    refused = {**still, "position": [200.0, 0.0, 0.0]}
    for do, fields in (("rest", {}), ("put", {"move": still}), ("put", {"move": refused})):
        number += 1
        asked(own, "hold", move={**still, "position": [0.0, 0.5, 1.5]}, number=number)
        asked(own, do, **fields)
        assert not heard(own, "state", number)["dirty"]
        assert len(heard(own, "ranking", number)["entries"]) == 1


def test_a_click_that_drops_nothing_is_told_so(own):
    asked(own, "fault", name="slip")
    assert "over before the click" in heard(own, "refused")["problems"][0]["message"]


def test_a_studio_ends_with_the_process_that_started_it(cell):
    command = shlex.join([sys.executable, "-m", "sqrp_cli", "studio", str(cell), TASK, "--no-browser"])
    shell = subprocess.Popen(
        ["/bin/sh", "-c", f"{command} & wait"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    host, _, token = shell.stdout.readline().decode().strip().strip("/").removeprefix("http://").partition("/")
    with connect(f"ws://{host}/{token}/live", origin=f"http://{host}", max_size=None) as own:
        own.recv(timeout=120)  # it is looking after itself by now
    shell.kill()
    shell.communicate(timeout=120)  # its output ends once the studio and all that it started have ended


def test_a_task_that_cannot_be_read_is_refused_as_by_rank(cell, capsys):
    assert [run([command, str(cell), "nonsense task"]) for command in ("rank", "studio")] == [2, 2]
    first, second = capsys.readouterr().err.splitlines()
    assert first == second
