"""What every result of a question is: a typed document that shows itself as the terminal does."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sized
from typing import TYPE_CHECKING, Generic, TypeVar

from sqrp_cli.report.documents.document import as_text

if TYPE_CHECKING:
    from sqrp_cli.report.documents.document import Document

AnyDocument = TypeVar("AnyDocument", bound="Document", covariant=True)


class Answer(ABC, Generic[AnyDocument]):
    """A result. `print` and a notebook show it like the command of the same name."""

    @property
    @abstractmethod
    def document(self) -> AnyDocument:
        """The whole result, with the fields of `--json`."""

    @property
    @abstractmethod
    def brief(self) -> str:
        """Its main figures, in a line."""

    @abstractmethod
    def show(self) -> None:
        """Print it to the terminal."""

    def to_json(self) -> str:
        """The document as one line of JSON, as `--json` prints it."""
        return as_text(self.document)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.brief})"

    def __str__(self) -> str:
        from sqrp_cli.terminal.console import as_plain_text

        return as_plain_text(self.show)

    def _repr_html_(self) -> str:
        from sqrp_cli.terminal.console import as_html

        return as_html(self.show)


def how_many(several: Sized, noun: str) -> str:
    """How many there are, such as `1 candidate` or `6 candidates`."""
    return f"{len(several)} {noun}{'' if len(several) == 1 else 's'}"
