"""What a message quotes of the input stays readable, however long the input is."""

from __future__ import annotations

from sqrp_cli.errors import Problem


def test_a_message_quotes_no_more_than_the_beginning_of_a_long_name() -> None:
    problem = Problem("unknown-skill", f"there is no skill `{'p' * 100_000}`; did you mean `pickup`?")
    assert problem.message == f"there is no skill `{'p' * 60}...`; did you mean `pickup`?"


def test_a_command_in_a_message_stays_whole() -> None:
    command = f"`sqrp run PROGRAM --replay {'folder/' * 100}log`"
    assert Problem("no-rates", f"give it as {command}").message == f"give it as {command}"
