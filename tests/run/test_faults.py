"""Faults as the command line writes them, and what a run keeps account of where cameras and their processes fail."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.faults import FaultTracker, InjectedFault, parse_fault, parse_sweep
from sqrp_cli.run.perception.streams import ImageStreams
from sqrp_cli.run.record.report import Stopped
from tests.cells import read_cases, refused


def program_step(short_task: str, faults: list[str | None], primitives: list[list]) -> SimpleNamespace:
    """A step of primitives: name, action, what is held in it, start and end [s], and in some what it does."""
    keys = ("name", "action", "held", "start", "end", "does")
    known = [SimpleNamespace(**{"does": None, **dict(zip(keys, one, strict=False))}) for one in primitives]
    formulas = [SimpleNamespace(fault=fault) for fault in faults]
    return SimpleNamespace(primitives=known, formulas=formulas, short_task=short_task)


CASES = read_cases("faults.yaml")
STEPS = {name: program_step(**step) for name, step in CASES["steps"].items()}
PICKUP, PLACE = STEPS["PICKUP"], STEPS["PLACE"]
CAMERAS, TAKE = ("cam1", "cam2"), "let a camera fail instead: --fault camera-loss:CAMERA@1.0"


def parse(text: str, *steps: SimpleNamespace, seed: int = 0) -> InjectedFault:
    return parse_fault(text, steps or [PICKUP], CAMERAS, np.random.default_rng(seed))


@pytest.mark.parametrize(("text", "kind", "camera", "t", "delay"), CASES["read"])
def test_a_fault_says_what_happens_when_with_units_if_wanted(
    text: str, kind: str, camera: str | None, t: float, delay: float
) -> None:
    found = parse(text)
    assert (found.kind, found.camera, found.t) == (kind, camera, pytest.approx(t))
    assert found.delay == pytest.approx(delay)


def test_a_random_slip_lies_within_its_primitive_and_repeats_with_its_seed() -> None:
    times = [parse("slip@a4:random", seed=seed).t for seed in range(20)]
    assert all(2.0 <= t <= 5.0 for t in times)
    assert times == [parse("slip@a4:random", seed=seed).t for seed in range(20)]
    assert len(set(times)) == 20


EMPTY = SimpleNamespace(primitives=PICKUP.primitives[:2], short_task="move")


@pytest.mark.parametrize("text", ["slip@a1", "moved@a1", "camera-loss:cam1@1"])
def test_what_holds_nothing_at_all_can_only_lose_a_camera(text: str) -> None:
    found = refused(parse, "slip@0.1", EMPTY)
    assert "nothing in `a1`, nor in any other" in found.message
    assert found.mend == TAKE == refused(parse_sweep, text, [EMPTY]).mend  # a sweep leads to no other sweep


@pytest.mark.parametrize(("text", "said"), CASES["refused"])
def test_a_bad_fault_is_refused_with_what_was_expected(text: str, said: str) -> None:
    found, kind = refused(parse, text), text.split("@")[0].split(":")[0]
    assert found.message.startswith(f"--fault {text}: ")
    assert said in f"{found.message}; {found.mend}"
    assert (kind and kind in found.mend) or "give one of: slip@lift+0.4" in found.mend


@pytest.mark.parametrize(("text", "steps", "step", "t"), CASES["chosen"])
def test_a_fault_happens_in_the_step_that_is_told_or_the_first_in_which_it_can(text, steps, step: int, t) -> None:
    program = [STEPS[name] for name in steps]
    fault = parse(text, *program)
    assert (fault.text, fault.step) == (text, step)
    assert fault.t == (pytest.approx(t, abs=0.25) if "random" in text else t)
    if (name := text.partition("@")[2]) in ("a1", "a3", "a4"):  # a sweep finds its step as a fault does
        number, primitive = parse_sweep(text, program)
        assert (number, primitive.name) == (step, name)


@pytest.mark.parametrize(("option", "text", "said", "mend"), CASES["of_steps"])
def test_messages_name_the_step_that_they_are_about(option: str, text: str, said: str, mend: str) -> None:
    steps = [PLACE, PICKUP]
    found = refused(parse, text, *steps) if option == "fault" else refused(parse_sweep, text, steps)
    assert found.message.startswith(f"--{option} {text}: ")
    assert said in found.message
    assert found.mend.startswith(mend) if option == "fault" else found.mend == mend


def test_where_nothing_grasps_something_else_can_happen() -> None:
    message = "--fault miss-pick: no piece of motion of this program grasps"
    found = refused(parse, "miss-pick", PLACE)
    assert (found.message, found.mend) == (message, "write slip@a1")


def test_of_pieces_of_motion_that_do_the_same_the_name_is_asked_for() -> None:
    found = refused(parse, "slip@go-on+0.2", STEPS["WORDS"])
    assert "`go-on` may mean `a6` or `a7`, which both do that" in found.message
    assert found.mend == "write slip@a7+0.2"
    assert (
        "expected one of `grasp`, `lift`, `go-home`, `a6`, `a7`"
        in refused(parse, "slip@go-down", STEPS["WORDS"]).message
    )


ATTEMPT = SimpleNamespace(step=SimpleNamespace(formulas=()), undisturbed=True)


@pytest.mark.parametrize(
    ("why", "faults", "noticed"),
    [
        (Stopped("cam2 is lost", "camera-loss", ["cam2"]), ["camera-loss cam3", "camera-loss cam2"], [None, 2.0]),
        (Stopped("cam2 is frozen", "frozen", ["cam2"]), ["latency cam2", "frozen cam2"], [None, 2.0]),
        (
            Stopped("the process has ended", "perception-crash", ("cam1", "cam3")),
            ["perception-crash cam1", "perception-crash cam2", "perception-crash cam3"],
            [2.0, None, 2.0],
        ),
        *(
            (Stopped("a fault was seen"), [f"{kind} cam1"], [None])
            for kind in ("camera-loss", "frozen", "latency", "perception-crash")
        ),
    ],
)
def test_a_fault_of_a_camera_is_noticed_by_what_is_said_of_it_and_of_this_camera(why, faults, noticed) -> None:
    """And acted on then; the robot stops at 2 s."""
    ledger = FaultTracker(MagicMock(spec=SimulatedCell), MagicMock(spec=ImageStreams), MagicMock())
    for kind, camera in (fault.split() for fault in faults):
        ledger.inject(InjectedFault(kind, f"{kind}:{camera}@1", 1.0, camera), 1.0, ATTEMPT)
    ledger.stopped(2.0, why)
    assert all(record.acted == record.detected and record.injected == 1.0 for record in ledger.records)
    assert [(record.name, record.camera) for record in ledger.records] == [tuple(fault.split()) for fault in faults]
    assert [(record.label, record.detected) for record in ledger.records] == list(zip(faults, noticed, strict=True))


def test_a_fault_keeps_what_was_injected_beside_the_name_that_the_skill_has_for_it() -> None:
    ledger = FaultTracker(MagicMock(spec=SimulatedCell), MagicMock(spec=ImageStreams), MagicMock())
    named = SimpleNamespace(step=SimpleNamespace(formulas=(SimpleNamespace(fault="slip"),)), undisturbed=True)
    ledger.inject(InjectedFault("miss-pick", "miss-pick"), 0.05, named)
    (record,) = ledger.records
    assert (record.name, record.kind, record.label) == ("slip", "miss-pick", "miss-pick (slip)")
