"""What `init` makes of arms as packages ship them: `python -m tests.arms [ARM ...]`, part of `make trials`.

Each arm of the matrix gets a new workspace from nothing but its URDF or xacro; its task is ranked, and the best
candidate run once in the simulated cell. The table says how far each got, and why no further. Exit code 0 if at least
`LEAST_RANKED` arms of packages and all written ones rank, and all that rank run to the end with at least 98 % of the
promised images as promised.

Workspaces are in build/arms; what is done is kept there, as long as the code does not change.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path

from sqrp_cli.run.cell.requirements import check_simulator
from sqrp_cli.show.terminal.console import Column, print_table
from tests.arms.arms import MatrixArm, arms_of_packages, linked_packages, written_arms
from tests.arms.trial import ArmOutcome, kept, tried

FOLDER = Path("build/arms")
LEAST_RANKED = 40
AT_A_TIME = 2
CODE = Path(__file__).parents[2] / "sqrp_cli"


def main(wanted: Sequence[str]) -> int:
    """Try the arms that are named, or all."""
    check_simulator()
    made = FOLDER / _fingerprint()
    for folder in (made / "urdf", made / "packages", made / "cells"):
        folder.mkdir(parents=True, exist_ok=True)
    shipped, written = [*arms_of_packages()], [*written_arms(made / "urdf")]
    arms = [arm for arm in (*shipped, *written) if not wanted or arm.name in wanted]
    if unknown := {*wanted} - {arm.name for arm in arms}:
        print(f"there is no arm {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    packages = linked_packages(made / "packages").absolute()
    found = _try_all(arms, made, packages)
    _print(list(found.values()))
    ranked = sum(found[arm.name].ranks for arm in shipped if arm.name in found)
    print(f"{ranked} of {len(shipped)} arms of packages rank; asked: {LEAST_RANKED}")
    failed = [one.name for one in found.values() if one.ranks and not one.holds]
    lost = [arm.name for arm in written if arm.name in found and not found[arm.name].ranks]
    return 0 if not failed and not lost and (wanted or ranked >= LEAST_RANKED) else 1


def _fingerprint() -> str:
    """Of the code that the outcomes depend on."""
    files = [*sorted(CODE.rglob("*.py")), *sorted(CODE.rglob("*.yaml")), Path(__file__).with_name("arms.py")]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _try_all(arms: Sequence[MatrixArm], made: Path, packages: Path) -> dict[str, ArmOutcome]:
    done = kept(made / "outcomes.jsonl")

    def one(arm: MatrixArm) -> ArmOutcome:
        if arm.name in done:
            return done[arm.name]
        cell = made / "cells" / arm.name.replace(" ", "_").replace(",", "")
        shutil.rmtree(cell, ignore_errors=True)
        outcome = tried(arm, cell, packages)
        print(outcome.name, "holds" if outcome.holds else outcome.reason or "seen less", file=sys.stderr, flush=True)
        return outcome

    with ThreadPoolExecutor(AT_A_TIME) as pool, (made / "outcomes.jsonl").open("a", encoding="utf-8") as file:
        under_way = [pool.submit(one, arm) for arm in arms]
        for outcome in (future.result() for future in as_completed(under_way)):
            if outcome.name not in done:
                file.write(json.dumps(asdict(outcome)) + "\n")
                file.flush()
    return {future.result().name: future.result() for future in under_way}


def _print(outcomes: Sequence[ArmOutcome]) -> None:
    counts = (Column(title, right=True) for title in ("axes", "cubes", "can"))
    titles = (Column("arm"), *counts, Column("run"), Column("seen"), Column("why not"))
    rows = [
        [
            one.name, f"{one.axes or ''}", str(one.cubes), str(one.feasible), "done" if one.done else "",
            f"{one.seen}/{one.promised}" if one.promised else "", one.reason,
        ]
        for one in outcomes
    ]  # fmt: skip
    print_table(titles, rows)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
