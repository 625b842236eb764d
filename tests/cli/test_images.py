"""`explain --images`: a picture per blind interval and camera, in which the target is outlined where it is."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from tests.cells import edit

GREEN, RED = (42, 157, 111), (208, 58, 75)


def read(path) -> np.ndarray:
    """Pixels of a picture as red, green, blue."""
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def outline(image: np.ndarray, color: tuple[int, int, int]) -> tuple[float, float, float, float]:
    """Least and greatest column and row of the pixels of a colour."""
    rows, columns = np.nonzero((image == color).all(axis=2))
    return columns.min(), columns.max(), rows.min(), rows.max()


@pytest.fixture(scope="module")
def turned(sqrp, watch, tmp_path_factory):
    """Pictures of a cube whose marker is turned away for a second; the camera looks along x from (0, 0, 1)."""
    folder = tmp_path_factory.mktemp("pictures") / "turned"
    outcome = sqrp("explain", watch, "watch turned", "--images", folder)
    assert outcome.code == 0, outcome.err
    return folder, outcome


def test_pictures_show_things_where_the_intrinsics_put_them_and_targets_outlined(turned):
    # There is a picture per blind interval and camera of its size with lines under it and a sheet.
    folder, outcome = turned
    assert sorted(path.name for path in folder.iterdir()) == ["01_0.5s-1.5s_eye.png", "contact-sheet.png"]
    assert f"1 blind interval, see {folder / 'contact-sheet.png'}" in outcome.err
    height, width, _ = read(folder / "01_0.5s-1.5s_eye.png").shape
    assert width == 641
    assert 481 + 40 < height < 481 + 120
    # Things are where the intrinsics put them.
    image = read(turned[0] / "01_0.5s-1.5s_eye.png").astype(int)
    # `seen` is green, at y = 0.3 m; its face is 1.95 m away: u = 320 - 400 * 0.3 / 1.95.
    red, green, blue = image[240, round(320 - 400 * 0.3 / 1.95)]
    assert green > red + 20
    assert green > blue + 20
    face = image[240, :320, 1] - image[240, :320, 0] > 20
    assert np.flatnonzero(face).min() == pytest.approx(320 - 400 * 0.35 / 1.95, abs=1)
    assert abs(image[20, 320] - image[20, 321]).max() < 3, "the sky"
    # The target is outlined where it is in red and what is covered in green.
    image = read(turned[0] / "01_0.5s-1.5s_eye.png")[:481]
    cosine, sine = np.cos(np.radians(80)), np.sin(np.radians(80))
    corners = np.array([[x, y, z] for x in (-0.0505, -0.0515) for y in (-0.04, 0.04) for z in (-0.04, 0.04)])
    x, y = 2 + cosine * corners[:, 0] - sine * corners[:, 1], -0.3 + sine * corners[:, 0] + cosine * corners[:, 1]
    u, v = 320 - 400 * y / x, 240 - 400 * corners[:, 2] / x
    assert outline(image, RED) == pytest.approx((u.min(), u.max(), v.min(), v.max()), abs=3)
    left, right, top, bottom = outline(image, GREEN)
    assert (top + bottom) / 2 == pytest.approx(240, abs=2)
    assert left > 320
    assert right - left == pytest.approx(400 * 0.05 * (cosine + sine), abs=8)


def test_a_lens_bends_the_picture_as_it_bends_the_verdicts(sqrp, own_watch, tmp_path):
    edit(own_watch, "fx: 400}", "fx: 400, distortion: {model: plumb_bob, coefficients: [-0.3, 0.1, 0, 0, 0]}}")
    assert sqrp("explain", own_watch, "watch turned", "--images", tmp_path / "bent").code == 0
    face = read(tmp_path / "bent" / "01_0.5s-1.5s_eye.png").astype(int)[240, :320]
    x = 0.35 / 1.95
    edge = 320 - 400 * x * (1 - 0.3 * x**2 + 0.1 * x**4)
    assert np.flatnonzero(face[:, 1] - face[:, 0] > 20).min() == pytest.approx(edge, abs=1)


def test_several_candidates_get_a_folder_each(sqrp, watch, tmp_path):
    outcome = sqrp("explain", watch, "watch green", "--all", "--images", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["turned"]
    assert "seen: never blind, so there are no pictures" in outcome.err


@pytest.mark.parametrize(("package", "mend"), [("embreex", "pip install embreex"), ("PIL", "pip install pillow")])
def test_a_missing_library_is_named_with_the_command_that_installs_it(
    sqrp, watch, tmp_path, monkeypatch, package, mend
):
    for name in [package, *(name for name in sys.modules if name.startswith(f"{package}."))]:
        monkeypatch.setitem(sys.modules, name, None)  # importing it raises ImportError
    outcome = sqrp("explain", watch, "watch turned", "--images", tmp_path / "new")
    assert outcome.code == 2
    assert mend in outcome.err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("width", "height"), [(12_000, 9_000), (100_000, 1), (1, 100_000)])
def test_the_picture_of_a_large_camera_is_drawn_smaller_with_the_same_view(sqrp, own_watch, tmp_path, width, height):
    image = f"image: {{width: {width}, height: {height}, fx: {400 * width / 641}, fy: {400 * height / 481}}}"
    edit(own_watch, "image: {width: 641, height: 481, fx: 400}", image)
    outcome = sqrp("explain", own_watch, "watch turned", "--images", tmp_path / "pictures")
    assert outcome.code == 0, outcome.err
    assert ("pictures have at most 1,000,000 pixels; those of `eye` are smaller" in outcome.err) == (width == 12_000)
    for made in (tmp_path / "pictures").iterdir():
        assert read(made).size < 30_000_000
    if width == 12_000:
        picture = read(next((tmp_path / "pictures").glob("01*.png"))).astype(int)
        assert picture.shape[1] == 1090, "an eleventh"
        column = round((320 - 400 * 0.3 / 1.95 + 0.5) * 1090 / 641)
        assert picture[409, column, 1] > picture[409, column, 0] + 20, "the green face is where it was"
