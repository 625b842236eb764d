"""Every figure of `explain --json`, computed again from the document and from `show --json` alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest

Document = dict[str, Any]

CELLS = ("tabletop", "harsh", "watch")
CAUSES = ("too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small", "hidden")
SIDES = ("left", "right", "top", "bottom")
FAULT_FIGURES = ("delay_mean", "delay_worst", "blind_longest", "unseen", "expected_time")
CANDIDATE_FIELDS = {
    "parameters", "feasible", "rank", "reasons", "time", "q_avg", "q_eoi", "t_total", "t_eoi", "faults", "states",
    "pareto", "verdict",
}  # fmt: skip
EXACT = 1e-9


@pytest.fixture(params=CELLS)
def scene(request, scenes):
    return scenes[request.param]


VERDICT_FIELDS = {"covered", "cause", "by", "box"}
"""Of a camera's verdict on a literal; `box` where a target has several."""


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


def test_feasible_candidates_have_every_field_of_the_contract(scene):
    _, documents = scene
    for document in documents:
        assert set(document) >= CANDIDATE_FIELDS
        assert {"primitives", "formulas", "targets", "samples"} <= set(document)
        assert document["feasible"] is True
        assert document["reasons"] == []
        for primitive in document["primitives"]:
            assert set(primitive) == {"name", "start", "end"}
        for formula in document["formulas"]:
            assert set(formula) == {"text", "operator", "start", "end", "literals", "fault"}
            assert formula["operator"] in ("always", "eventually")
            assert formula["fault"] is None or formula["fault"] in document["faults"]
        for target in document["targets"].values():
            assert set(target) == {"k", "boxes"}
            for box in target["boxes"]:
                assert set(box) == {
                    "name", "detector", "normal", "encloses", "min_visible", "frame", "size", "pose",
                }  # fmt: skip
        for sample in document["samples"]:
            assert set(sample) == {"t", "q", "objects", "held", "covered", "literals"}
            for literal in sample["literals"].values():
                assert set(literal) == {"covered", "boxes", "cameras"}
                for box in literal["boxes"]:
                    assert set(box) == {"corners", "cameras"}
                    assert all(set(v) == {"covered", "cause", "by", "visible"} for v in box["cameras"].values())
                assert all({"covered", "cause", "by"} <= set(v) <= VERDICT_FIELDS for v in literal["cameras"].values())


def test_primitives_follow_one_another_without_a_gap(scene):
    _, documents = scene
    for document in documents:
        primitives = document["primitives"]
        assert primitives[0]["start"] == 0.0
        assert all(first["end"] == then["start"] for first, then in pairwise(primitives))
        assert all(primitive["start"] <= primitive["end"] for primitive in primitives)
        assert document["time"] == pytest.approx(primitives[-1]["end"], abs=EXACT)


def test_formula_times_add_up_to_t_total_and_t_eoi(scene):
    _, documents = scene
    for document in documents:
        assert document["t_total"] == pytest.approx(length(spans(document)), abs=EXACT)
        assert document["t_eoi"] == pytest.approx(length(spans(document, "eventually")), abs=EXACT)
        assert all(0.0 <= start <= end <= document["time"] + EXACT for start, end in spans(document))


def test_samples_hold_exactly_the_literals_of_the_formulas_that_contain_them(scene):
    _, documents = scene
    for document in documents:
        for before, after, _ in steps(document):
            middle = required(document, 0.5 * (before["t"] + after["t"]))
            assert set(before["literals"]) == set(after["literals"]) == middle


def test_every_edge_of_a_formula_or_primitive_is_sampled(scene):
    _, documents = scene
    for document in documents:
        instants = [sample["t"] for sample in document["samples"]]
        assert instants == sorted(instants)
        edges = [edge for f in (*document["formulas"], *document["primitives"]) for edge in (f["start"], f["end"])]
        for edge in edges:
            assert min(abs(t - edge) for t in instants) < EXACT


def test_instants_at_which_literals_or_held_object_change_are_sampled_twice(scene):
    _, documents = scene
    for document in documents:
        doubled = 0
        for before, after in pairwise(document["samples"]):
            if set(before["literals"]) != set(after["literals"]) or before["held"] != after["held"]:
                assert before["t"] == after["t"]
                doubled += 1
            if before["t"] == after["t"]:
                assert before["q"] == pytest.approx(after["q"], abs=EXACT)
        assert doubled >= 2


