"""Reading XML files safely, with the line of every element."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import field
from itertools import count
from pathlib import Path
from xml.parsers import expat

from sqrp_cli.errors import InputError, Place, Problem, bad_input, nearest
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import excerpt, too_deep
from sqrp_cli.files.units import LARGEST, as_number
from sqrp_cli.records import dataclass

LONGEST_TAG = 60  # most letters of a tag that are kept
MAX_BYTES = 10_000_000  # largest XML file that is read
MAX_DEPTH = 64  # deepest nesting of elements
MAX_ELEMENTS = 200_000  # most elements of a file
_BUFFER = 1 << 20  # size of the parser's text buffer [bytes]
_TAG_MISMATCH = expat.errors.codes[expat.errors.XML_ERROR_TAG_MISMATCH]


@dataclass(frozen=True, eq=False)
class Element:
    """An XML element."""

    tag: str  # Of a longer one the beginning: a damaged file may have one of a million letters
    attributes: dict[str, str]
    place: Place
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)
    """Its text, if the reader keeps it; URDF and SRDF have no text that matters."""

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

    def inside(self) -> Iterator[Element]:
        """All elements in it, in the order of the file."""
        for child in self.children:
            yield child
            yield from child.inside()

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
        """The `count` numbers of an attribute; the default, if any, where it is missing.

        Raises InputError unless they are `count` finite numbers of at most `most`, or if the attribute is missing
        without a default.
        """
        if default is not None and attribute not in self.attributes:
            return default
        text = self.text(attribute)
        numbers = tuple(map(as_number, text.split()))
        if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
            expected = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self.error("wrong-value", f"{self}: `{attribute}` is `{text}`, expected {expected}")
        if max(map(abs, numbers)) > most:
            raise self.error("wrong-value", f"{self}: `{attribute}` is `{text}`, expected at most {most:g} in size")
        return numbers

    def number(self, attribute: str, default: float | None = None, most: float = LARGEST) -> float:
        """As `numbers`, for one number."""
        return self.numbers(attribute, 1, None if default is None else (default,), most)[0]

    def error(self, code: str, message: str, mend: str | None = None) -> InputError:
        """An error about this element."""
        return bad_input(code, message, self.place, mend=mend)

    def __str__(self) -> str:
        key = next((key for key in ("name", "id") if self.attributes.get(key)), None)
        return f'<{self.tag} {key}="{self.attributes[key]}">' if key else f"<{self.tag}>"


def read_xml(path: Path, root_tag: str) -> Element:
    """The root element of an XML file, which must be a `root_tag`.

    Raises InputError, with line and column, for a file that is missing, too large, not XML, nested too deep, or
    declares entities: with them a short file can expand to gigabytes or make the reader open other files.
    """
    return parse_xml(path, read_input(path, MAX_BYTES), root_tag)


def parse_xml(path: Path, content: bytes, root_tag: str | None, texts: frozenset[str] = frozenset()) -> Element:
    """As `read_xml`, from content in memory; path: named in problems. Without a root_tag, any root is accepted.

    texts: tags of elements whose text is kept. It must be in one piece: if a comment or another element interrupts it,
    some readers take the whole text and others only its first part.
    """
    # Else it may be a secret file, named to see its content.
    recognised = f"<{root_tag or 'robot'}".encode() in content
    if not content.strip():
        message, mend = f"the file is empty, expected <{root_tag or 'robot'}>", "was it exported or copied completely?"
        raise bad_input("xml-syntax", message, Place(path), mend=mend)
    open_elements: list[Element] = []
    try:
        root = _root_of(path, content, texts, open_elements)
    except expat.ExpatError as error:
        lines = re.split("\r\n?|\n", content.decode("utf-8", errors="replace"))  # as expat counts
        line = lines[error.lineno - 1] if error.lineno <= len(lines) else ""
        said = expat.ErrorString(error.code).removeprefix("not well-formed ").strip("()")
        if error.code == _TAG_MISMATCH and open_elements:  # it leaves an element open
            element = open_elements[-1]
            shown = element if recognised else f"<{element.tag}>"
            said = f"{shown} of line {element.place.line} is not closed before another closing tag"
        place = Place(path, error.lineno, error.offset + 1)
        quote = excerpt(line, error.offset + 1) if recognised else None
        raise InputError(Problem("xml-syntax", f"not well-formed XML: {said}", place, excerpt=quote)) from error
    except (LookupError, ValueError) as error:  # an encoding that does not exist, or has no table of single bytes
        message = f"not well-formed XML: {error}"
        raise bad_input("xml-syntax", message, Place(path, 1), mend="save the file as UTF-8") from error
    if root_tag is not None and root.tag != root_tag:
        raise root.error("wrong-root", f"the file begins with <{root.tag}>, expected <{root_tag}>")
    return root


def _root_of(path: Path, content: bytes, texts: frozenset[str], opened: list[Element]) -> Element:
    """The element tree of a file, built with expat; opened: gets the elements that are open where it stops."""
    top: list[Element] = []
    parser, number = expat.ParserCreate(), count(1)

    def refuse(code: str, message: str) -> None:
        raise bad_input(code, message, Place(path, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1))

    def interrupt(*_what: object) -> None:
        if opened and opened[-1].tag in texts:
            refuse("xml-text", f"the text of {opened[-1]} is interrupted, expected one piece")

    def start(tag: str, attributes: dict[str, str]) -> None:
        shown = tag if len(tag) <= LONGEST_TAG else f"{tag[:LONGEST_TAG]}..."
        element = Element(shown, attributes, Place(path, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1))
        if next(number) > MAX_ELEMENTS:
            raise element.error("too-many-elements", f"the file has more than {MAX_ELEMENTS:,} elements")
        interrupt()
        if len(opened) == MAX_DEPTH:
            raise InputError(too_deep(element.place, MAX_DEPTH, "elements are "))
        (opened[-1].children if opened else top).append(element)
        opened.append(element)

    parser.specified_attributes = True  # other readers ignore the default values of a DOCTYPE
    parser.buffer_text, parser.buffer_size = True, _BUFFER
    parser.StartElementHandler, parser.EndElementHandler = start, lambda _tag: opened.pop()
    parser.EntityDeclHandler = lambda name, *_declaration: refuse(
        "xml-entity", f"declares the entity `{name}`; entities are not accepted"
    )
    if texts:
        parser.CharacterDataHandler = lambda text: opened[-1].pieces.append(text) if opened[-1].tag in texts else None
        parser.StartCdataSectionHandler = interrupt
        parser.CommentHandler = parser.ProcessingInstructionHandler = interrupt
    parser.Parse(content, True)
    return top[0]
