from __future__ import annotations

import contextlib
import signal

import pytest

from sqrp_cli.platform.processes import interrupts_later

pytestmark = pytest.mark.usefixtures("heeded_ctrl_c")


def test_ctrl_c_waits_for_code_that_would_swallow_it() -> None:
    def swallow() -> None:
        with interrupts_later(), contextlib.suppress(BaseException):
            signal.raise_signal(signal.SIGINT)
            reached.append("the end")

    reached: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        swallow()
    assert reached == ["the end"]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_without_ctrl_c_nothing_happens() -> None:
    with interrupts_later():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_where_ctrl_c_is_ignored_it_stays_so() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_later():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
