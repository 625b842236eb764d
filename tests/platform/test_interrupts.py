from __future__ import annotations

import contextlib
import signal

import pytest

from sqrp_cli.cli.main import run
from sqrp_cli.platform.interrupts import interrupts_later

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


@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_what_is_done_at_ctrl_c_stays_so(handler: signal.Handlers) -> None:
    signal.signal(signal.SIGINT, handler)
    with interrupts_later():
        if handler is signal.SIG_IGN:
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is handler


def test_what_a_library_makes_of_ctrl_c_ends_a_command_as_ctrl_c_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def swallowing(*_: object, **__: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise TypeError("incompatible function arguments") from None

    monkeypatch.setattr("sqrp_cli.checks.registry.rules", swallowing)
    assert run(["rules", "--json"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
