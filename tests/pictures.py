"""Makes the pictures in `docs/pictures`: `python -m tests.pictures`. The same pictures every time."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from sqrp_cli.cli.main import run
from tests.cells import copied
from tests.cli.browser import Opened, chromium
from tests.studio.hand import Hand, Started

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs" / "pictures"
CELL = str(ROOT / "workspaces" / "tabletop")
TASK = "pickup green"
ONE_BRANCH = f"{TASK} shoulder=left wrist=no_flip"
"""As on the page that shows the sheet."""
SHOW_SLIP = "() => { document.getElementById('follow').click(); sqrp.seek(5.75); }"
SHOW_G1 = "() => sqrp.select(3).then(() => { sqrp.look(null); sqrp.seek(5.2); })"


def save(picture: Image.Image, name: str, width: int = 1280) -> None:
    """A small PNG: at most `width` pixels wide. Words that are shown are kept in it, as its `Description`."""
    words = PngInfo()
    words.add_itxt("Description", picture.info.get("words", ""))
    picture = picture.convert("RGB")
    if picture.width > width:
        size = (width, round(picture.height * width / picture.width))
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    picture.save(DOCS / name, optimize=True, pnginfo=words)


def shown(browser: Any, page: Path, script: str) -> Image.Image:
    """A page down to what it says about the one that is chosen, after a script; its `words` are those of the page."""
    opened = Opened(browser, page)
    opened.page.set_viewport_size({"width": 1400, "height": 1040})
    opened.js(script)
    opened.page.wait_for_timeout(1000)
    shot = Image.open(io.BytesIO(opened.page.screenshot(full_page=True)))
    bottom = opened.js("document.querySelector('#candidate').getBoundingClientRect().bottom + scrollY")
    words = opened.page.inner_text("body")
    opened.context.close()
    cropped = shot.crop((0, 0, shot.width, round(bottom) + 16))
    cropped.info["words"] = words
    return cropped


def studio(browser: Any, folder: Path) -> Image.Image:
    """The studio after a camera was dragged."""
    started = Started(copied(folder).relative_to(folder), TASK, cwd=folder)
    hand = Hand(browser, started.address)
    hand.wait("return sqrp.settled")
    hand.take("camera", "cam3")
    hand.drag("x", 60, 20)
    hand.wait("return sqrp.state.dirty && sqrp.settled && sqrp.entries.some(({ was }) => was)")
    hand.page.wait_for_timeout(3000)
    hand.js("sqrp.seek(2.6)")
    hand.page.wait_for_timeout(500)
    shot = Image.open(io.BytesIO(hand.page.screenshot()))
    started.closed()
    return shot


def main() -> None:
    """A page, the page of a run, the studio, and what all cameras see in the blind intervals."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        page, pictures = Path(folder) / "page.html", Path(folder) / "pictures"
        assert run(["rank", CELL, TASK, "--report", str(page)]) == 0
        assert run(["explain", CELL, ONE_BRANCH, "--choose", "g1", "--images", str(pictures)]) == 0
        save(shown(browser, page, SHOW_G1), "report.png")
        save(studio(browser, Path(folder) / "studio"), "studio.png", width=1400)
        program, slip = str(Path(folder) / "pick.yaml"), ["--sim", "--fault", "slip@a4+1"]
        assert run(["rank", CELL, TASK, "--program", program]) == 0
        assert run(["run", program, *slip, "--report", str(page)]) == 0
        save(shown(browser, page, SHOW_SLIP), "run.png")
        save(Image.open(pictures / "contact-sheet.png"), "cameras.png", width=1976)


if __name__ == "__main__":
    main()
