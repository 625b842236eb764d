"""Options that make no sense: exit 2, a message that names the option and what is expected, nothing on stdout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

BAD = [
    (["chek"], ["there is no command `chek`", "did you mean `check`?"]),
    (["rank", "", "watch seen"], ["WORKSPACE is empty; expected: Folder of a workspace"]),
    (["rank", "CELL", "watch seen", "--report", ""], ["--report is empty; expected FILE: "]),
    (["rank", "CELL", "watch seen", "--report="], ["--report is empty; expected FILE: "]),
    (["rank", ".", "watch seen", "--report", ""], ["--report is empty; expected FILE: "]),
    (["check", "./", ""], ["TASK is empty, expected a skill"]),
    (["rank", "CELL", "wach seen"], ["workspace.yaml:", "there is no skill `wach` under `skills`", "`watch`"]),
    (["score", ""], ["PATH is empty; expected a workspace"]),
    (["nosuch", "CELL"], ["there is no command `nosuch`", "`check`", "`rank`", "`init`"]),
    (["place", "CELL", "--survive", "2"], ["--survive is 2, expected a whole number from 0 to 1"]),
    (["place", "CELL", "--budget", "-5"], ["--budget is -5, expected a number from 0 on"]),
    (["audit", "CELL", "CELL", "--threshold", "x"], ["--threshold is `x`, expected 0% to 100%"]),
    (["rank", "CELL", "watch seen", "--dt", "1e-9"], ["--dt", "1e-09", "at least"]),
    (["rank", "CELL", "watch seen", "--dt", "1 deg"], ["--dt", "`1 deg`", "a time such as"]),
    (["rank", "CELL", "watch seen", "--dt", "nan"], ["--dt", "`nan`"]),
    (["rank", "CELL", "watch seen", "--samples", "1"], ["--samples is 1", "2 to 20,000"]),
    (["rank", "CELL", "watch seen", "--samples", "1000000"], ["--samples is 1000000", "2 to 20,000"]),
    (
        ["rank", "CELL", "watch seen", "--samples", "many"],
        ["--samples is `many`, expected a whole", "rank --help"],
    ),
    (["rank", "CELL", "watch seen", "--tolerance", "1e-12"], ["--tolerance", "0.001 to 100"]),
    (["rank", "CELL", "watch seen", "--tolerance", "inf"], ["--tolerance", "0.001 to 100"]),
    (["rank", "CELL", "watch seen", "--samples", "5", "--dt", "1"], ["--samples and --dt exclude each other"]),
    (["rank", "CELL", "watch seen", "--seed", "-1"], ["--seed is -1, expected a whole number from 0 on"]),
    (["rank", "CELL", "watch seen", "--jobs", "0"], ["--jobs is 0, expected a whole number from 1 on"]),
    (["rank", "CELL", "watch seen", "--by", "qeoi"], ["--by", "did you mean `q_eoi`?"]),
    (["rank", "CELL", "watch seen", "--choose", "sen"], ["`sen`", "did you mean `seen`?"]),
    (["rank", "CELL", "watch", "--choose", "99"], ["no place 99 in a ranking of ", "(what cannot be done comes last)"]),
    (["rank", "CELL", "watch seen", "--choose", "2"], ["no place 2 in a ranking of 1 candidate; expected 1, or"]),
    (["explain", "CELL", "--image", "x"], ["`sqrp explain` has no option `--image`; did you mean `--images`?\n"]),
    (["init", "there", "--no-runs"], ["`sqrp init` has no option `--no-runs`; did you mean `--no-run`?\n"]),
    (["init", "there", "--tip", "--no-run"], ["LINK is missing after --tip"]),
    (["rank", "CELL", "watch seen", "--nonsense"], ["`sqrp rank` has no option `--nonsense`\n"]),
    (["run", "CELL", "--sim", "--sweep", "--n", "0"], ["[STEP:]slip@PRIMITIVE is missing after --sweep: "]),
    (["rank", "CELL", "watch seen", "--program", "--json"], ["PROGRAM is missing after --program: "]),
    (["run", "--robot", "CELL/arm.yaml"], ["expected a program", "sqrp run PROGRAM --robot "]),
    (["advise", "CELL", "watch seen", "--want", "time 20 kg"], ["expected a time after `time`, such as `time 20 s`"]),
    (["rank", "CELL", "watch seen", "--calibration", "5 kg"], ["--calibration", "`5 kg`", "5 mm, 0.5 deg"]),
    (["rank", "CELL", "watch seen", "--calibration", "1e308 m"], ["--calibration", "up to 1 m"]),
    (["rank", "CELL", "watch seen", "--certify", "2 mm"], ["`sqrp rank` has no option `--certify`\n"]),
    *(
        (["rank", "CELL", "watch seen", "--calibration", text], [f"--calibration: {says}; try `5 mm, 0.5 deg`\n"])
        for text, says in {
            "0,0": "`0` has no unit",
            "2 mm 0.2 deg": "`2 mm 0.2 deg` lacks a comma",
            "-2 mm": "`-2 mm` is negative",
            "2 mm, -0.2 deg": "`-0.2 deg` is negative",
            "2 m": "`2 m` is not up to 1 m",
            "2 mm, 60 deg": "`60 deg` is not up to 1 rad",
            "2 mm, 3 cm": "`3 cm` is a length once more",
            "2 s": "`2 s` is no length or angle",
            "2 mm,": "`` is no length or angle",
        }.items()
    ),
    (["--show-completion", "tcsh"], ["--show-completion is `tcsh`", "`bash`", "`fish`", "`zsh`"]),
    (["--install-completion", "--help"], ["--install-completion is `--help`", "`bash`", "`fish`", "`zsh`"]),
    (["-q", "--show-completion=tcsh"], ["--show-completion is `tcsh`"]),
    (["rank", "CELL", "watch seen", "--after", "TMP/none.yaml"], ["none.yaml", "no such file or folder"]),
    (["rank", "CELL", "watch seen", "--program", "TMP/no/such.yaml"], ["there is no folder", "mkdir -p"]),
    (["rank", "CELL", "watch seen", "--program", "TMP"], ["this is a folder"]),
    (["rank", "CELL", "watch seen", "--smples", "5"], ["--smples", "--samples"]),
    (["rank", "CELL"], ["TASK", "rank --help"]),
    (["rank", "TMP/none", "watch seen"], ["no such file or folder"]),
    (["rank", "CELL", ""], ["skill"]),
    (["rank", "CELL", "wacth seen"], ["`wacth`", "did you mean `watch`?"]),
    (["rank", "CELL", "watch sen"], ["`sen`", "did you mean `seen`?"]),
    (["explain", "CELL", "watch seen", "--choose", "sen"], ["`sen`", "did you mean `seen`?"]),
    (["explain", "TMP/none.yaml", "--step", "1"], ["none.yaml", "no such file or folder"]),
    (["explain", "CELL", "watch seen", "--choose", ""], ["--choose is empty, expected the name of a candidate"]),
    (["rank", "CELL", "watch seen", "--choose", ""], ["--choose is empty, expected the name of a candidate"]),
    (["advise", "CELL", "watch seen", "--kinds", ","], ["--kinds is empty, expected kinds of changes"]),
    (["advise", "CELL", "watch seen", "--kinds", ""], ["--kinds is empty, expected kinds of changes"]),
    (["set", "CELL", "foo.bar=3"], ["no value `foo.bar`; expected one of `cameras`, `detectors`, ", ", `tasks`\n"]),
    (["check", "CELL", "watch seen", "--after", "TMP"], ["found a folder, expected the file of a program"]),
    (["show", "TMP"], ["no workspace.yaml", "empty"]),
    (["init", "CELL"], ["not empty", "nothing is ever overwritten"]),
    (["init", "TMP/no/such"], ["there is no folder", "mkdir -p"]),
    (["init", "CELL/workspace.yaml/new"], ["workspace.yaml is a file, so nothing can be below it"]),
    (["rank", "CELL", "watch seen", "--report", "CELL/workspace.yaml/x"], ["is a file, so nothing can be below it"]),
    (["init", "TMP/new", "--urdf", "TMP/none.urdf"], ["none.urdf", "no such file or folder"]),
    (["init", "TMP/new", "--urdf", "package://none/arm.urdf"], ["package `none` not found", "roots tried"]),
    (["score", "CELL", "--draws", "5"], ["--draws is about --vary"]),
    (["score", "CELL", "--patch", "TMP/x.patch"], ["--patch is about --vary"]),
    (["score", "CELL", "--out", "CELL/workspace.yaml"], ["this is a file; expected the name of a folder"]),
    (["rank", "CELL", "watch seen", "--report", "CELL/workspace.yaml"], ["so it is not overwritten"]),
    (["rank", "CELL", "watch seen", "--report", "TMP/x", "--program", "TMP/x"], ["--program and --report both name"]),
    (["score", "CELL", "--junit", "TMP/x", "--summary", "TMP/./x"], ["--junit and --summary both name"]),
    (["run", "TMP/p.yaml", "--sim", "--log", "TMP/x", "--report", "TMP/x"], ["--log and --report both name"]),
    (["run", "TMP/p.yaml", "--sim", "--log", "TMP/x", "--frames", "TMP/x"], ["--log and --frames both name"]),
    (["run", "TMP/p.yaml", "--sim", "--sweep", "slip@a4", "--log", "TMP/l"], ["--sweep and --log exclude each other"]),
    (["run", "TMP/p.yaml", "--sim", "--sweep", "slip@a4", "--fault", "miss-pick"], ["--sweep and --fault exclude"]),
    (["run", "TMP/p.yaml", "--sim", "--n", "3"], ["--n is about --sweep"]),
    (["run", "TMP/p.yaml", "--sim", "--record", "TMP/x.avi"], ["--record", "ends in .mp4"]),
    (["run", "TMP/p.yaml", "--sim", "--record", "TMP/\udcff.mp4"], ["--record", "not UTF-8 text"]),
    (["run", "--replay", "TMP/l", "--n", "3"], ["--replay and --n exclude each other"]),
    (["run", "--replay", "TMP/l"], ["no such file or folder"]),
    (["rnak", "CELL", "watch seen"], ["rnak"]),
    (["program", "nwe", "CELL"], ["one program at a time", "sqrp program new"]),
    (["run", "--replay", "CELL/arm.urdf"], ["this is no log", "--sim --log FILE"]),
    (["run", "--replay", "CELL/workspace.yaml"], ["workspace.yaml:1: this is no log of `sqrp run --log`"]),
    (["run", "--replay", "CELL/../cameras"], ["found a folder, expected a file"]),
    (["score", "CELL", "--baseline", "CELL"], ["found a folder, expected a file"]),
    (["score", "CELL", "--baseline", "CELL/workspce.yaml"], ["did you mean `workspace.yaml`?", "--save-baseline"]),
    (["score", "CELL", "--vary", "cameras.eye.near=-1e308:1e308:3"], ["--vary", "not so far apart"]),
    (["score", "CELL", "--vary", "cameras.eye.near=1:1e400:3"], ["--vary", "not so far apart"]),
    (["score", "CELL", "--vary", "name=1:2:2"], ["no value `name`", "`cameras.eye.far`", "more"]),
]


@pytest.mark.parametrize(("words", "says"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_it_is_refused_and_named(words: list[str], says: list[str], sqrp: Any, watch: Path, tmp_path: Path) -> None:
    outcome = sqrp(*(word.replace("CELL", str(watch)).replace("TMP", str(tmp_path)) for word in words))
    assert outcome.code == 2
    assert outcome.out == ""
    for piece in says:
        assert piece in outcome.err
    assert "Traceback" not in outcome.err
    assert "--calibration" not in words or all(len(line) <= 80 for line in outcome.err.splitlines())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["rank", "none", "watch seen"],
        ["check", "none"],
        ["score", "none"],
        ["diff", "none", "none"],
        ["rank", "CELL", "watch seen", "--after", "none"],
        ["run", "none", "--sim"],
        ["run", "--replay", "none"],
        ["audit", "none", "none"],
        ["program", "none"],
        ["score", "CELL", "--baseline", "none"],
        ["init", "new", "--urdf", "none"],
    ],
)
def test_what_is_missing_is_named_as_it_was_given_and_in_the_same_words(
    arguments: list[str], sqrp: Any, watch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = sqrp(*(watch if word == "CELL" else word for word in arguments))
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith("error: none: no such file or folder\n")


def test_a_folder_that_a_file_should_be_written_to_is_named_as_it_was_given(
    sqrp: Any, watch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = sqrp("rank", watch, "watch seen", "--program", "no/such.yaml")
    assert outcome.code == 2
    assert outcome.err.startswith("error: no/such.yaml: there is no folder no\n  to mend it: mkdir -p no\n")
