"""The output of `sqrp place`: the cameras, what candidates then reach, and what is proven."""

from __future__ import annotations

from time import monotonic

from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.report.documents import placing
from sqrp_cli.terminal.console import Column, joined, note, numbers, percent, print_table, say, say_command, seconds
from sqrp_cli.terminal.progress_lines import PERIOD, wanted

MOST_UNSEEN = 8
"""Most targets that are named where a wish cannot be met."""


class Bounds:
    """Lines on stderr about a search that is long: what is sought, the best so far, and the bound."""

    def __init__(self) -> None:
        """The first line comes after a while."""
        self._told = monotonic()

    def __call__(self, title: str, best: float | None, bound: float) -> None:
        """Tell it, if the last line is old enough."""
        if wanted.get() and monotonic() - self._told >= PERIOD:
            self._told = monotonic()
            known = "none" if best is None else f"{abs(best):.4g}"
            note(f"{title}: best so far {known}, bound {abs(bound):.4g}")


def print_placement(found: placing.PlaceDocument, wish: Wish | None, *, written: bool = False) -> None:
    """The cameras, the figures of the candidates with them, and the proof. written: whether a patch was written."""
    tasks = ", ".join(found.tasks)
    say(joined([(tasks, "bold"), f" in {found.workspace}\n"]))
    say(placing.compared_in_words(found))
    if placing.unmet_in_words(found, wish):
        _print_unmet(found, wish)
    if found.cameras:
        say()
        _print_cameras(found)
        say()
        _print_candidates(found)
    for one in found.infeasible:
        say(joined([("no   ", "dim"), f" {one.task}: {one.candidate}: {one.reason}"]), indent=6)
    say()
    say(found.proof)
    if found.survive:
        say("Counted is only what is still seen if any one of the cameras fails.")
        _print_price(found)
    for words in filter(
        None, (placing.moved_in_words(found), placing.ranked_in_words(found), placing.scope_in_words(found))
    ):
        say(words)
    if found.patch and not written:
        say_command("To have it, add", "--patch FILE")


def _print_price(found: placing.PlaceDocument) -> None:
    """What it costs that a camera may fail."""
    without = found.without_spare
    if without is None:
        return
    more, dearer = len(found.cameras) - without.cameras, found.price - without.price
    worse = without.objective - found.objective
    costs = [f"{placing.in_words(more)} more camera{'' if more == 1 else 's'}"] if more > 0 else []
    costs += [f"a price of {dearer:g}"] if dearer > 1e-9 else []
    costs += [f"{100 * worse:.1f} points of the {found.by} Q"] if worse > 5e-4 else []
    if costs:
        have = f"{placing.in_words(without.cameras)} with a {found.by} Q of {100 * without.objective:.1f} % would do"
        say(f"That costs {' and '.join(costs)}: if none could fail, {have}.")
    else:
        say(f"That costs nothing: if none could fail, it would be {placing.in_words(without.cameras)}, too.")


def _print_unmet(found: placing.PlaceDocument, wish: Wish | None) -> None:
    say()
    say(placing.unmet_in_words(found, wish), style="red")
    for one in found.unseen[:MOST_UNSEEN]:
        say(f"  {one.candidate}: {one}", indent=4)
    if len(found.unseen) > MOST_UNSEEN:
        say(f"  and {len(found.unseen) - MOST_UNSEEN} more, see --json", indent=4)


def _print_cameras(found: placing.PlaceDocument) -> None:
    columns = [Column("camera"), Column("mount"), Column("lens", shrink=True), Column("where [m]")]
    columns += numbers("alone\n[%]", "loss if it\nfails [points]")
    if any(one.price for one in found.cameras):
        columns.append(Column("price", right=True))
    rows = []
    for one in found.cameras:
        where = " ".join(f"{row[3]:.3f}" for row in one.pose[:3]) + ("" if one.frame == "world" else f" {one.frame}")
        row = [one.name, one.mount, one.lens, where, f"{100 * one.alone:.1f}", f"{100 * one.loss:.1f}"]
        rows.append([*row, f"{one.price:g}"][: len(columns)])
    print_table(columns, rows)


def _print_candidates(found: placing.PlaceDocument) -> None:
    several = len(found.tasks) > 1
    columns = [*([Column("task")] if several else []), Column("candidate")]
    columns += numbers("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nafter")
    rows = []
    for one in found.candidates:
        figures = [percent(one.q_eoi), percent(one.q_avg), seconds(one.time), seconds(one.delay_worst)]
        rows.append([*([one.task] if several else []), one.candidate, *figures])
    print_table(columns, rows)
