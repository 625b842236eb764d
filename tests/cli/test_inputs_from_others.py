"""What others may hand to a command: huge files, deep nesting, endless numbers, damaged records, silent listeners."""

from __future__ import annotations

import json
import os
import random
import resource
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.files.json_file import json_document, json_name
from sqrp_cli.score import baseline as baseline_file

HUGE = 3 << 30


@pytest.fixture(autouse=True)
def in_little_memory():
    """What is refused is not read first: the highest memory use ever hardly grows."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


def assert_refused(outcome: Any, *words: str) -> None:
    assert (outcome.code, outcome.out) == (2, ""), outcome
    assert "internal error" not in outcome.err
    for word in words:
        assert word in outcome.err, outcome.err


def huge(path: Path) -> Path:
    path.touch()
    os.truncate(path, HUGE)
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "--replay", "{file}"],
        ["score", "{watch}", "--baseline", "{file}"],
        ["score", "{watch}", "--cluster", "{file}"],
        ["program", "{file}"],
        ["show", "{file}"],
        ["diff", "{watch}", "{file}"],
    ],
    ids=lambda words: " ".join(words),
)
def test_a_file_of_3_gb_is_refused_from_its_size(sqrp, watch, tmp_path, arguments):
    file = huge(tmp_path / "huge")
    outcome = sqrp(*(word.format(file=file, watch=watch) for word in arguments))
    assert_refused(outcome, str(file), "the file has 3,221,225,472 bytes, the limit is ")


def test_a_log_is_read_line_by_line_up_to_a_limit_of_each_and_of_all(sqrp, tmp_path, monkeypatch):
    log = tmp_path / "log"
    log.write_bytes(b"[" * 11_000_000)
    assert_refused(sqrp("run", "--replay", log), f"{log}:1: ", "1,000,000 lines of 10,000,000 bytes")
    from sqrp_cli.recording import texts as module

    monkeypatch.setattr(module, "MAX_LINES", 2)
    first = {"t": 0.0, "event": "run", "sqrp_log": 1, "workspace": "cell", "digest": "d", "cameras": []}
    log.write_text(json.dumps(first) + '\n{"t": 0, "event": "x"}' * 2, encoding="utf-8")
    assert_refused(sqrp("run", "--replay", log, "--json"), f"{log}:3: this log is too large: the limit is 2 lines")


@contextmanager
def listening(answer: bytes) -> Iterator[int]:
    """A port at which somebody answers so, and says nothing more."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        kept = []

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                kept.append(connection)
                connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
    for connection in kept:
        connection.close()


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\1" + bytes(7), b"\xff" * 64], ids=repr)
def test_a_listener_that_says_nothing_of_use_is_given_up_within_seconds(sqrp, watch, monkeypatch, answer):
    pytest.importorskip("distributed")
    monkeypatch.setattr("sqrp_cli.score.cluster.CONNECT_TIMEOUT", 1.0)
    with listening(answer) as port:
        before = time.monotonic()
        outcome = sqrp("score", watch, "--cluster", f"tcp://127.0.0.1:{port}")
        assert time.monotonic() - before < 30  # more than a hundred times as long it was
    assert_refused(
        outcome, f"no Dask scheduler answers at `tcp://127.0.0.1:{port}`: ", "start one with `dask scheduler`"
    )


@pytest.fixture(scope="module")
def saved(sqrp, watch, tmp_path_factory):
    """What a baseline says."""
    path = tmp_path_factory.mktemp("saved") / "baseline.json"
    assert sqrp("score", watch, "--save-baseline", path).code == 0
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def edits(document: dict[str, Any]) -> Iterator[tuple[tuple[str | int, ...], object]]:
    """Paths of values, with another one that cannot stand there; a few of each kind."""
    shapes: dict[str, int] = {}
    for path in json_document(Path("x"), json.dumps(document), document).values:
        shape = ".".join("*" if isinstance(key, int) else key for key in path[:1] + path[-2:])
        shapes[shape] = shapes.get(shape, 0) + 1
        if path and shapes[shape] <= 2:
            a_field = path[0] == "fields" and len(path) == 3  # which may be any number
            yield from ((path, other) for other in ([[1]], {"x": {}}, *([] if a_field else [-1e300])))


def changed(document: Any, path: tuple[str | int, ...], value: object) -> Any:
    if not path:
        return value
    copied = list(document) if isinstance(document, list) else dict(document)
    copied[path[0]] = changed(document[path[0]], path[1:], value)
    return copied


def test_a_refused_baseline_says_which_entry_in_which_line_is_wrong_and_what_was_expected(sqrp, watch, saved, tmp_path):
    path = tmp_path / "baseline.json"
    cases = list(edits(saved))
    assert len(cases) > 60
    for key, value in random.Random(0).sample(cases, 60):  # noqa: S311 - no secret
        document = changed(saved, key, value)
        text = json.dumps(document, indent=1)
        path.write_text(text, encoding="utf-8")
        outcome = sqrp("score", watch, "--baseline", path)
        assert_refused(outcome, "this is no baseline, or a damaged one: ", "--save-baseline")
        line = json_document(path, text, document).value_place(key).line
        told = [one for one in outcome.err.splitlines() if one.startswith("error: ")]
        below = [one for one in told if f"`{json_name(key)}" in one]
        assert below, (key, value, told)
        assert any("expected" in one or "lacks" in one or "no known key" in one for one in below), below
        if isinstance(value, float):
            assert any(one.startswith(f"error: {path}:{line}:") for one in below), (line, below)


def test_a_baseline_that_could_not_be_read_again_is_not_written(sqrp, watch, tmp_path, monkeypatch):
    monkeypatch.setattr(baseline_file, "MAX_BYTES", 1000)
    outcome = sqrp("score", watch, "--save-baseline", tmp_path / "baseline.json")
    assert outcome.code == 2
    assert "this baseline would have more than 1,000 bytes, the limit" in outcome.err
    assert not (tmp_path / "baseline.json").exists()
    assert "The task passes." in outcome.out  # what was scored is not lost


def test_a_kept_result_of_3_gb_is_computed_again(sqrp, watch, tmp_path):
    out = tmp_path / "results"
    first = sqrp("score", watch, "--out", out, "--json")
    kept = next(out.rglob("*.json"))
    content = kept.read_text(encoding="utf-8")
    huge(kept)
    assert sqrp("score", watch, "--out", out, "--json").out == first.out
    assert kept.read_text(encoding="utf-8") == content