def test_samples_move_continuously(scene):
    show, documents = scene
    velocity = {name: joint["velocity"] for name, joint in show["robot"]["joints"].items()}
    for document in documents:
        for before, after, dt in steps(document):
            for joint, limit in velocity.items():
                assert abs(after["q"][joint] - before["q"][joint]) <= limit * dt + EXACT


def test_box_verdicts_decide_cameras_and_cameras_decide_literals_and_literals_decide_states(scene):
    show, documents = scene
    for document in documents:
        for sample in document["samples"]:
            for name, literal in sample["literals"].items():
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
            literals = sample["literals"].values()
            assert sample["covered"] is (all(v["covered"] for v in literals) if literals else None)


def test_a_literal_and_its_negation_have_one_verdict(scene):
    _, documents = scene
    for document in documents:
        for sample in document["samples"]:
            for name, literal in sample["literals"].items():
                if negated(name) in sample["literals"]:
                    assert sample["literals"][negated(name)] == literal


def test_box_verdicts_are_consistent_in_themselves(scene):
    show, documents = scene
    for document in documents:
        for sample in document["samples"]:
            for name, literal in sample["literals"].items():
                for box, seen in zip(document["targets"][name]["boxes"], literal["boxes"], strict=True):
                    detector = show["detectors"][box["detector"]]
                    assert box["min_visible"] == detector["min_visible"]
                    for verdict in seen["cameras"].values():
                        _check_verdict(verdict, box)


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
    else:
        assert verdict["visible"] is None
        assert verdict["by"] in (SIDES if verdict["cause"] == "out_of_image" else (None,))


def test_states_count_the_samples_with_literals(scene):
    _, documents = scene
    for document in documents:
        assert document["states"] == sum(bool(sample["literals"]) for sample in document["samples"])


def test_q_avg_is_the_length_of_the_covered_runs_over_t(scene):
    _, documents = scene
    for document in documents:
        covered = math.fsum(dt for before, after, dt in steps(document) if before["covered"] and after["covered"])
        assert document["q_avg"] == pytest.approx(covered / length(spans(document)), abs=EXACT)


def test_q_eoi_is_that_within_the_events_of_interest(scene):
    _, documents = scene
    for document in documents:
        events = union(spans(document, "eventually"))
        covered = math.fsum(
            dt
            for before, after, dt in steps(document)
            if before["covered"]
            and after["covered"]
            and any(start < 0.5 * (before["t"] + after["t"]) < end for start, end in events)
        )
        assert document["q_eoi"] == pytest.approx(covered / length(events), abs=EXACT)


@dataclass(frozen=True)
class Delay:
    """The delay on the open range (start, end) of x: `first` at its start, `last` at its end, linear in between."""

    start: float
    end: float
    first: float
    last: float
    seen: bool
    ever: bool

    @property
    def duration(self) -> float:
        return self.end - self.start


class Fault:
    """delay(x) of one fault, from the samples of its literals and the cameras that see them."""

    def __init__(self, show: Document, document: Document, name: str) -> None:
        entries = [f for f in document["formulas"] if f["fault"] == name and f["literals"]]
        self.start, self.end = min(f["start"] for f in entries), max(f["end"] for f in entries)
        self.total = document["time"]
        self._literals = {literal for f in entries for literal in f["literals"]}
        self._targets = document["targets"]
        self._response = {c: 1.0 / camera["rate"] + camera["latency"] for c, camera in show["cameras"].items()}
        self._samples = [(sample["t"], self._noticed_after(sample)) for sample in document["samples"]]

    def _noticed_after(self, sample: Document) -> float | None:
        """Frame period and latency of the camera that decides; None where a literal is not covered.

        Of k cameras the last decides, and of several literals the last. A literal and its negation have one verdict.
        """
        slowest = 0.0
        for name in self._literals:
            literal = sample["literals"].get(name, sample["literals"].get(negated(name)))
            if literal is None or not literal["covered"]:
                return None
            responses = sorted(self._response[c] for c, v in literal["cameras"].items() if v["covered"])
            slowest = max(slowest, responses[self._targets[name]["k"] - 1])
        return slowest

    def delays(self) -> Iterator[Delay]:
        """The delay over the whole interval, in ranges that end at samples."""
        for (before, first), (after, then) in pairwise(self._samples):
            start, end = max(before, self.start), min(after, self.end)
            if start >= end:
                continue
            if first is not None and then is not None:
                slower = max(first, then)
                yield Delay(start, end, slower, slower, seen=True, ever=True)
            else:
                later = [(t, delay) for t, delay in self._samples if t >= after and delay is not None]
                noticed = sum(min(later)) if later else self.total
                yield Delay(start, end, noticed - start, noticed - end, seen=False, ever=bool(later))

    def blind_stretches(self) -> Iterator[float]:
        """Lengths of the stretches without sight; an instant of sight ends one."""
        glimpses = {t for t, delay in self._samples if delay is not None}
        running = 0.0
        for part in self.delays():
            if part.seen or part.start in glimpses:
                yield running
                running = 0.0
            if not part.seen:
                running += part.duration
        yield running


