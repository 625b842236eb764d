"""Variants of one workspace, on a grid or drawn at random: scored and compared, for example to place a camera."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError, bad_option
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import from_here, patch, with_values
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.platform.processes import Progress
from sqrp_cli.records import dataclass
from sqrp_cli.score.compute import Computer
from sqrp_cli.score.result import Scorecard, ScoredVariant, Sweep
from sqrp_cli.score.score import ScoredCell, read_cell, score_cells

MAX_VARIANTS = 10_000  # most variants of a sweep
_END = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D*?)\s*")
_QUALITY_STEP, _DELAY_STEP = 1e-3, 0.01
"""Qualities are compared rounded as in a ranking, and delays [s] as they are shown: sampling may cause finer ones."""
Values = tuple[tuple[str, str], ...]  # the values of a variant, as YAML text, by dotted path


@dataclass(frozen=True)
class Variation:
    """A value of a workspace file and where it goes: from `start` to `end`.

    path: dotted, such as `cameras.cam1.pose.position.0`. unit: of both ends; empty for SI units. count: steps of a
    grid; None where values are drawn.
    """

    path: str
    start: float
    end: float
    unit: str
    count: int | None


def read_variation(text: str) -> Variation:
    """`PATH=FROM:TO:N`, or `PATH=FROM:TO` where values are drawn; `position[0]` is the same as `position.0`.

    Raises InputError for anything else.
    """
    path, equals, ends = text.partition("=")
    start, *others = ends.split(":")
    matches = [_END.fullmatch(end) for end in (start, *others[:1])]
    count = others[1] if len(others) == 2 else None
    good = equals and path.strip() and len(others) in (1, 2) and (count is None or count.strip().isdecimal())
    if not good or len(matches) != 2 or None in matches:
        message = f"--vary is `{text}`, expected PATH=FROM:TO:N, such as `cameras.cam1.pose.position[0]=0.8:1.2:9`"
        raise bad_option(message)
    (low, unit), (high, other_unit) = (match.groups() for match in matches if match is not None)
    if not math.isfinite(float(high) - float(low)):
        raise bad_option(f"--vary is `{text}`: expected ends that are not so far apart")
    if unit != other_unit:
        raise bad_option(f"--vary is `{text}`: expected the same unit at both ends, such as `80 cm:120 cm:9`")
    if count is not None and int(count) < 1:
        raise bad_option(f"--vary is `{text}`: expected at least one value")
    dotted = re.sub(r"\[(\d+)\]", r".\1", path.strip())
    return Variation(dotted, float(low), float(high), unit, None if count is None else int(count))


def variants(variations: Sequence[Variation], draws: int | None, seed: int) -> tuple[Values, ...]:
    """The values of every variant: all combinations, or random draws, uniform between the ends.

    Raises InputError for a path that is varied twice, a grid without numbers of steps, or too many variants.
    """
    paths = [variation.path for variation in variations]
    twice = [path for path in paths if paths.count(path) > 1]
    if twice:
        raise bad_option(f"`{twice[0]}` is varied twice")
    points: Iterable[Sequence[float]]
    if draws is not None:
        rng = np.random.default_rng(seed)
        points = [[float(rng.uniform(v.start, v.end)) for v in variations] for _ in range(draws)]
    else:
        open_ended = [variation.path for variation in variations if variation.count is None]
        if open_ended:
            message = f"`{open_ended[0]}` has no number of steps"
            raise bad_option(message, mend="write FROM:TO:N, or give a number of random --draws")
        counts = [variation.count or 1 for variation in variations]
        total = int(np.prod(counts, dtype=object))
        if total > MAX_VARIANTS:
            raise bad_option(f"{total:,} variants are requested, the limit is {MAX_VARIANTS:,}")
        grids = [np.linspace(v.start, v.end, count).tolist() for v, count in zip(variations, counts, strict=True)]
        points = product(*grids)
    found = []
    for point in points:
        pairs = []
        for one, value in zip(variations, point, strict=True):
            exact = 0.0 if abs(value) <= 1e-9 * max(abs(one.start), abs(one.end)) else value  # beside the ends
            pairs.append((one.path, f"{exact:.6g}{f' {one.unit}' if one.unit else ''}"))
        found.append(tuple(pairs))
    return tuple(found)


Variant = tuple[Values, bytes, ScoredCell]
"""A workspace with other values, none for the workspace as it is; the content of its file, and what that says."""


def read_variants(
    file: Path, values: Sequence[Values], advance: Callable[[], None]
) -> tuple[SourceDocument, list[Variant]]:
    """A workspace file, as it is and with each of these values; `advance` is called after each.

    Raises InputError if a value is not in the file, or the workspace as it is cannot be used.
    """
    document = read_workspace_document(file)
    found = []
    for chosen in ((), *values):
        content = with_values(document, dict(chosen)) if chosen else document.content
        name = ", ".join(f"{path}={value}" for path, value in chosen) or "as it is"
        cell = read_cell(file, name, content)
        if cell.workspace is None and not chosen:
            raise InputError(*cell.problems)
        found.append((chosen, content, cell))
        advance()
    return document, found


def sweep(
    document: SourceDocument,
    variants: Sequence[Variant],
    shape: tuple[int, ...] | None,
    computer: Computer,
    progress: Progress,
) -> Sweep:
    """Score a workspace and its variants; shape: of their grid, in row-major order; None if they are drawn.

    Raises InputError where results cannot be kept.
    """
    findings = score_cells([cell for *_, cell in variants], computer, progress)
    name, file = variants[0][2].name, from_here(document.path)
    if findings.interrupted:
        return Sweep(workspace=name, file=file, variants=(), interrupted=True)
    results = iter(findings.results)
    scored = []
    for values, _, cell in variants:
        own = tuple(next(results) for _ in range(max(1, len(cell.tasks))))
        scored.append(_scored(values, replace(findings, results=own)))
    # Better variants come first: no errors, tasks that pass, choices that can be done, then as in a ranking.
    orders = []
    for one in scored:
        qualities = [-round((quality or 0.0) / _QUALITY_STEP) for quality in (one.q_eoi, one.q_avg)]
        time, delay = (math.inf if figure is None else figure for figure in (one.time, one.delay))
        late = delay if delay == math.inf else round(delay / _DELAY_STEP)
        done = one.findings.count("error"), -one.findings.count("passed"), -one.feasible
        orders.append((*done, *qualities, time, late))
    equal = [order == min(orders) for order in orders]
    first = 0
    if not equal[0]:
        marked = np.array(equal[1:])
        if shape is not None:
            first = 1 + middle_of_grid(marked.reshape(shape))
        else:
            numbers = np.array([[float(text.split()[0]) for _, text in chosen] for chosen, *_ in variants[1:]])
            low, high = numbers.min(axis=0), numbers.max(axis=0)
            first = 1 + middle_of_draws(marked, (numbers - low) / np.where(high > low, high - low, 1.0))
    best = scored[first]
    ranked = sorted(range(len(scored)), key=lambda index: (orders[index], index != first))
    return Sweep(
        workspace=name,
        file=file,
        variants=tuple(
            replace(
                scored[index], rank=rank, results=tuple(replace(one, workspace=name) for one in scored[index].results)
            )
            for rank, index in enumerate(ranked, 1)
        ),
        best=best.values,
        equals=sum(equal),
        passed=best.findings.passed,
        best_patch=patch(document, variants[first][1], file),
    )


def _scored(values: Values, findings: Scorecard) -> ScoredVariant:
    scored = () if findings.count("error") else findings.results
    ways = [way for result in scored for way in result.ways.values()]
    feasible = [way for way in ways if way.feasible]

    def mean(name: str) -> float | None:
        known = [figure for way in feasible if (figure := getattr(way, name)) is not None]
        return float(np.mean(known)) if known else None

    return ScoredVariant(
        values=dict(values),
        results=findings.results,
        choices=len(ways),
        feasible=len(feasible),
        q_eoi=mean("q_eoi"),
        q_avg=mean("q_avg"),
        time=mean("time"),
        delay=None if any(way.unseen for way in feasible) else mean("delay_worst"),
        unseen=mean("unseen"),
        findings=findings,
    )


def middle_of_grid(equal: Mask) -> int:
    """The index, in row-major order, of the middle of the largest block of equals on a grid, shape one axis per value.

    A block is connected by steps of one in one value. Its middle is the point with most margin: the number of steps by
    which all values may be off at once, either way, without leaving the block. Beyond the ends of the grid nothing is
    known, so these count as outside. Ties go to the point nearest the mean of the block, then to the first.
    """
    largest: list[tuple[int, ...]] = []
    left = set(map(tuple, np.argwhere(equal).tolist()))
    for start in map(tuple, np.argwhere(equal).tolist()):
        found = [start] if start in left else []
        left.discard(start)
        for point in found:  # grows on the way
            for axis, step in np.ndindex(len(point), 2):
                neighbour = (*point[:axis], point[axis] + 2 * step - 1, *point[axis + 1 :])
                if neighbour in left:
                    left.remove(neighbour)
                    found.append(neighbour)
        largest = max(largest, found, key=len)  # the first of equals
    block = np.zeros_like(equal)
    block[tuple(np.array(largest).T)] = True
    wide = np.pad(block, [(1, 1) if count > 1 else (0, 0) for count in equal.shape])  # not where nothing is varied
    outside, points = np.argwhere(~wide), np.argwhere(wide)
    margin = np.array([np.abs(outside - point).max(axis=1).min(initial=equal.size) for point in points])
    points = np.argwhere(block)  # in the same order
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1).round(9)
    distances[margin < margin.max()] = np.inf
    return int(np.ravel_multi_index(tuple(points[np.argmin(distances)]), equal.shape))


def middle_of_draws(equal: Mask, points: Array) -> int:
    """The index of the equal that is farthest from its nearest worse draw; the first on ties.

    equal: shape (n,). points: of all draws, as shares of the range of each value, shape (n, values). If all draws are
    equal, it is the one nearest the middle of the ranges.
    """
    others = points[~equal] if not equal.all() else np.full((1, points.shape[1]), 0.5)
    nearest = np.array([np.linalg.norm(others - point, axis=1).min() for point in points])
    worth = nearest if not equal.all() else -nearest
    return int(np.argmax(np.where(equal, worth, -np.inf)))
