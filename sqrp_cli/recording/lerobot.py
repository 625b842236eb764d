"""Datasets of LeRobot, v2 and v3: `meta/info.json` and Parquet files; videos are not needed.

v2 has a file for each episode, `data/chunk-000/episode_000000.parquet`. In v3 many episodes share a file,
`data/chunk-000/file-000.parquet`, and the tables in `meta/episodes/` say which.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.errors import InputError, Place, bad_input, expected_names, needed
from sqrp_cli.files.input_file import open_input, read_text
from sqrp_cli.files.json_file import parse_json
from sqrp_cli.geometry import Array
from sqrp_cli.recording.episode import MOST_NAMES, MOST_NUMBERS, Episode, Recording, episode_of

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

STATE = "observation.state"
"""The feature that is read unless another one is asked for: where the joints were, not where they were sent."""
_LARGEST_INFO, _LARGEST_FILE, _ROWS, _MOST_EPISODES = 10_000_000, 1 << 40, 1 << 16, 1_000_000
"""Bytes of files; rows that are unpacked at once; episodes."""
_NUMBER, _FRAME, _TIME = "episode_index", "frame_index", "timestamp"
_PLACE = (_NUMBER, "data/chunk_index", "data/file_index")


def open_dataset(path: Path, rate: float | None, signal: str | None) -> Recording:
    """The dataset in a folder; signal: the feature, by default `STATE`. Raises InputError, also before v2."""
    with needed("reading a dataset needs the package pyarrow", "pip install 'sqrp[recordings]'", Place(path)):
        import pyarrow.parquet  # noqa: F401
    info, feature = path / "meta" / "info.json", signal or STATE
    said = parse_json(info, read_text(info, _LARGEST_INFO))
    try:
        version, fps, features = said["codebase_version"].removeprefix("v"), float(said["fps"]), said["features"]
        if version[:2] not in ("2.", "3.") or not 0.0 < fps < 1e5:
            raise ValueError(f"of version `{version}` at {fps:g} frames per second")
        if feature not in features:
            known = [name for name, one in features.items() if "float" in one["dtype"]]
            message = f"this dataset has no feature `{feature}`; {expected_names(feature, known)}"
            raise bad_input("no-joints", message, Place(info))
        shape, names = features[feature]["shape"], features[feature].get("names") or []
        if isinstance(names, dict):  # of names to numbers, or of lists, such as `motors`
            numbered = all(isinstance(one, int) for one in names.values())
            names = sorted(names, key=names.__getitem__) if numbered else chain.from_iterable(names.values())
        width, names = int(shape[0]) if len(shape) == 1 else 0, [*map(str, names)]
        if not 0 < width <= MOST_NAMES:
            raise ValueError(f"whose `{feature}` has the shape {str(shape)[:40]}")
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        told = {KeyError: f"without {error}", ValueError: str(error)}.get(type(error), "that is described otherwise")
        message = f"this is a dataset {told}; expected v2 or v3, `fps`, and in `features` a `shape` of one number each"
        raise bad_input("wrong-value", message, Place(info), mend="convert it with the scripts of LeRobot") from error
    if len(names) != width:  # without names, or with one for all
        names = [f"{feature.rpartition('.')[2]}_{index}" for index in range(width)]
    is_v2 = version[0] == "2"  # of one that was fetched in part, the episodes that are there
    own = path.glob(f"data/*/episode_{6 * '[0-9]'}.parquet") if is_v2 else ()
    files = {int(file.stem[8:]): file for file in own}
    for table in () if is_v2 else sorted(path.glob("meta/episodes/*/*.parquet")):
        with _opened(table, _PLACE) as parquet:
            if parquet.metadata.num_rows > _MOST_EPISODES:
                raise ValueError(f"it has more than {_MOST_EPISODES:,} episodes")
            for batch in parquet.iter_batches(_ROWS, columns=[*_PLACE]):
                for number, chunk, at in np.column_stack([batch.column(name) for name in _PLACE]).tolist():
                    files[number] = path / "data" / f"chunk-{chunk:03d}" / f"file-{at:03d}.parquet"
    numbers = sorted(files)

    def read(episode: int) -> Episode:
        number, file = numbers[episode], files[numbers[episode]]
        parts = [np.zeros((0, 2 + width)), *_states(file, feature, width, None if is_v2 else number, fps)]
        states = np.concatenate(parts)
        return episode_of(states[:, 1:], names, Place(file), f"episode {number}", rate, states[:, 0].astype(int))

    return Recording(path, "dataset", tuple(names), read, {}, tuple(map(str, numbers)))


def _states(file: Path, feature: str, width: int, episode: int | None, fps: float) -> Iterator[Array]:
    """Frames, times [s] and values of an episode in a file, of all for None, (n, 2 + width), few rows at a time."""
    import pyarrow.compute

    with _opened(file, (feature, _NUMBER)) as parquet:
        known = [name for name in (_TIME, _FRAME) if name in parquet.schema_arrow.names]
        clock, scale = (_TIME, 1.0) if _TIME in known else (_FRAME, 1.0 / fps)
        paths = [parquet.schema.column(index).path for index in range(len(parquet.schema))]
        own = [one == feature or one.startswith(f"{feature}.") for one in paths].index(True)
        at, count = paths.index(_NUMBER), 0
        for group in range(parquet.num_row_groups):
            about = parquet.metadata.row_group(group)
            span = about.column(at).statistics
            if episode is not None and span and span.has_min_max and not span.min <= episode <= span.max:
                continue
            if (numbers := about.column(own).num_values / max(about.num_rows, 1)) != width and about.num_rows:
                message = f"a row has {numbers:g} numbers of `{feature}`; expected {width}, as `info.json` says"
                raise bad_input("wrong-columns", message, Place(file))
            for batch in parquet.iter_batches(_ROWS, [group], [_NUMBER, *known, feature]):
                if episode is not None:
                    batch = batch.filter(pyarrow.compute.equal(batch.column(_NUMBER), episode))
                values, count = batch.column(feature), count + len(batch)
                frames = batch.column(_FRAME) if _FRAME in known else np.arange(count - len(batch), count)
                if count * width > MOST_NUMBERS:
                    raise ValueError(f"it has more than {MOST_NUMBERS:,} numbers of an episode")
                if pyarrow.types.is_nested(values.type):
                    if (np.asarray(pyarrow.compute.list_value_length(values)) != width).any():
                        raise ValueError(f"its rows have different counts of `{feature}`")
                    values = values.flatten()
                times = np.asarray(batch.column(clock), dtype=float) * scale
                numbers = np.asarray(values, dtype=float).reshape(-1, width)
                yield np.column_stack([np.asarray(frames, dtype=float), times, numbers])


@contextmanager
def _opened(file: Path, columns: tuple[str, ...]) -> Iterator[ParquetFile]:
    """A Parquet file with some columns. Raises InputError, also for damage that shows while it is read."""
    from pyarrow.parquet import ParquetFile

    with open_input(file, _LARGEST_FILE) as stream:
        try:
            with ParquetFile(stream) as parquet:
                if lacking := [name for name in columns if name not in parquet.schema_arrow.names]:
                    raise ValueError(f"it lacks the column `{lacking[0]}`")
                yield parquet
        except (InputError, GeneratorExit):
            raise
        except Exception as error:  # pyarrow has its own, and what it reads may be anything
            told = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
            message = f"this part of a dataset cannot be read: {told}; expected a Parquet file of numbers that is whole"
            raise bad_input("unreadable-file", message, Place(file)) from error
