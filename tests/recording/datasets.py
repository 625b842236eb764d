"""Datasets as LeRobot lays them out: in v2 a file for each episode, in v3 one with a group of rows for each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

CUT = 3
"""So many frames of each episode were cut off at its beginning."""


def frames(values: np.ndarray, number: int = 0) -> pa.Table:
    """The frames of an episode at 30 per second; values: (n, width) of its state, one more of its action."""
    lists = [pa.FixedSizeListArray.from_arrays(pa.array(one.ravel()), one.shape[1]) for one in (values, values + 1)]
    times, numbers = pa.array(np.arange(len(values)) / 30, pa.float32()), np.full(len(values), number)
    names = ["observation.state", "action", "timestamp", "episode_index", "frame_index"]
    return pa.table([*lists, times, numbers, CUT + np.arange(len(values))], names)


def packed(rows: int, width: int, value: float) -> bytes:
    pq.write_table(frames(np.full((rows, width), value, np.float32)), file := BytesIO())
    return file.getvalue()


def write_dataset(
    folder: Path, states: Sequence[np.ndarray], names: Sequence[str], version: str = "v3.0", shape: object = None
) -> None:
    """A dataset of episodes; shape: of a state as it is described, if not as it is."""
    feature = {"dtype": "float32", "shape": shape or [len(names)], "names": names}
    info = {"codebase_version": version, "fps": 30, "features": {"observation.state": feature, "action": feature}}
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(info, indent=2))
    tables = [frames(values, number) for number, values in enumerate(states)]
    if version < "v3":
        for number, table in enumerate(tables):
            pq.write_table(table, folder / f"data/chunk-000/episode_{number:06d}.parquet")
        return
    with pq.ParquetWriter(folder / "data/chunk-000/file-000.parquet", tables[0].schema) as writer:
        for table in tables:
            writer.write_table(table)
    places = {
        "episode_index": [*range(len(states))],
        **dict.fromkeys(("data/chunk_index", "data/file_index"), [0] * len(states)),
    }
    pq.write_table(pa.table(places), folder / "meta/episodes/chunk-000/file-000.parquet")
