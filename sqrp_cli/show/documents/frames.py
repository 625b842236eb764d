"""Frames of recorded episodes as a table to train with: what each camera sees of each target, and why not."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.errors import Infeasible, bad_option, needed
from sqrp_cli.motion.recorded_motion import RecordedMotions
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.study.analysis import planned_motion
from sqrp_cli.task.feasibility import feasible_motion

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import World
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.task.candidate import Candidate


def check_parquet() -> None:
    """Raises InputError if the library that writes Parquet is missing."""
    with needed("Parquet files need pyarrow ({})", "pip install 'sqrp[recordings]'"):
        import pyarrow.parquet  # noqa: F401 - only whether it is there


def write_frames(cell: Cell, world: World, candidates: Iterable[Candidate], path: Path) -> int:
    """Write a row for each frame, camera and target of recorded episodes to a Parquet file; how many they are.

    Columns: episode and frame by their own numbers, t [s], phase, target, camera, required (whether it must be seen
    then), visible (share of the silhouette of its first box that is not seen whole, null where an earlier limit fails),
    cause and by (null where it is seen). An episode at a time is in memory; those that cannot be judged are left out.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    whole, text, number = pa.int64(), pa.string(), pa.float64()
    kinds = {"episode": whole, "frame": whole, "t": number, "phase": text, "target": text, "camera": text}
    schema = pa.schema({**kinds, "required": pa.bool_(), "visible": number, "cause": text, "by": text})
    count, names = 0, [camera.name for camera in cell.observer.cameras]
    with pq.ParquetWriter(path, schema) as writer:
        for candidate in candidates:
            if not isinstance(recorded := candidate.skill.recorded, RecordedMotions):
                raise bad_option(f"`{candidate.task}` is no recording, so it has no frames")
            motion, own = feasible_motion(cell, candidate, world), int(candidate.values["episode"])
            if isinstance(motion, Infeasible):
                continue
            episode = recorded.episode(candidate)
            t = episode.times
            planned = planned_motion(cell, candidate, world, motion)
            samples = planned.stage.samples_at(t)
            required = planned.stage.requires(planned.targets, samples)
            phases = [motion.primitives[planned.stage.pieces[k].primitive].name for k in samples.piece.tolist()]
            whose = {"episode": np.full(len(t), own), "frame": episode.frames, "t": t}
            found = cell.observer.verdicts(planned.targets, planned.stage.states(samples))
            for column, (target, boxes) in enumerate(zip(planned.targets, found, strict=True)):
                first, _ = first_failing(boxes, np.arange(len(t)))
                for index, name in enumerate(names):
                    causes = [Cause(code) for code in first.cause[:, index].tolist()]
                    by = zip(causes, first.by[:, index].tolist(), strict=True)
                    rows = {
                        **whose,
                        "phase": phases,
                        "target": [str(target.atom)] * len(t),
                        "camera": [name] * len(t),
                        "required": required[:, column],
                        "visible": pa.array(first.visible[:, index], from_pandas=True),
                        "cause": [cause.label for cause in causes],
                        "by": [cell.observer.by_name(*one) for one in by],
                    }
                    writer.write_table(pa.table(rows, schema=schema))
                    count += len(t)
    return count
