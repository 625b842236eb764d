"""Standard streams that accept anything, wherever it goes; only lost results are an error."""

from __future__ import annotations

import codecs
import io
import os
import select
import sys
from pathlib import Path
from typing import Any, TextIO


class ResultsLost(Exception):  # noqa: N818 - no error of the program's
    """The results cannot be written; the text is the system's reason."""


def prepare_streams() -> None:
    """Make the streams of this process work with anything that they are connected to."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if descriptor == 1 else os.O_RDWR)
    if sys.stdin is None:
        sys.stdin = Path(os.devnull).open(encoding="utf-8")  # noqa: SIM115 - for good
    sys.stdout, sys.stderr = _writable(sys.stdout, results=True), _writable(sys.stderr, results=False)
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")


def _writable(stream: TextIO | None, *, results: bool) -> TextIO:
    if stream is None:  # closed, as by `>&-`
        if not results:
            return Path(os.devnull).open("w", encoding="utf-8")
        stream = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - a descriptor, for good
    if not isinstance(stream, io.TextIOWrapper):
        return stream  # kept in memory
    if isinstance(getattr(stream.buffer, "raw", stream.buffer), io.FileIO):
        # Libraries write errors of their own to the descriptor 2, where they can be caught; ours go on beside it.
        descriptor = stream.fileno() if results else os.dup(stream.fileno())
        buffer = io.BufferedWriter(_Output(descriptor, results=results))
        lines, at_once = stream.line_buffering, stream.write_through
        stream = io.TextIOWrapper(buffer, stream.encoding, line_buffering=lines, write_through=at_once)
    codecs.register_error("alike", _look_alike)
    stream.reconfigure(errors="alike")
    return stream


_LOOK_ALIKES = {
    **dict.fromkeys("█▉▊▋▌", "#"), **dict.fromkeys("▍▎▏", " "), **dict.fromkeys("━─╸╺", "-"),
    "·": ".", "…": ".", "◆": "*", "–": "-", "→": ">", "±": "~",
}  # fmt: skip
"""What stands for signs of charts and tables where a terminal or pipe knows ASCII alone; each is as wide."""


def _look_alike(error: UnicodeError) -> tuple[str, int]:
    """Signs that an encoding knows for those that it does not: `?` where nothing looks like it."""
    assert isinstance(error, UnicodeEncodeError)  # noqa: S101 - only output comes here
    return "".join(_LOOK_ALIKES.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


class _Output(io.FileIO):
    """The target of a stream. Its reader may leave early; ResultsLost is raised once, then the rest is dropped."""

    def __init__(self, descriptor: int, *, results: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._heeded = results

    def write(self, data: Any) -> int:  # noqa: ANN401 - any buffer
        try:
            while (count := super().write(data)) is None:  # it would block
                select.select((), (self,), ())
            return count
        except BrokenPipeError:
            pass
        except OSError as error:
            if self._heeded:
                self._heeded = False
                raise ResultsLost(error.strerror) from error
        return memoryview(data).nbytes