def _faults(scene) -> Iterator[tuple[Document, Document, Fault]]:
    show, documents = scene
    for document in documents:
        assert set(document["faults"]) == {f["fault"] for f in document["formulas"] if f["fault"]}
        for name, figures in document["faults"].items():
            assert set(figures) == set(FAULT_FIGURES)
            yield document, figures, Fault(show, document, name)


def test_delays_of_faults_follow_from_the_samples(scene):
    for _, figures, fault in _faults(scene):
        parts = list(fault.delays())
        interval = fault.end - fault.start
        assert math.fsum(p.duration for p in parts) == pytest.approx(interval, abs=EXACT)
        mean = math.fsum(p.duration * 0.5 * (p.first + p.last) for p in parts) / interval
        assert figures["delay_mean"] == pytest.approx(mean, abs=EXACT)
        assert figures["delay_worst"] == pytest.approx(max(max(p.first, p.last) for p in parts), abs=EXACT)
        unseen = math.fsum(p.duration for p in parts if not p.ever) / interval
        assert figures["unseen"] == pytest.approx(unseen, abs=EXACT)
        assert figures["blind_longest"] == pytest.approx(max(fault.blind_stretches()), abs=EXACT)


def _at(points: list[tuple[float, float]], t: float) -> float:
    """A function that is linear between points, and constant beyond them."""
    if t <= points[0][0]:
        return points[0][1]
    for (a, first), (b, last) in pairwise(points):
        if t <= b:
            return first + (last - first) * (t - a) / (b - a) if b > a else last
    return points[-1][1]


def test_expected_time_is_the_mean_time_until_a_retry_is_done(scene):
    for document, figures, fault in _faults(scene):
        recovery = list(zip(document["recovery"]["t"], document["recovery"]["duration"], strict=True))
        done = []
        for part in fault.delays():
            cuts = [part.start, part.end]
            if part.seen:
                cuts += [t - part.first for t, _ in recovery if part.start < t - part.first < part.end]
            for a, b in pairwise(sorted(cuts)):
                middle = 0.5 * (a + b)
                noticed = middle + part.first - (0.0 if part.seen else middle - part.start)
                done.append((b - a) * (noticed + _at(recovery, noticed) + fault.total))
        mean = math.fsum(done) / (fault.end - fault.start)
        assert figures["expected_time"] == pytest.approx(mean, abs=EXACT)


def test_recovery_takes_at_least_as_long_as_the_joints_need_to_go_back(scene):
    show, documents = scene
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


def test_the_hand_worked_cell_has_the_figures_worked_out_by_hand(scenes):
    _, documents = scenes["watch"]
    by_name = {document["parameters"]["object"]: document for document in documents}
    blind = {"delay_mean": 1.5, "delay_worst": 2.0, "blind_longest": 1.0, "unseen": 1.0, "expected_time": 8.0}
    seen = {"delay_mean": 0.15, "delay_worst": 0.15, "blind_longest": 0.0, "unseen": 0.0, "expected_time": 6.65}
    for name, document in by_name.items():
        assert document["time"] == pytest.approx(4.0, abs=EXACT)
        assert document["t_total"] == pytest.approx(2.5, abs=EXACT)
        assert document["t_eoi"] == pytest.approx(1.0, abs=EXACT)
        q_avg, q_eoi, figures = {"seen": (1.0, 1.0, seen), "turned": (0.6, 1.0, seen)}.get(name, (0.0, 0.0, blind))
        assert document["q_avg"] == pytest.approx(q_avg, abs=EXACT)
        assert document["q_eoi"] == pytest.approx(q_eoi, abs=EXACT)
        assert document["faults"] == {"moved": pytest.approx(figures, abs=EXACT)}


