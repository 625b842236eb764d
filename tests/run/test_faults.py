"""Faults as the command line writes them, and what a run keeps account of where cameras and their processes fail."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.faults import FaultTracker, InjectedFault, parse_fault, parse_sweep
from sqrp_cli.run.perception.streams import ImageStreams
from sqrp_cli.run.record.report import Stopped


def program_step(short_task: str, formulas: list[SimpleNamespace], *primitives: tuple) -> SimpleNamespace:
    """A step of primitives: name, action, what is held in it, start and end [s]."""
    keys = ("name", "action", "held", "start", "end")
    known = [SimpleNamespace(**dict(zip(keys, one, strict=True))) for one in primitives]
    return SimpleNamespace(primitives=known, formulas=formulas, short_task=short_task)


STEP = program_step(
    "pickup g", [SimpleNamespace(fault=None), SimpleNamespace(fault="dropped")],
    ("a1", "JointMove", None, 0.0, 0.5), ("a2", "StraightMove", None, 0.5, 1.0), ("a3", "Grasp", None, 1.0, 2.0),
    ("a4", "StraightMove", "g", 2.0, 5.0),
)  # fmt: skip
PLACE = program_step(
    "place r table", [], ("a1", "JointMove", "r", 0.0, 2.0), ("a2", "Release", "r", 2.0, 2.5),
    ("a4", "StraightMove", None, 2.5, 3.0), ("back", "JointMove", None, 3.0, 4.0),
)  # fmt: skip
CAMERAS = ("cam1", "cam2")


TAKE = "let a camera fail instead: --fault camera-loss:CAMERA@1.0"


def parse(text: str, *steps: SimpleNamespace, seed: int = 0) -> InjectedFault:
    return parse_fault(text, steps or [STEP], CAMERAS, np.random.default_rng(seed))


def refused(ask: Callable[[], object]) -> tuple[str, str]:
    """The message and the mend of an error."""
    with pytest.raises(InputError) as caught:
        ask()
    (problem,) = caught.value.problems
    return problem.message, problem.mend or ""


@pytest.mark.parametrize(
    ("text", "kind", "camera", "t", "delay"),
    [
        ("slip@a4+0.4", "slip", None, 2.4, 0.0), ("slip@a4", "slip", None, 2.0, 0.0),
        ("slip@3.5", "slip", None, 3.5, 0.0), ("slip@3500 ms", "slip", None, 3.5, 0.0),
        ("slip@1.0", "slip", None, 1.0, 0.0),  # where one primitive ends, the next one begins
        ("slip@3.5s", "slip", None, 3.5, 0.0), ("slip@a4+400ms", "slip", None, 2.4, 0.0),
        ("camera-loss:cam2@5.0", "camera-loss", "cam2", 5.0, 0.0),
        ("camera-loss:cam2@99", "camera-loss", "cam2", 99.0, 0.0),  # a run may last longer than the step
        ("perception-crash:cam2@5000 ms", "perception-crash", "cam2", 5.0, 0.0),
        ("frozen:cam1@0.05 min", "frozen", "cam1", 3.0, 0.0), ("latency:cam1=50ms", "latency", "cam1", 0.0, 0.05),
    ],
)  # fmt: skip
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


EMPTY = SimpleNamespace(primitives=STEP.primitives[:2], short_task="move")


@pytest.mark.parametrize("text", ["slip@a1", "moved@a1", "camera-loss:cam1@1"])
def test_what_holds_nothing_at_all_can_only_lose_a_camera(text: str) -> None:
    message, mend = refused(lambda: parse("slip@0.1", EMPTY))
    assert "nothing in `a1`, nor in any other" in message
    assert mend == TAKE == refused(lambda: parse_sweep(text, [EMPTY]))[1]  # a sweep leads to no other sweep


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("slpi@a4", "did you mean `slip`"), ("slip", "slip@a4+0.4"), ("slip@a9", "no primitive `a9`"),
        ("slip@a4+9", "lasts only 3.00 s"), ("slip@5.1", "the step lasts only 5.00 s; write slip@a3"),
        ("slip@6000 ms", "the step lasts only 5.00 s"),
        ("slip@3 mm", "expected a time such as `50 ms` (units s, ms, us, min), 0 or more, found `3 mm`"),
        ("slip@a4+-1", "found `-1`"), ("latency:cam1=50xs", "found `50xs`"), ("slip@a4-1", "slip@a4+0.4"),
        ("slip@a4:often", "slip@a4+0.4"), ("camera-loss:cam7@1", "no camera `cam7`"),
        ("camera-loss:cam1", "camera-loss:cam2@5.0"), ("camera-loss@cam1", "camera-loss:cam2@5.0"),
        ("frozen:cam1@soon", "frozen:cam1@3"), ("latency:cam1", "latency:cam3=0.5"),
        ("latency:cam1=-1", "latency:cam3=0.5"), ("miss-pick@2", "just `miss-pick`"), ("", "there is no fault"),
        ("nan", "there is no fault"), ("camera-loss:cam7@1", "write camera-loss:cam2@1"),
        ("dropped@a4", "`dropped` is what monitors look for, and cannot be made to happen"),
        ("latency:can2=0.5", "write latency:cam2=0.5"),
        *((text, "tool grasps or holds nothing in `a1`, expected one of `a3`, `a4`; write slip@a3")
          for text in ("slip@a1", "slip@a1+0.2", "slip@a1:random", "slip@0.3")),
    ],
)  # fmt: skip
def test_a_bad_fault_is_refused_with_what_was_expected(text: str, said: str) -> None:
    message, mend = refused(lambda: parse(text))
    kind = text.split("@")[0].split(":")[0]
    assert message.startswith(f"--fault {text}: ")
    assert said in f"{message}; {mend}"
    assert (kind and kind in mend) or "give one of: slip@a4+0.4" in mend


BRIEF = program_step("pickup g", [], ("a4", "", "g", 0.0, 1.0))


@pytest.mark.parametrize(
    ("text", "steps", "step", "t"),
    [
        ("2:slip@a4+0.5", (PLACE, STEP), 2, 2.5), ("2:slip@3.1", (PLACE, STEP), 2, 3.1),
        ("2:miss-pick", (PLACE, STEP), 2, None), ("2:camera-loss:cam1@7", (PLACE, STEP), 2, 7.0),
        ("2:latency:cam1=0.5", (PLACE, STEP), 2, 0.0), ("1:slip@a1", (PLACE, STEP), 1, 0.0),
        ("slip@1.5", (PLACE, STEP), 1, 1.5), ("camera-loss:cam1@7", (PLACE, STEP), 1, 7.0),
        ("slip@a3", (PLACE, STEP), 2, 1.0),  # only there
        ("slip@a4", (PLACE, STEP), 2, 2.0),  # the first step has it, too, and holds nothing in it
        ("slip@a1+1", (PLACE, STEP), 1, 1.0), ("miss-pick", (PLACE, STEP), 2, None),
        ("slip@a2:random", (PLACE, STEP), 1, pytest.approx(2.25, abs=0.25)),
        ("slip@a4", (STEP, STEP), 1, 2.0), ("miss-pick", (STEP, STEP), 1, None),  # of steps that are alike the first
        ("slip@a4+2", (BRIEF, STEP), 2, 4.0),  # unless it is too short
    ],
)  # fmt: skip
def test_a_fault_happens_in_the_step_that_is_told_or_the_first_in_which_it_can(text, steps, step: int, t) -> None:
    fault = parse(text, *steps)
    assert (fault.text, fault.step, fault.t) == (text, step, t)
    if (name := text.partition("@")[2]) in ("a1", "a3", "a4"):  # a sweep finds its step as a fault does
        number, primitive = parse_sweep(text, steps)
        assert (number, primitive.name) == (step, name)


@pytest.mark.parametrize(
    ("option", "text", "said", "mend"),
    [
        ("fault", "slip@bakc", "the program has no primitive `bakc`; did you mean `back`?", "write slip@a4+0.4"),
        ("fault", "slip@back", "holds nothing in `back` of step 1 (`place r table`)", "write 1:slip@a2"),
        ("fault", "2:slip@back", "step 2 (`pickup g`) has no primitive `back`; expected one of", "write 1:slip@back"),
        (
            "fault",
            "2:slip@0.3",
            "nothing in `a1` of step 2 (`pickup g`), expected one of `a3`, `a4`",
            "write 2:slip@a3",
        ),
        ("fault", "slip@4.5", "step 1 (`place r table`) lasts only 4.00 s", "write N:slip@T for T seconds"),
        ("fault", "slip@a4+9", "`a4` of step 2 (`pickup g`) lasts only 3.00 s", "write slip@a4+0.4"),
        ("fault", "1:miss-pick", "no primitive of step 1 (`place r table`) grasps", "write 2:miss-pick"),
        ("fault", "2:miss-pick@3", "expected just `miss-pick`", "write `2:` and then miss-pick"),
        (
            "fault",
            "3:miss-pick",
            "no step 3; expected one of step 1 (`place r table`), step 2 (`p",
            "write 2:miss-pick",
        ),
        ("fault", "0:slip@a1", "there is no step 0; expected one of step 1", "write 1:slip@a1"),
        ("fault", "2:slpi@a4", "there is no fault `slpi`; did you mean `slip`?", "give one of: slip@a4+0.4"),
        ("sweep", "miss-pick", "expected `slip@` and a primitive of the program", "write 1:slip@a1"),
        ("sweep", "slip@bakc", "did you mean `back`?", "write 1:slip@a1"),
        ("sweep", "2:slip@back", "a primitive of step 2 (`pickup g`); expected one of `a1`", "write 1:slip@back"),
        ("sweep", "2:slip@a1", "holds nothing in `a1` of step 2 (`pickup g`)", "write 2:slip@a3"),
        ("sweep", "9:slip@a1", "there is no step 9; ", "write 2:slip@a1"),
    ],
)
def test_messages_name_the_step_that_they_are_about(option: str, text: str, said: str, mend: str) -> None:
    message, found = refused(
        lambda: parse(text, PLACE, STEP) if option == "fault" else parse_sweep(text, [PLACE, STEP])
    )
    assert message.startswith(f"--{option} {text}: ")
    assert said in message
    assert found.startswith(mend) if option == "fault" else found == mend


def test_where_nothing_grasps_something_else_can_happen() -> None:
    message = "--fault miss-pick: no primitive of this program grasps"
    assert refused(lambda: parse("miss-pick", PLACE)) == (message, "write slip@a1")


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
