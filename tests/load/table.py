"""What was measured, line by line beside what is asked."""

from __future__ import annotations


class Table:
    """Lines that are printed as they come; good: whether all that is asked so far is so."""

    def __init__(self) -> None:
        self.good = True

    def title(self, text: str) -> None:
        """Begin a part of the table."""
        print(f"\n{text:<53} {'measured':>10} {'asked':>10}", flush=True)

    def line(self, what: str, measured: str, asked: str = "", good: bool = True) -> None:
        """A line; without `asked` it is only there to be read."""
        self.good &= good
        verdict = "" if not asked else "ok" if good else "NOT"
        print(f"  {what:<51} {measured:>10} {asked:>10}  {verdict}".rstrip(), flush=True)

    def same(self, what: str, *, good: bool) -> None:
        """A line about something that must be the same, byte for byte."""
        self.line(what, "the same" if good else "different", "the same", good)
