"""What a page carries: nothing lost but what follows from the rest, nothing hidden in names; what is of trimesh."""

from __future__ import annotations

import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError
from sqrp_cli.shapes import Part, Sphere, Triangles
from sqrp_cli.show.pages import assembly
from sqrp_cli.show.pages.assembly import MOST_TRIANGLES, packed, simplified, tidy, viewer_library, visible
from sqrp_cli.sight.solids import load_solid


def unpacked(text: str) -> object:
    return json.loads(zlib.decompress(base64.b64decode(text)))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(-1e6, 1e6) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@given(json_values)
def test_a_page_carries_a_document_as_it_was_tidied(value):
    assert unpacked(packed(value)) == tidy(value)


@given(st.text())
def test_packed_text_is_no_markup(text):
    assert not set(packed({text: text})) & set("<>&\"'")


@given(st.floats(-1e3, 1e3))
def test_figures_are_kept_to_a_millionth(figure):
    assert tidy(figure) == pytest.approx(figure, abs=5.1e-7)


@pytest.mark.parametrize("mark", ["\u202e", "\u2066", "\u200f", "\u200b", "\0", "\n", "\ufeff", "\u2028"])
def test_what_cannot_be_seen_is_spelled_out(mark):
    assert visible(f"cam{mark}1") == f"cam\\u{{{ord(mark):x}}}1"


@pytest.mark.parametrize("text", ["hold(g1)", "Kamera süd", "מצלמה", "相机 2", "<b>&amp;'\""])
def test_what_can_be_seen_stays(text):
    assert visible(text) == text


def test_the_viewer_library_is_three_js_alone():
    library = viewer_library()
    assert "Three.js Authors" in library.splitlines()[2]
    assert "t.PerspectiveCamera=" in library
    assert "GLTFLoader" not in library
    assert "</" not in library


def test_a_small_mesh_is_kept_and_its_double_vertices_merged():
    solid = load_solid(Part("ball", "world", Sphere(0.1), np.eye(4)))
    corners = solid.vertices[solid.triangles.reshape(-1)]
    found = simplified(Triangles(corners, np.arange(len(corners)).reshape(-1, 3)))
    assert len(found.vertices) < len(solid.vertices)
    assert np.linalg.norm(found.vertices[found.faces], axis=-1).max() == pytest.approx(0.1, rel=0.01)


def test_a_large_mesh_is_simplified_and_keeps_its_shape():
    u, v = (axis.reshape(-1) for axis in np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 101)))
    vertices = np.column_stack([u, v, 0.1 * np.sin(6 * u) * np.cos(6 * v)])
    corner = np.arange(101 * 101).reshape(101, 101)
    a, b, c, d = (block.reshape(-1) for block in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    found = simplified(Triangles(vertices, faces))
    fewer = found.vertices
    assert len(found.faces) <= MOST_TRIANGLES
    assert np.abs(fewer[:, 2] - 0.1 * np.sin(6 * fewer[:, 0]) * np.cos(6 * fewer[:, 1])).max() < 2e-3


def test_without_the_library_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr(assembly, "find_spec", lambda _: None)
    with pytest.raises(InputError) as error:
        viewer_library()
    assert error.value.problems[0].mend == "pip install trimesh fast-simplification"
