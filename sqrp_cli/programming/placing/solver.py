"""Mixed-integer linear programs, solved by HiGHS: the only module that imports it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from sqrp_cli.errors import needed
from sqrp_cli.geometry import Array

Terms = Mapping[int, float]
"""A linear expression: the factor of each variable, by its number."""

Watch = Callable[[float | None, float], None]
"""Called with the best value so far, if there is one, and the bound."""

_TIGHT = 1e-9
"""Gap at which a program counts as solved."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What came of a program."""

    values: Array | None
    """Of the variables; None if none was found."""
    bound: float
    """No values are better than this; minus infinity where nothing is possible at all."""
    proven: bool
    """Whether the values are the best, or it is proven that there are none."""
    interrupted: bool = False


@dataclass(eq=False)
class LinearProgram:
    """Variables in 0..1 and linear rows between limits, built step by step."""

    whole: list[bool] = field(default_factory=list)
    rows: list[tuple[float, dict[int, float], float]] = field(default_factory=list)

    def variable(self, *, whole: bool = False) -> int:
        """A new variable; its number. whole: whether it takes whole numbers only."""
        self.whole.append(whole)
        return len(self.whole) - 1

    def row(self, terms: Terms, *, least: float = -inf, most: float = inf) -> None:
        """A limit on an expression."""
        self.rows.append((least, dict(terms), most))

    def cut(self, rows: int, variables: int) -> None:
        """Keep so many of the first rows and variables."""
        del self.rows[rows:]
        del self.whole[variables:]

    def maximized(self, objective: Terms, start: Array | None = None, watch: Watch | None = None) -> Solution:
        """The values with the greatest objective; always the same for the same program. start: values to begin with.

        Ctrl-C ends the search with the best values so far.
        """
        highs = _highs()
        highs.passModel(self._model(objective))
        if start is not None:
            found = _library().HighsSolution()
            found.col_value = start.tolist()
            highs.setSolution(found)
        with _until_interrupted(highs, watch) as interrupted:
            highs.run()
        return self._solution(highs, bool(interrupted))

    def _model(self, objective: Terms) -> Any:  # noqa: ANN401 # of a library without types
        library = _library()
        model, count = library.HighsLp(), len(self.whole)
        cost = np.zeros(count)
        for number, factor in objective.items():
            cost[number] = factor
        model.num_col_, model.num_row_ = count, len(self.rows)
        model.sense_ = library.ObjSense.kMaximize
        model.col_cost_, model.col_lower_, model.col_upper_ = cost, np.zeros(count), np.ones(count)
        model.row_lower_ = np.array([least for least, _, _ in self.rows])
        model.row_upper_ = np.array([most for _, _, most in self.rows])
        matrix = model.a_matrix_
        matrix.format_ = library.MatrixFormat.kRowwise
        matrix.start_ = np.cumsum([0, *(len(terms) for _, terms, _ in self.rows)]).astype(np.int32)
        matrix.index_ = np.array([n for _, terms, _ in self.rows for n in terms], dtype=np.int32)
        matrix.value_ = np.array([factor for _, terms, _ in self.rows for factor in terms.values()], dtype=float)
        kinds = library.HighsVarType
        model.integrality_ = [kinds.kInteger if whole else kinds.kContinuous for whole in self.whole]
        return model

    def _solution(self, highs: Any, interrupted: bool) -> Solution:  # noqa: ANN401
        statuses, status = _library().HighsModelStatus, highs.getModelStatus()
        if status == statuses.kInfeasible:
            return Solution(None, -inf, proven=True)
        info, values = highs.getInfo(), np.array(highs.getSolution().col_value)
        feasible = info.primal_solution_status == 2
        values[np.array(self.whole, dtype=bool)] = np.round(values[np.array(self.whole, dtype=bool)])
        bound = float(info.mip_dual_bound) if any(self.whole) else float(info.objective_function_value)
        proven = status == statuses.kOptimal
        return Solution(values if feasible else None, bound, proven=proven, interrupted=interrupted)


def check_solver() -> None:
    """Raises InputError where HiGHS is not installed."""
    _library()


def _library() -> Any:  # noqa: ANN401 # a module without types
    with needed("placing cameras needs HiGHS, which is not installed", "pip install 'sqrp[place]'"):
        import highspy
    return highspy


def _highs() -> Any:  # noqa: ANN401 # of a library without types
    """A silent solver on one thread: more would not always give the same values.

    Its wrapper in Python prints a line before it can be told not to.
    """
    highs = _library()._core._Highs()
    options = {
        "output_flag": False,
        "threads": 1,
        "random_seed": 0,
        "mip_rel_gap": _TIGHT,
        "mip_abs_gap": _TIGHT,
        "mip_feasibility_tolerance": 1e-7,
    }
    for name, value in options.items():
        highs.setOptionValue(name, value)
    return highs


@contextmanager
def _until_interrupted(highs: Any, watch: Watch | None) -> Iterator[Sequence[int]]:  # noqa: ANN401
    """Let Ctrl-C end a search; yields a list that is then not empty."""
    kinds = _library().cb.HighsCallbackType
    came: list[int] = []

    def called(kind: Any, _message: str, out: Any, into: Any, _data: object) -> None:  # noqa: ANN401
        if kind == kinds.kCallbackMipInterrupt and into is not None:
            into.user_interrupt = bool(came)
        if watch is not None and abs(out.mip_dual_bound) < 1e20:
            watch(out.mip_primal_bound if abs(out.mip_primal_bound) < 1e20 else None, out.mip_dual_bound)

    highs.setCallback(called, None)
    highs.startCallback(kinds.kCallbackMipInterrupt)
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)
