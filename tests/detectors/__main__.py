"""Detectors as they are: `python -m tests.detectors [FRAMES [MARKERS [FIRST]]]`, by default 1,600 frames of each kind.

Curves are learned by `calibrate` from frames of some seeds and judged on those of others, with poses of their own:
calibration error at most 3 points, Brier score at most half of that of the limits. Ranges of markers of any size,
dictionary, lens and angle, by default 12 cases made by seed from FIRST (0) on, agree with images to 10 %. Exit code 1
otherwise. Part of `make trials`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from sqrp_cli.ask.api.calibration import calibrate
from sqrp_cli.field.calibrating.fit import DetectorLooks, judge, tell
from tests.detectors.frames import shots, write_frames, write_workspace
from tests.detectors.ranges import Case

THINGS = {"aruco": "plate", "color": "cube"}
"""What each detector looks for."""

LEARNED, JUDGED = 1, 2
"""Seeds of the frames that are learned from, and of those that are held out."""

MOST_ERROR, MOST_OF_LIMITS, MOST_OFF = 0.03, 0.5, 0.1

LOOKS = 1000
"""Random views of each marker."""


def curves(folder: Path, count: int) -> Iterator[bool]:
    """Whether each curve is as good as it should be."""
    workspace = write_workspace(folder / "cell")
    print("detector  looks  calibration error [points]  Brier score  of limits  ratio")
    for detector, thing in THINGS.items():
        looks: dict[int, DetectorLooks] = {}
        for seed in (LEARNED, JUDGED):
            frames = folder / f"{thing}-{seed}"
            write_frames(workspace, frames, shots(workspace, thing, count, seed), seed, detector)
            found = calibrate(frames, workspace=folder / "cell")
            looks[seed] = found.looked[detector]
            if seed == LEARNED:
                curve = found.detectors[detector].curve
        assert curve is not None
        others = looks[JUDGED]
        own = judge(tell(curve, others, workspace.detectors[detector]), others.seen)
        limits = judge(others.covered * 1.0, others.seen)
        ratio = own.brier / limits.brier
        print(
            f"{detector:8}  {len(others):5}  {100 * own.calibration_error:26.1f}  {own.brier:11.3f}"
            f"  {limits.brier:9.3f}  {ratio:5.2f}",
            flush=True,
        )
        yield own.calibration_error <= MOST_ERROR and ratio <= MOST_OF_LIMITS


def ranges(seeds: range) -> Iterator[bool]:
    """Whether each range agrees with images."""
    print("\nmarker           side [mm]  image  focal  angle [deg]  predicted [m]  measured [m]")
    for seed in seeds:
        case = Case.by_seed(seed)
        measured = case.measured(LOOKS, seed)
        off = case.predicted / measured - 1.0
        print(
            f"{case.dictionary:15}  {1000 * case.side:9.0f}  {case.width:5}  {case.focal:5.0f}"
            f"  {57.2958 * case.incidence:11.0f}  {case.predicted:13.2f}  {measured:12.2f}  {100 * off:+5.1f} %",
            flush=True,
        )
        yield abs(off) <= MOST_OFF


def main(arguments: Sequence[str]) -> int:
    """Print a line for each detector and marker."""
    count, markers, first = (int(value) for value in (*arguments, *("1600", "12", "0")[len(arguments) :]))
    with tempfile.TemporaryDirectory() as folder:
        good = [*curves(Path(folder), count), *ranges(range(first, first + markers))]
    print(f"\n{sum(good)} of {len(good)} are as they should be.")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