def test_a_fault_of_two_intervals_is_averaged_over_both_and_not_over_the_time_between(sqrp, own_watch):
    skill = own_watch / "watch" / "skill.yaml"
    twice = "eventually[w1.start, w1.end] (not in_place) and eventually[w3.end - 0.05, w3.end] (not in_place)"
    text = skill.read_text(encoding="utf-8")
    skill.write_text(text.replace("eventually[w2.start + 1, w2.end] (not in_place)", twice), encoding="utf-8")
    document = sqrp("explain", own_watch, "watch seen", "--json").document
    # Always seen while it may happen, in [0, 1] and [3.95, 4] s, and noticed 0.15 s later; the arm stands still.
    middle = (1.0 * 0.5 + 0.05 * 3.975) / 1.05
    expected = {
        "delay_mean": 0.15, "delay_worst": 0.15, "blind_longest": 0.0, "unseen": 0.0,
        "expected_time": middle + 0.15 + 4.0,
    }  # fmt: skip
    assert document["faults"] == {"moved": pytest.approx(expected, abs=EXACT)}


def test_every_cause_is_named_where_it_was_staged(scenes):
    _, documents = scenes["watch"]
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


def test_fixed_sampling_takes_its_instants_where_the_contract_says(sqrp, watch):
    counted = sqrp("explain", watch, "watch seen", "--json", "--samples", 3).document
    stepped = sqrp("explain", watch, "watch seen", "--json", "--dt", 0.3).document
    edges = {0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0}
    by_count = {0.0, 0.5, 1.0, 2.0, 3.0, 3.5, 4.0}
    by_step = {0.0, 0.3, 0.6, 0.9, 1.3, 1.6, 1.9, 2.2, 2.5, 2.8, 3.3, 3.6, 3.9}
    for document, instants in ((counted, by_count), (stepped, by_step)):
        found = sorted({sample["t"] for sample in document["samples"]})
        assert found == pytest.approx(sorted(edges | instants), abs=EXACT)
        assert (document["q_avg"], document["q_eoi"]) == pytest.approx((1.0, 1.0), abs=EXACT)


def test_all_gives_every_candidate_in_ranking_order_infeasible_ones_without_samples(ranked, explained):
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


def test_without_a_choice_the_first_ranked_is_explained(sqrp, tabletop, explained):
    document = sqrp("explain", tabletop, "pickup green", "--json").document
    shared = {"schema", "workspace", "task"}
    first = explained.document["candidates"][0]
    assert {name: value for name, value in document.items() if name not in shared} == first


def test_a_chosen_candidate_is_explained(sqrp, tabletop, explained):
    last = [c for c in explained.document["candidates"] if c["feasible"]][-1]
    document = sqrp("explain", tabletop, "pickup green", "--json", "--choose", last["parameters"]["object"]).document
    assert {name: document[name] for name in last} == last


def test_rank_and_explain_agree_on_a_candidate(sqrp, harsh, harsh_explained):
    ranking = sqrp("rank", harsh, "pickup green", "--json", "--samples", 25).document
    for ranked, explained in zip(ranking["candidates"], harsh_explained.document["candidates"], strict=True):
        for field in CANDIDATE_FIELDS - {"verdict"}:
            assert ranked[field] == explained[field]


def test_rank_and_explain_agree_on_a_candidate_to_the_tolerance_of_adaptive_sampling(ranked, explained):
    for candidate, detailed in zip(ranked.document["candidates"], explained.document["candidates"], strict=True):
        for field in ("parameters", "feasible", "rank", "reasons", "time", "t_total", "t_eoi", "pareto"):
            assert candidate[field] == detailed[field]
        for field in ("q_avg", "q_eoi"):
            assert candidate[field] == pytest.approx(detailed[field], abs=1e-3)
