"""What cameras saw before changes no answer, and what they need not be asked again they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.camera.light import Light
from sqrp_cli.sight import sight_memory
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.sight_memory import SightMemory
from tests.sight.test_laws import SEEDS, Watch, few, random_watch
from tests.sight.views import random_pose


def moved(watch: Watch, rng: np.random.Generator) -> Observer:
    """The observer with one camera elsewhere, or with another lens or gain."""
    cameras = list(watch.cameras)
    index = int(rng.integers(len(cameras)))
    way = rng.random()
    if way < 0.3:
        cameras[index] = replace(cameras[index], gain=float(rng.uniform(0.2, 3.0)))
    elif way < 0.7:
        cameras[index] = replace(cameras[index], X_FC=cameras[index].X_FC @ random_pose(rng, (-0.1,) * 3, (0.1,) * 3))
    else:
        cameras[index] = replace(cameras[index], matrix=cameras[index].matrix * [[0.7], [0.7], [1.0]])
    return replace(lit(watch), cameras=tuple(cameras))


LIGHTS = {"sky": Light(intensity=0.2), "lamp": Light(intensity=0.7, direction=(0.2, 0.3, -1.0))}


def lit(watch: Watch) -> Observer:
    return replace(watch.observer, lights=LIGHTS)


def answers(observer: Observer, watch: Watch, rows: np.ndarray) -> tuple[list[bool], list[float]]:
    (found,) = observer.coverage([watch.target], watch.states, [rows])
    return (~np.isnan(found)).tolist(), np.nan_to_num(found, nan=-1.0).tolist()


@few
@given(SEEDS, SEEDS, st.integers(0, 1000))
def test_one_memory_of_many_cameras_and_targets_gives_the_answers_of_none(seed, other, turns):
    rng, memory = np.random.default_rng(turns), SightMemory()
    for watch in [random_watch(seed), random_watch(other)] * 3:
        observer = moved(watch, rng) if rng.random() < 0.7 else lit(watch)
        rows = np.sort(rng.choice(watch.states.count, int(rng.integers(1, watch.states.count + 1)), replace=False))
        assert answers(replace(observer, memory=memory), watch, rows) == answers(observer, watch, rows)


@few
@given(SEEDS)
def test_what_was_learnt_elsewhere_need_not_be_asked_again(seed):
    watch, first, second = random_watch(seed), SightMemory(), SightMemory()
    rows = np.arange(watch.states.count)
    expected = answers(replace(watch.observer, memory=first), watch, rows)
    for seen in first.learnt:
        second.take(seen)
    assert answers(replace(watch.observer, memory=second), watch, rows) == expected
    assert second.learnt == []


@pytest.mark.parametrize(("questions", "cameras"), [(7, 64), (10_000, 2)])
def test_a_full_memory_forgets_and_gives_the_same_answers(monkeypatch, questions, cameras):
    monkeypatch.setattr(sight_memory, "MOST_QUESTIONS", questions)
    monkeypatch.setattr(sight_memory, "MOST_CAMERAS", cameras)
    rng, memory = np.random.default_rng(0), SightMemory()
    for seed in range(20):
        watch = random_watch(seed)
        observer, rows = moved(watch, rng), np.arange(watch.states.count)
        assert answers(replace(observer, memory=memory), watch, rows) == answers(observer, watch, rows)
        assert len(memory._numbers) <= questions
        assert len(memory._answers) <= cameras
