"""The output of `sqrp advise` and `sqrp place`: changes that meet a wish, and cameras with what is proven of them."""

from __future__ import annotations

from itertools import groupby
from time import monotonic

from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.search.advice_result import AdviceDocument
from sqrp_cli.search.goal import MOTION, Goal, shown_size
from sqrp_cli.search.placing_result import PlaceDocument, in_words
from sqrp_cli.show.sentences import KIND_WORDS
from sqrp_cli.show.terminal.console import (
    Column,
    Styled,
    delay,
    joined,
    note,
    numbers,
    percent,
    plain,
    print_table,
    say,
    say_command,
    seconds,
)
from sqrp_cli.show.terminal.progress_lines import PERIOD, wanted

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst", "up to")


def print_advice(found: AdviceDocument, *, written: bool = False) -> None:
    """The table with a row for each change that meets the wish, why other kinds do not, and what to do.

    written: whether a change was written to a file.
    """
    say(joined([(found.task, "bold"), f" in {found.workspace}: {found.candidate} is to have {found.want}\n"]))
    as_it_is = "As it moves with --ways fastest" if found.starts_fastest else "In its best way, as rank takes it"
    say(f"{as_it_is}, it has {_figures(found.before, found.want)}.")
    if found.met:
        say("\nThat is met already: nothing has to change.")
        _say_assumed(found.assumed)
        return
    if found.best is not None:
        say(
            f"The way that rank and score take meets the wish already, with {_figures(found.best, found.want)}; what "
            "follows is for the motion of --ways fastest, which is planned without a look at the cameras."
        )
    if found.advice:
        say()
        rows: list[list[Styled]] = []
        for number, one in enumerate(found.advice, 1):
            room = "-" if one.margin is None else shown_size(one.size + one.margin.more, one.unit)
            figures = [percent(one.q_eoi), percent(one.q_avg), seconds(one.time), delay(one.delay_worst, one.unseen)]
            rows.append([str(number), one.words, *figures, room])
        print_table([*numbers("#"), Column("change", shrink=True), *numbers(*_FIGURES)], rows)
    for number, cost in ((number, cost) for number, one in enumerate(found.advice, 1) for cost in one.costs):
        say(joined([(f"#{number} costs", "red"), f" {cost}"]), indent=4)
    if found.held:
        say(found.held)
    for why, same in groupby((one for one in found.kinds if not one.found), key=lambda one: one.why):
        outcomes = list(same)
        say(joined([("no   ", "dim"), f" {', '.join(KIND_WORDS[one.kind] for one in outcomes)}: {why}"]), indent=6)
        for nearest in (one.nearest for one in outcomes if one.nearest is not None):
            then = f"nearest: {nearest.words}, then {'; '.join(nearest.missing)}"
            near, about = (then, "") if nearest.nearer else ("nothing comes nearer", f"to {nearest.words}: ")
            say(plain(f"      {near}{f' ({about}{nearest.limit})' if nearest.limit else ''}", "dim"), indent=6)
    say()
    _conclude(found, written=written)
    _say_assumed(found.assumed)


def _say_assumed(assumed: str) -> None:
    if assumed:
        say(f"Delays: {assumed}.")


def _conclude(found: AdviceDocument, *, written: bool) -> None:
    """One sentence that says what to do; where nothing was found, what comes nearest or has to be done before."""
    if found.interrupted:
        say("Interrupted before all kinds were searched.")
    if not found.advice:
        nothing = "Nothing that was searched so far" if found.interrupted else "Nothing"
        if found.nearest is not None:
            say(f"{nothing} meets the wish. {found.nearest}.")
        elif found.first:
            say(f"No change helps: {found.first}.")
            say_command("These steps as a program:", "sqrp check WORKSPACE TASK --program FILE")
        elif found.kinds:
            say("Nothing that was tried meets the wish.")
        return
    number = next((n for n, one in enumerate(found.advice, 1) if one.kind in MOTION or not one.worse), 1)
    one = found.advice[number - 1]
    judged = " with --ways fastest" if found.ways == "fastest" else ""
    cost = "what it costs is said above" if one.worse else f"no task gets worse{judged}"
    words = one.words
    say(f"{words[0].upper()}{words[1:]}: {found.candidate} then has {_figures(one, found.want)}, and {cost}.")
    if one.patch and not written:
        say_command("To have it, add", f"--apply {number}")
    elif one.unwritten:
        say(f"No patch: {one.unwritten}.")


