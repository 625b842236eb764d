"""What the process that computes tells browsers: the same as the documents, and sketches as samples of the exact."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from sqrp_cli import open_cell
from sqrp_cli.errors import InputError
from sqrp_cli.show.pages.assembly import tidy
from sqrp_cli.show.pages.candidate_page import playback
from sqrp_cli.studio.moves import Move, moved
from sqrp_cli.studio.session import program_file
from sqrp_cli.studio.sketch import SHORTEST, Sketch, joined
from sqrp_cli.studio.worker import _detail, _nicely, sketches_of
from sqrp_cli.study.sampling import FixedStep
from tests.studio.hand import ROOT


@pytest.fixture(scope="module")
def explained():
    """A candidate of which much is hidden, in its fastest way."""
    ranking = open_cell(ROOT / "workspaces" / "tabletop").rank(
        "pickup g1", ways="fastest", sampling=FixedStep(SHORTEST)
    )
    job = ranking.session.job
    return job, job.explain(ranking.candidates[0])


def test_what_is_shown_briefly_is_what_is_shown_in_full_but_for_boxes(explained):
    full, brief = (tidy(playback(*explained, brief=brief), digits=None) for brief in (False, True))
    for sample in full["samples"]:
        for literal in sample["literals"].values():
            literal["boxes"] = []
    assert full["hidden"]
    assert {**full, "hidden": [], "to_move": []} == brief


def test_a_candidate_of_one_step_is_shown_over_time(explained, monkeypatch):
    monkeypatch.setattr(os, "nice", lambda _: None)  # of this process
    job, whole = explained
    told = json.loads(_nicely(_detail, job, whole.result)(None))
    assert told["do"] == "detail"
    assert told["detail"]["samples"]


def compared(shown, exact, result):
    """A sketch has the qualities of a result, and the verdicts of what is shown over time, at the same instants."""
    assert shown.t == pytest.approx([sample["t"] for sample in exact])
    assert shown.covered == [sample["covered"] for sample in exact]
    assert (shown.q_avg, shown.q_eoi) == (pytest.approx(result.q_avg), pytest.approx(result.q_eoi))
    for index, sample in enumerate(exact):
        for literal, found in sample["literals"].items():
            atom = shown.atoms[literal.removeprefix("not ")]
            assert atom["covered"][index] == found["covered"]
            assert {name: tidy(shown.verdicts[rows[index]]) for name, rows in atom["cameras"].items()} == found[
                "cameras"
            ]


def test_a_sketch_of_the_cell_as_it_is_has_the_verdicts_of_these_samples(explained):
    job, whole = explained
    shown = Sketch.of(job.cell, whole.analysis.planned).seen_by(job.cell)
    compared(shown, tidy(playback(*explained, brief=True), digits=None)["samples"], whole.result)


def test_steps_one_after_another_have_the_verdicts_and_qualities_of_these_samples():
    ranking = open_cell(ROOT / "workspaces" / "tabletop").rank(
        "pickup g1 then place g1 crate", ways="fastest", sampling=FixedStep(SHORTEST)
    )
    job = ranking.session.job
    whole = job.explain(ranking.candidates[0])
    sketches = sketches_of(job.cell, [step.way for step in ranking.candidates[0].steps])
    assert len(sketches) == len(whole.steps) == 2
    shown = joined(sketches, [one.seen_by(one.cell) for one in sketches])
    compared(shown, tidy(playback(job, whole, brief=True), digits=None)["samples"], whole.result)


def test_a_camera_that_moves_is_sketched_as_if_all_were_looked_at_anew(explained):
    job, whole = explained
    sketch = Sketch.of(job.cell, whole.analysis.planned)
    camera = job.cell.workspace.cameras["cam1"]
    there = (camera.X_FC[:3, 3] + np.array([0.1, 0.05, 0.0])).tolist()
    move = Move(kind="camera", name="cam1", position=there)
    cell = job.cell.with_cameras_of(moved(job.cell.workspace, move))
    assert sketch.seen_by(cell, "cam1") == sketch.seen_by(cell)
    assert sketch.seen_by(cell) != sketch.seen_by(job.cell)


@pytest.mark.parametrize("name", ["pick", "a\0b.yaml", "a\nb.yml"])
def test_a_name_that_no_program_can_have_is_refused(name):
    with pytest.raises(InputError, match="expected a file of a program"):
        program_file(name)
