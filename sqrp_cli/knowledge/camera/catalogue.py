"""Industrial cameras with lenses that come with the package, each with the source of its figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sqrp_cli.knowledge.camera.camera import ImageEntry, Sensing
from sqrp_cli.knowledge.text.entries import Entry, Name, Text
from sqrp_cli.knowledge.text.yaml_file import read_yaml

CATALOGUE = Path(__file__).with_name("catalogue.yaml")


@dataclass(frozen=True, eq=False, kw_only=True)
class CatalogueEntry(Sensing):
    """A camera with a lens, as their makers describe them."""

    camera: Text
    """Maker, model, sensor."""
    lens: Text
    """Maker, model, focal length."""
    source: Text
    """Where the figures are from."""
    image: Annotated[ImageEntry, Field(description="Size and focal length of the image.")]


class _CatalogueFile(Entry):
    entries: dict[Name, CatalogueEntry]


@cache
def catalogue() -> Mapping[str, CatalogueEntry]:
    """The entries by name."""
    document = read_yaml(CATALOGUE)
    return _CatalogueFile.model_validate({"entries": document.data}).entries
