"""`sqrp set`: what is written is a workspace that every other command takes."""

from __future__ import annotations

from sqrp_cli.ask.api.cell import OpenCell


def test_a_value_that_is_set_while_the_file_changes_loses_neither(sqrp, own_watch, monkeypatch):
    file, read, texts = own_watch / "workspace.yaml", OpenCell.read, []

    def slow(*arguments, **named):
        texts.append(f"{file.read_text()}# changed by another one\n")
        file.write_text(texts[-1])
        return read(*arguments, **named)

    monkeypatch.setattr(OpenCell, "read", slow)
    found = sqrp("set", own_watch, "cameras.eye.rate=20")
    assert found.code == 2
    assert "the workspace has changed meanwhile" in found.err
    assert file.read_text() == texts[0]
