"""Free views are counted by the time that they cover, whichever cameras have them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sqrp_cli.study import blind_spans


def test_free_views_of_several_cameras_at_one_time_count_once(monkeypatch: pytest.MonkeyPatch) -> None:
    sees = {"a": [0, 1, 1, 1, 0, 0, 0, 1, 1], "b": [0, 0, 1, 1, 1, 0, 0, 0, 0], "c": [0, 1, 1, 0, 0, 0, 0, 1, 1]}
    matrix = np.array([*sees.values()], dtype=bool).T
    monkeypatch.setattr(blind_spans, "sees_all", lambda boxes: boxes)
    observation = SimpleNamespace(full_matrix=[matrix], required=np.ones((9, 1), dtype=bool))
    timeline = SimpleNamespace(
        samples=SimpleNamespace(t=np.arange(9.0)), observation=observation, monitored=np.ones(9, dtype=bool)
    )
    cell = SimpleNamespace(observer=SimpleNamespace(cameras=[SimpleNamespace(name=name) for name in sees]))
    found, all_of_them = blind_spans.free_views(cast(Any, cell), cast(Any, SimpleNamespace(timeline=timeline)), 1.0)
    assert sorted((one.start, one.end, *one.cameras) for one in found) == [
        (1.0, 2.0, "c"),
        (1.0, 3.0, "a"),
        (2.0, 4.0, "b"),
        (7.0, 8.0, "a"),
        (7.0, 8.0, "c"),
    ]
    assert all_of_them.words.startswith("2 times all that must be seen is in free view of a camera")
