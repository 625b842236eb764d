"""Reading XML files safely, with the line of every element."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from sqrp_cli.errors import InputError, Place, Problem, nearest
from sqrp_cli.knowledge.text.bounds import LARGEST
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.text.source import excerpt

LONGEST_TAG = 60
"""Letters of a tag that messages show."""

MAX_BYTES = 10_000_000
"""Largest XML file that is read."""
MAX_DEPTH = 64
"""Deepest nesting of elements."""
MAX_ELEMENTS = 200_000
"""Most elements of a file."""


_BUFFER = 1 << 20
"""Bytes of text that are handed on at once."""

_TAG_MISMATCH = expat.errors.codes[expat.errors.XML_ERROR_TAG_MISMATCH]


@dataclass(frozen=True, eq=False)
class Element:
    """An XML element.

    pieces: the text in it, where the reader was asked to keep it; URDF and SRDF have none that matters.
    """

    tag: str
    attributes: dict[str, str]
    place: Place
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """The children with a tag, in file order."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first child with a tag, or None."""
        return next(self.all(tag), None)

    def need(self, tag: str) -> Element:
        """The first child with a tag; raises InputError if there is none."""
        child = self.first(tag)
        if child is None:
            raise self.error("missing-element", f"{self} has no <{tag}>")
        return child

    def text(self, attribute: str) -> str:
        """The value of an attribute, without spaces around it; raises InputError if it is missing or empty."""
        value = self.attributes.get(attribute, "").strip()
        if not value:
            close = nearest(attribute, self.attributes)
            hint = f", but `{close}`" if close else ""
            raise self.error("missing-attribute", f"{self} has no `{attribute}`{hint}")
        return value

    def numbers(
        self, attribute: str, count: int, default: tuple[float, ...] | None = None, most: float = LARGEST
    ) -> tuple[float, ...]:
        """The `count` numbers of an attribute; the default if it is missing and there is one.

        Raises InputError if they are not that many finite numbers, none larger than `most`, or if the attribute is
        missing without a default.
        """
        if default is not None and attribute not in self.attributes:
            return default
        text = self.text(attribute)
        try:
            numbers = tuple(float(word) for word in text.split())
        except ValueError:
            numbers = ()
        if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
            expected = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self.error("wrong-value", f"{self}: `{attribute}` is `{text}`, expected {expected}")
        if max(map(abs, numbers)) > most:
            message = f"{self}: `{attribute}` is `{text}`, expected at most {most:g} in size"
            raise self.error("wrong-value", message)
        return numbers

    def number(self, attribute: str, default: float | None = None, most: float = LARGEST) -> float:
        """As `numbers`, for one number."""
        return self.numbers(attribute, 1, None if default is None else (default,), most)[0]

    def error(self, code: str, message: str) -> InputError:
        """An error about this element."""
        return InputError(Problem(code, message, self.place))

    def __str__(self) -> str:
        key = next((key for key in ("name", "id") if self.attributes.get(key)), None)
        return f'<{self.shown_tag} {key}="{self.attributes[key]}">' if key else f"<{self.shown_tag}>"

    @property
    def shown_tag(self) -> str:
        """The tag, or its beginning: a damaged file may have one of a million letters."""
        return self.tag if len(self.tag) <= LONGEST_TAG else f"{self.tag[:LONGEST_TAG]}..."


def read_xml(path: Path, root_tag: str) -> Element:
    """The root element of an XML file, which must be a `root_tag`.

    Raises InputError, with line and column, for a file that is missing, too large, not XML, nested too deep, or that
    declares entities: a short file can unfold to gigabytes through them, or make the reader open other files.
    """
    return parse_xml(path, read_input(path, MAX_BYTES), root_tag)


def parse_xml(path: Path, content: bytes, root_tag: str, texts: frozenset[str] = frozenset()) -> Element:
    """As `read_xml`, of content that is at hand; path: what problems name.

    texts: tags of elements whose text is kept. It must be in one piece: where a comment or another element interrupts
    it, one reader takes the whole and another one what comes first.
    """
    parser = expat.ParserCreate()
    recognised = f"<{root_tag}".encode() in content  # else it may be another file, named to see what it says
    parser.specified_attributes = True  # other readers know nothing of a DOCTYPE's default values
    parser.buffer_text, parser.buffer_size = True, _BUFFER
    top: list[Element] = []
    open_elements: list[Element] = []
    count = 0

    def here() -> Place:
        return Place(path, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        element = Element(tag, attributes, here())
        if count > MAX_ELEMENTS:
            raise element.error("too-many-elements", f"the file has more than {MAX_ELEMENTS:,} elements")
        interrupt()
        if len(open_elements) == MAX_DEPTH:
            raise element.error("nesting-too-deep", f"elements are nested deeper than {MAX_DEPTH} levels")
        (open_elements[-1].children if open_elements else top).append(element)
        open_elements.append(element)

    def end(_tag: str) -> None:
        open_elements.pop()

    def keep(text: str) -> None:
        if open_elements and open_elements[-1].tag in texts:
            open_elements[-1].pieces.append(text)

    def interrupt(*_what: object) -> None:
        if open_elements and open_elements[-1].tag in texts:
            problem = Problem("xml-text", f"the text of {open_elements[-1]} is interrupted, expected one piece", here())
            raise InputError(problem)

    def unclosed(error: expat.ExpatError) -> str:
        if error.code != _TAG_MISMATCH or not open_elements:
            return expat.ErrorString(error.code)
        element = open_elements[-1]
        shown = element if recognised else f"<{element.shown_tag}>"
        return f"{shown} of line {element.place.line} is not closed before another closing tag"

    def refuse_entity(name: str, *_declaration: object) -> None:
        raise InputError(Problem("xml-entity", f"declares the entity `{name}`; entities are not accepted", here()))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler = refuse_entity
    if texts:
        parser.CharacterDataHandler = keep
        parser.CommentHandler = parser.ProcessingInstructionHandler = parser.StartCdataSectionHandler = interrupt
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        lines = re.split("\r\n?|\n", content.decode("utf-8", errors="replace"))  # as expat counts
        line = lines[error.lineno - 1] if error.lineno <= len(lines) else ""
        message = f"not well-formed XML: {unclosed(error)}"
        place = Place(path, error.lineno, error.offset + 1)
        shown = excerpt(line, error.offset + 1) if recognised else None
        raise InputError(Problem("xml-syntax", message, place, excerpt=shown)) from error
    except (LookupError, ValueError) as error:  # an encoding that does not exist, or has no table of single bytes
        message = f"not well-formed XML: {error}"
        raise InputError(Problem("xml-syntax", message, Place(path, 1), mend="save the file as UTF-8")) from error
    root = top[0]
    if root.tag != root_tag:
        raise root.error("wrong-root", f"the file begins with <{root.shown_tag}>, expected <{root_tag}>")
    return root
