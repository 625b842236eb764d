"""Every figure of `explain --json`, computed again from the document and from `show --json` alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

Document = dict[str, Any]

CELLS = ("tabletop", "harsh", "watch")
CAUSES = (
    "behind", "too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small", "hidden",
    "same_colour", "too_dark", "too_bright",
)  # fmt: skip
SIDES = ("left", "right", "top", "bottom")
FAULT_FIGURES = ("delay_mean", "delay_worst", "blind_longest", "unseen", "expected_time")
EXACT = 1e-9


@pytest.fixture(params=CELLS)
def scene(request, scenes):
    return scenes[request.param]


def union(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The union of intervals as disjoint ones; those closer than 1e-9 s are one."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(intervals):
        if merged and start - merged[-1][1] < EXACT:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged


def length(intervals: Iterable[tuple[float, float]]) -> float:
    return math.fsum(end - start for start, end in union(intervals))


def spans(document: Document, operator: str | None = None) -> list[tuple[float, float]]:
    return [(f["start"], f["end"]) for f in document["formulas"] if operator in (None, f["operator"])]


def steps(document: Document) -> Iterator[tuple[Document, Document, float]]:
    """Neighbouring samples with the time between them, without those that share their instant."""
    for before, after in pairwise(document["samples"]):
        if after["t"] > before["t"]:
            yield before, after, after["t"] - before["t"]


def required(document: Document, t: float) -> set[str]:
    return {x for f in document["formulas"] if f["start"] - EXACT <= t <= f["end"] + EXACT for x in f["literals"]}


def negated(literal: str) -> str:
    return literal.removeprefix("not ") if literal.startswith("not ") else f"not {literal}"


def test_the_parts_that_hide_a_box_add_up_to_what_is_not_visible(documents):
    for document in documents:
        for sample in document["samples"]:
            boxes = [box for literal in sample["literals"].values() for box in literal["boxes"]]
            for verdict in (v for box in boxes for v in box["cameras"].values() if v["cause"] == "hidden"):
                shares = [part["share"] for part in verdict["hidden_by"]]
                assert math.fsum(shares) == pytest.approx(1 - verdict["visible"], abs=EXACT)
                assert shares == sorted(shares, reverse=True)
                assert all(0 <= part["alone"] <= part["share"] for part in verdict["hidden_by"])


def hidden_by(sample: Document, atom: str, camera: str) -> list[Document] | None:
    """What hides the first box that a camera does not see, if that is hidden."""
    literal = sample["literals"].get(atom) or sample["literals"].get(negated(atom))
    verdicts = [box["cameras"][camera] for box in literal["boxes"]] if literal else []
    first = next((verdict for verdict in verdicts if not verdict["covered"]), {"cause": None})
    return first["hidden_by"] if first["cause"] == "hidden" else None


def test_who_is_in_the_way_is_the_mean_of_the_samples(documents):
    for document in documents:
        samples, weights = document["samples"], [0.0] * len(document["samples"])
        for number, (before, after) in enumerate(pairwise(samples)):
            weights[number] += 0.5 * (after["t"] - before["t"])
            weights[number + 1] += 0.5 * (after["t"] - before["t"])
        for entry in document["hidden"]:
            found = [hidden_by(sample, entry["literal"], entry["camera"]) for sample in samples]
            some = [(weight, parts) for weight, parts in zip(weights, found, strict=True) if parts is not None]
            seconds = math.fsum(weight for weight, _ in some)
            assert entry["seconds"] == pytest.approx(seconds, abs=EXACT)
            for part in entry["parts"]:
                for figure in ("share", "alone"):
                    told = math.fsum(
                        w * one[figure] for w, parts in some for one in parts if one["name"] == part["name"]
                    )
                    assert part[figure] == pytest.approx(told / seconds, abs=EXACT)
            assert entry["hidden"] == pytest.approx(math.fsum(part["share"] for part in entry["parts"]), abs=EXACT)
            seen = math.fsum(w * math.fsum(one["share"] for one in parts) for w, parts in some) / seconds
            assert entry["hidden"] == pytest.approx(seen, abs=EXACT)


def test_times_of_primitives_and_formulas_and_states_add_up(documents):
    for document in documents:
        # Primitives follow one another without a gap.
        primitives = document["primitives"]
        assert primitives[0]["start"] == 0.0
        assert all(first["end"] == then["start"] for first, then in pairwise(primitives))
        assert all(primitive["start"] <= primitive["end"] for primitive in primitives)
        assert document["time"] == pytest.approx(primitives[-1]["end"], abs=EXACT)
        # Formula times add up to t total and t eoi.
        assert document["t_total"] == pytest.approx(length(spans(document)), abs=EXACT)
        assert document["t_eoi"] == pytest.approx(length(spans(document, "eventually")), abs=EXACT)
        assert all(0.0 <= start <= end <= document["time"] + EXACT for start, end in spans(document))
        # Every edge of a formula or primitive is sampled.
        instants = [sample["t"] for sample in document["samples"]]
        assert instants == sorted(instants)
        edges = [edge for f in (*document["formulas"], *document["primitives"]) for edge in (f["start"], f["end"])]
        for edge in edges:
            assert min(abs(t - edge) for t in instants) < EXACT
        # Samples hold exactly the literals of the formulas that contain them.
        for before, after, _ in steps(document):
            middle = required(document, 0.5 * (before["t"] + after["t"]))
            assert set(before["literals"]) == set(after["literals"]) == middle
        # States count the samples with literals.
        assert document["states"] == sum(bool(sample["literals"]) for sample in document["samples"])
        # Instants at which literals or held object change are sampled twice.
        doubled = 0
        for before, after in pairwise(document["samples"]):
            if set(before["literals"]) != set(after["literals"]) or before["held"] != after["held"]:
                assert before["t"] == after["t"]
                doubled += 1
            if before["t"] == after["t"]:
                assert before["q"] == pytest.approx(after["q"], abs=EXACT)
        assert doubled >= 2


def test_samples_move_continuously(show, documents):
    velocity = {name: joint["velocity"] for name, joint in show["robot"]["joints"].items()}
    for document in documents:
        for before, after, dt in steps(document):
            for joint, limit in velocity.items():
                assert abs(after["q"][joint] - before["q"][joint]) <= limit * dt + EXACT


@pytest.mark.parametrize("scene", [*CELLS, "gripper"], indirect=True)
def test_verdicts_follow_from_those_of_boxes(show, documents):
    for document in documents:
        for sample in document["samples"]:
            for name, literal in sample["literals"].items():
                # Box verdicts decide cameras and cameras decide literals and literals decide states.
                target = document["targets"][name]
                assert len(literal["boxes"]) == len(target["boxes"])
                assert set(literal["cameras"]) == set(show["cameras"])
                for camera, found in literal["cameras"].items():
                    verdicts = [box["cameras"][camera] for box in literal["boxes"]]
                    failed = next((i for i, v in enumerate(verdicts) if not v["covered"]), None)
                    first = {"covered": True, "cause": None, "by": None} if failed is None else verdicts[failed]
                    expected = {key: first[key] for key in ("covered", "cause", "by")}
                    if failed is not None and len(verdicts) > 1:
                        expected["box"] = target["boxes"][failed]["name"]
                    assert found == expected
                count = sum(v["covered"] for v in literal["cameras"].values())
                assert literal["covered"] is (count >= target["k"])
                # A literal and its negation have one verdict.
                if negated(name) in sample["literals"]:
                    assert sample["literals"][negated(name)] == literal
                # Box verdicts are consistent in themselves.
                for box, seen in zip(document["targets"][name]["boxes"], literal["boxes"], strict=True):
                    detector = show["detectors"][box["detector"]]
                    assert box["min_visible"] == detector["min_visible"]
                    for verdict in seen["cameras"].values():
                        _check_verdict(verdict, box)
            literals = sample["literals"].values()
            assert sample["covered"] is (all(v["covered"] for v in literals) if literals else None)


def _check_verdict(verdict: Document, box: Document) -> None:
    if verdict["covered"]:
        assert (verdict["cause"], verdict["by"]) == (None, None)
        assert box["min_visible"] <= verdict["visible"] <= 1.0
        return
    assert verdict["cause"] in CAUSES
    if verdict["cause"] == "hidden":
        assert verdict["by"] not in (None, *box["encloses"])
        assert 0.0 <= verdict["visible"] <= 1.0
        assert verdict["visible"] < box["min_visible"] or box["min_visible"] == 1.0
    elif verdict["cause"] == "same_colour":
        assert verdict["by"] not in (None, *box["encloses"])
        assert box["min_visible"] <= verdict["visible"] <= 1.0
    elif verdict["cause"] in ("too_dark", "too_bright"):
        assert box["min_visible"] <= verdict["visible"] <= 1.0
    else:
        assert verdict["visible"] is None
        assert verdict["by"] in (SIDES if verdict["cause"] == "out_of_image" else (None,))


def test_q_is_the_length_of_the_covered_runs(documents):
    for document in documents:
        # Q avg is the length of the covered runs over t.
        covered = math.fsum(dt for before, after, dt in steps(document) if before["covered"] and after["covered"])
        assert document["q_avg"] == pytest.approx(covered / length(spans(document)), abs=EXACT)
        # Q eoi is that within the events of interest.
        events = union(spans(document, "eventually"))
        covered = math.fsum(
            dt
            for before, after, dt in steps(document)
            if before["covered"]
            and after["covered"]
            and any(start < 0.5 * (before["t"] + after["t"]) < end for start, end in events)
        )
        assert document["q_eoi"] == pytest.approx(covered / length(events), abs=EXACT)


PHASES, INSTANTS = 60, 240
"""Phases of the cameras, and instants x in each interval, of which every image is looked at."""


def _faults(documents: list[Document]) -> Iterator[tuple[Document, str]]:
    for document in documents:
        assert set(document["faults"]) == {f["fault"] for f in document["formulas"] if f["fault"]}
        assert set(document["sights"]) == set(document["faults"])
        for name, figures in document["faults"].items():
            assert {*figures} - {"why"} == {*FAULT_FIGURES}
            yield document, name


def _literals(document: Document, fault: str) -> set[str]:
    return {literal for f in document["formulas"] if f["fault"] == fault for literal in f["literals"]}


def test_images_show_a_fault_in_windows_on_the_clock_of_a_camera(documents, show):
    # Images show a fault where samples say that its literals are covered.
    for document, fault in _faults(documents):
        literals, sight = _literals(document, fault), document["sights"][fault]
        refuted = any(
            literal.startswith("not ") and len(document["targets"][literal]["boxes"]) > 1 for literal in literals
        )

        def covered(sample: Document, literals: set[str] = literals) -> bool:
            found = [sample["literals"].get(name, sample["literals"].get(negated(name))) for name in literals]
            return all(literal is not None and literal["covered"] for literal in found)

        for before, after, dt in steps(document):
            inside = [one for one in sight["onsets"] if one["x"][0] <= before["t"] and after["t"] <= one["x"][-1]]
            if not inside or dt <= 1e-9:
                continue
            middle = 0.5 * (before["t"] + after["t"])
            shown = any(window["start"] <= middle <= window["end"] for window in sight["windows"])
            both = covered(before) and covered(after)
            assert shown if both else refuted or not shown
    # Windows of a fault have the clock of a camera.
    clocks = {(1.0 / camera["rate"], camera["latency"]) for camera in show["cameras"].values()}
    for document, fault in _faults(documents):
        assert {(w["period"], w["lag"]) for w in document["sights"][fault]["windows"]} <= clocks


@dataclass(frozen=True)
class Noticed:
    """When each fault at x is noticed at each phase, shape (phases, x)."""

    x: np.ndarray
    t: np.ndarray
    seen: np.ndarray


def _noticed(sight: Document, onset: Document, key: str) -> Noticed:
    """By every image of every phase, one by one; the phases of all cameras are the same share of their periods.

    key: from when on, and in which windows, images show the fault, usually or surely.
    """
    x = onset["x"][0] + (np.arange(INSTANTS) + 0.5) / INSTANTS * (onset["x"][-1] - onset["x"][0])
    shown, rows = np.interp(x, onset["x"], onset[key]), []
    for share in (np.arange(PHASES) + 0.5) / PHASES:
        images = []
        for w in sight["windows"]:
            t = (np.arange(w["start"] // w["period"] - 1, w["end"] // w["period"] + 2) + share) * w["period"]
            images += [(one, one + w["lag"]) for one in t.tolist() if w["start"] <= one <= w["end"]]
        taken, known = np.array([*sorted(images), (np.inf, np.inf)]).T
        known = np.minimum.accumulate(known[::-1])[::-1]
        rows.append((known, np.searchsorted(taken, shown), len(images)))
    t = np.array([known[first] for known, first, _ in rows])
    return Noticed(x, t, np.array([first < count for _, first, count in rows]))


def test_delays_of_faults_follow_from_every_image_at_every_phase(documents):
    for document, fault in _faults(documents):
        sight, figures = document["sights"][fault], document["faults"][fault]
        found, surely = ([_noticed(sight, onset, key) for onset in sight["onsets"]] for key in ("usual", "shown"))
        length = [onset["x"][-1] - onset["x"][0] for onset in sight["onsets"]]

        def mean(values: list[np.ndarray], length: list[float] = length) -> float:
            return float(np.average([value.mean() for value in values], weights=length))

        edges = 2 * len(sight["windows"]) + 4
        off = edges * (1 / INSTANTS + min(1.0, 0.2 / min(length)) / PHASES) / 2
        longest = document["time"]
        assert figures["unseen"] == pytest.approx(1.0 - mean([one.seen for one in surely]), abs=off)
        seen = mean([one.seen for one in found])
        if seen < off:
            assert figures["delay_mean"] is None or seen > 0
        else:
            late = mean([np.where(one.seen, one.t - one.x, 0.0) for one in found]) / seen
            assert figures["delay_mean"] == pytest.approx(late, abs=longest * off / seen)
        if figures["unseen"] > 0:
            assert figures["delay_worst"] is figures["expected_time"] is None
        else:
            assert max(float((one.t - one.x).max()) for one in surely) <= figures["delay_worst"] + EXACT
            recovery = np.array([document["recovery"]["t"], document["recovery"]["duration"]])
            done = mean([one.t + np.interp(one.t, *recovery) for one in found]) + document["time"]
            assert figures["expected_time"] == pytest.approx(done, abs=2 * longest * off)
        gaps = [
            [one["x"][0], *(w[key] for w in sight["windows"] for key in ("start", "end")), one["x"][-1]]
            for one in sight["onsets"]
        ]
        gaps = [np.clip(edges, edges[0], edges[-1]) for edges in gaps]
        assert figures["blind_longest"] == pytest.approx(max(float((e[1::2] - e[::2]).max()) for e in gaps), abs=EXACT)


def test_recovery_takes_at_least_as_long_as_the_joints_need_to_go_back(show, documents):
    joints = show["robot"]["joints"]
    for document in documents:
        samples, recovery = document["samples"], document["recovery"]
        start = samples[0]["q"]
        standing = samples[-1]["q"] == pytest.approx(start, abs=1e-9)
        if standing:  # it stands where it began
            assert recovery["duration"][-1] == pytest.approx(0.0, abs=1e-6)
        for t, duration in zip(recovery["t"], recovery["duration"], strict=True):
            nearest = min(samples, key=lambda sample: abs(sample["t"] - t))
            apart = abs(nearest["t"] - t)
            for name, joint in joints.items():
                if name in start:
                    way = abs(nearest["q"][name] - start[name]) - joint["velocity"] * apart
                    assert duration >= way / joint["velocity"] - 1e-9


def test_the_hand_worked_cell_has_figures_and_causes_worked_out_by_hand(scenes):
    # The hand worked cell has the figures worked out by hand.
    _, documents = scenes["watch"]
    by_name = {document["parameters"]["object"]: document for document in documents}
    blind = {"delay_mean": None, "delay_worst": None, "blind_longest": 1.0, "unseen": 1.0, "expected_time": None}
    seen = {"delay_mean": 0.1, "delay_worst": 0.15, "blind_longest": 0.0, "unseen": 0.0, "expected_time": 6.6}
    for name, document in by_name.items():
        assert document["time"] == pytest.approx(4.0, abs=EXACT)
        assert document["t_total"] == pytest.approx(2.5, abs=EXACT)
        assert document["t_eoi"] == pytest.approx(1.0, abs=EXACT)
        q_avg, q_eoi, figures = {"seen": (1.0, 1.0, seen), "turned": (0.6, 1.0, seen)}.get(name, (0.0, 0.0, blind))
        assert document["q_avg"] == pytest.approx(q_avg, abs=EXACT)
        assert document["q_eoi"] == pytest.approx(q_eoi, abs=EXACT)
        assert set(document["faults"]) == {"moved"}
        for key, value in figures.items():
            assert document["faults"]["moved"][key] == (value if value is None else pytest.approx(value, abs=EXACT))
    # Every cause is named where it was staged.
    staged = {
        "seen": (None, None), "near": ("too_near", None), "far": ("too_far", None), "left": ("out_of_image", "left"),
        "right": ("out_of_image", "right"), "high": ("out_of_image", "top"), "low": ("out_of_image", "bottom"),
        "close": ("detector_near", None), "distant": ("detector_far", None), "tiny": ("too_small", None),
        "behind": ("hidden", "wall"), "turned": (None, None),
    }  # fmt: skip
    found = {}
    for document in documents:
        name = document["parameters"]["object"]
        verdicts = [s["literals"][f"in_place({name})"]["cameras"]["eye"] for s in document["samples"][:2]]
        found[name] = {(verdict["cause"], verdict["by"]) for verdict in verdicts}
        faces = next(s["literals"][f"faces({name})"] for s in document["samples"] if f"faces({name})" in s["literals"])
        if name in ("seen", "turned"):
            expected = (None, None) if name == "seen" else ("oblique", None)
            assert (faces["cameras"]["eye"]["cause"], faces["cameras"]["eye"]["by"]) == expected
    assert found == {name: {verdict} for name, verdict in staged.items()}


def test_all_candidates_are_explained_as_rank_orders_and_judges_them(ranked, explained):
    # All gives every candidate in ranking order infeasible ones without samples.
    document = explained.document
    assert {"schema", "workspace", "task", "candidates"} <= set(document)
    assert document["schema"] == 1
    order = [candidate["parameters"] for candidate in ranked.document["candidates"]]
    assert [candidate["parameters"] for candidate in document["candidates"]] == order
    infeasible = [candidate for candidate in document["candidates"] if not candidate["feasible"]]
    assert infeasible
    for candidate in infeasible:
        assert candidate["reasons"]
        assert (candidate["samples"], candidate["primitives"], candidate["q_avg"]) == ([], [], None)
    # Rank and explain agree on a candidate to the tolerance of adaptive sampling.
    for candidate, detailed in zip(ranked.document["candidates"], explained.document["candidates"], strict=True):
        for field in ("parameters", "feasible", "rank", "reasons", "time", "t_total", "t_eoi", "pareto"):
            assert candidate[field] == detailed[field]
        for field in ("q_avg", "q_eoi"):
            assert candidate[field] == pytest.approx(detailed[field], abs=1e-3)


FASTEST = ("pickup green", "--json", "--ways", "fastest")


def test_the_chosen_candidate_is_explained_by_default_the_first(sqrp, asked, tabletop):
    # Without a choice the first ranked is explained.
    document = sqrp("explain", tabletop, *FASTEST).document
    shared = {"schema", "document", "workspace", "task"}
    first = asked("explain", tabletop, *FASTEST, "--all").document["candidates"][0]
    assert {name: value for name, value in document.items() if name not in shared} == first
    # A chosen candidate is explained.
    explained = asked("explain", tabletop, *FASTEST, "--all").document["candidates"]
    last = [c for c in explained if c["feasible"]][-1]
    document = sqrp("explain", tabletop, *FASTEST, "--choose", last["parameters"]["object"]).document
    assert {name: document[name] for name in last} == last