def _figures(found: AdvisedFigures, want: Goal) -> str:
    """The figures of a candidate; how late faults are seen only where that is wished for."""
    if found.time is None:
        return "no feasible motion"
    parts = [f"Q_eoi {100 * found.q_eoi:.1f} %"] if found.q_eoi is not None else []
    parts += [f"Q_avg {100 * found.q_avg:.1f} %"] if found.q_avg is not None else []
    parts.append(f"{found.time:.1f} s")
    if want.delay is not None and found.unseen is not None:
        late = f"a fault seen after {found.delay_worst:.2f} s at worst" if found.delay_worst is not None else ""
        parts.append(late or "a fault that may never be noticed")
    return ", ".join(parts)


MOST_UNSEEN = 8  # most targets that are named where a wish cannot be met


class Bounds:
    """Lines on stderr about a search that is long: what is sought, the best so far, and the bound."""

    def __init__(self) -> None:
        """The first line comes after a while."""
        self._began = self._told = monotonic()

    def __call__(self, title: str, best: float | None, bound: float) -> None:
        """Tell it, if the last line is old enough."""
        if wanted.get() and monotonic() - self._told >= PERIOD:
            self._told = monotonic()

            def shown(value: float) -> str:
                return f"{100 * value:.1f} %" if title.endswith(" Q") else f"{abs(value):.4g}"

            known = "none" if best is None else shown(best)
            after = self._told - self._began
            note(f"choosing cameras: {title}: best so far {known}, bound {shown(bound)} after {after:.0f} s")


def print_placement(found: PlaceDocument, *, written: bool = False) -> None:
    """The cameras, the figures of the candidates with them, and the proof. written: whether a patch was written."""
    say(joined([(", ".join(found.tasks), "bold"), f" in {found.workspace}\n"]))
    say(found.comparison)
    if found.unmet:
        say()
        say(found.unmet, style="red")
        for unseen in found.unseen[:MOST_UNSEEN]:
            say(f"  {unseen.candidate}: {unseen}", indent=4)
        if len(found.unseen) > MOST_UNSEEN:
            say(f"  and {len(found.unseen) - MOST_UNSEEN} more, see --json", indent=4)
    if found.cameras:
        say()
        _print_cameras(found)
        say()
        several = len(found.tasks) > 1
        columns = [*([Column("task")] if several else []), Column("candidate")]
        rows: list[list[Styled]] = []
        for one in found.candidates:
            figures = [percent(one.q_eoi), percent(one.q_avg), seconds(one.time), delay(one.delay_worst, one.unseen)]
            rows.append([*([one.task] if several else []), one.candidate, *figures])
        print_table([*columns, *numbers(*_FIGURES[:-1])], rows)
    for no in found.infeasible:
        say(joined([("no   ", "dim"), f" {no.task}: {no.candidate}: {no.reason}"]), indent=6)
    say()
    say(found.proof)
    if found.survive:
        say("Counted is only what is still seen if any one of the cameras fails.")
        _print_price(found)
    for words in filter(None, (found.moves, found.other_ways, found.scope)):
        say(words)
    if found.patch and not written:
        say_command("To have it, add", "--patch FILE")
    _say_assumed(found.assumed)


def _print_price(found: PlaceDocument) -> None:
    """What it costs that a camera may fail."""
    without = found.without_spare
    if without is None:
        return
    more, dearer = len(found.cameras) - without.cameras, found.price - without.price
    worse = without.objective - found.objective
    costs = [f"{in_words(more)} more camera{'' if more == 1 else 's'}"] if more > 0 else []
    costs += [f"a price of {dearer:g}"] if dearer > 1e-9 else []
    costs += [f"{100 * worse:.1f} points of the {found.by} Q"] if worse > 5e-4 else []
    if costs:
        have = f"{in_words(without.cameras)} with a {found.by} Q of {100 * without.objective:.1f} % would do"
        say(f"That costs {' and '.join(costs)}: if none could fail, {have}.")
    else:
        say(f"That costs nothing: if none could fail, it would be {in_words(without.cameras)}, too.")


def _print_cameras(found: PlaceDocument) -> None:
    columns = [Column("camera"), Column("mount"), Column("lens", shrink=True), Column("where [m]")]
    columns += numbers("alone\n[%]", "loss if it\nfails [points]")
    if any(one.price for one in found.cameras):
        columns.append(Column("price", right=True))
    rows = []
    for one in found.cameras:
        where = " ".join(f"{row[3]:z.3f}" for row in one.pose[:3]) + ("" if one.frame == "world" else f" {one.frame}")
        row = [one.name, one.mount, one.lens, where, f"{100 * one.alone:.1f}", f"{100 * one.loss:z.1f}"]
        rows.append([*row, f"{one.price:g}"][: len(columns)])
    print_table(columns, rows)
