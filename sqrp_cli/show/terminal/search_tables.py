"""The output of `sqrp advise`, `place`, `score` and `diff`: what helps, what is proven of it, and what got worse."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from time import monotonic

from sqrp_cli.figures import AdvisedFigures, Figures, named_figures
from sqrp_cli.score.result import Scorecard, ScoredVariant, Sweep, listed
from sqrp_cli.search.advice_result import AdviceDocument
from sqrp_cli.search.goal import MOTION, Goal, shown_size
from sqrp_cli.search.placing_result import PlaceDocument, count_in_words
from sqrp_cli.show.placement_words import placement_in_words
from sqrp_cli.show.sentences import KIND_WORDS
from sqrp_cli.show.terminal.console import (
    Column,
    Styled,
    delay,
    joined,
    note,
    numbers,
    print_table,
    say,
    say_assumed,
    say_command,
    say_line,
    seconds,
    styled,
)
from sqrp_cli.show.terminal.progress_lines import PERIOD, lines_wanted

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst")

_STYLES = {"passed": "green", "failed": "red", "error": "bold red"}

ROWS = 20  # variants in the table; the document has all


def _figures_of(one: AdvisedFigures | Figures | ScoredVariant) -> list[str]:
    """The cells of `_FIGURES`."""
    shares = ("-" if share is None else f"{100 * share:.1f}" for share in (one.q_eoi, one.q_avg))
    worst = one.delay if isinstance(one, ScoredVariant) else one.delay_worst
    return [*shares, seconds(one.time), delay(worst, one.unseen)]


def print_advice(found: AdviceDocument, *, written: bool = False) -> None:
    """The table with a row for each change that meets the goal, why other kinds do not, and what to do.

    written: whether a change was written to a file.
    """
    say(joined([(found.task, "bold"), f" in {found.workspace}: {found.candidate} is to have {found.want}\n"]))
    command = _conclude(found, written=written)
    as_it_is = "Now, in its fastest way" if found.starts_fastest else "In its best way, as rank takes it"
    say(f"{as_it_is}, it has {_in_words(found.before, found.want)}.")
    if found.best is not None and not found.met:
        say(
            f"The way that rank and score take meets the goal already, with {_in_words(found.best, found.want)}; what "
            "follows is for the motion of --ways first, which is planned without a look at the cameras."
        )
    if found.advice:
        say()
        rows: list[list[Styled]] = []
        for number, one in enumerate(found.advice, 1):
            room = "-" if one.margin is None else shown_size(one.size + one.margin.more, one.unit)
            rows.append([str(number), one.words, *_figures_of(one), room])
        print_table([*numbers("#"), Column("change", shrink=True), *numbers(*_FIGURES, "up to")], rows)
    for number, cost in ((number, cost) for number, one in enumerate(found.advice, 1) for cost in one.costs):
        say(joined([(f"#{number} costs", "red"), f" {cost}"]), indent=4)
    if found.whose_figures:
        say(found.whose_figures)
    unmet: dict[str, list[str]] = {}
    for kind in (kind for kind in found.kinds if not kind.found):
        near = "" if kind.nearest is None else f"; {kind.nearest}{kind.nearest.limit and f': {kind.nearest.limit}'}"
        unmet.setdefault(f"{kind.why}{near}", []).append(KIND_WORDS[kind.kind])
    for why, kinds in unmet.items():
        say(joined([("no   ", "dim"), f" {', '.join(kinds)}: {why}"]), indent=6)
    if command:
        say()
        say_command(*command)
    say_assumed(found.assumed)


def _conclude(found: AdviceDocument, *, written: bool) -> tuple[str, str] | None:
    """Say what to do, or what comes nearest or has to be done before; the command that does it, with its words."""
    if found.interrupted:
        say("Interrupted before all kinds were searched.")
    if found.met:
        say("That is met already: nothing has to change.")
        if found.unnoticed:
            say(f"{found.unnoticed}.")
            return "To have faults noticed sooner, add", "--want 'delay 1 s'"
    elif not found.advice:
        nothing = "Nothing that was searched so far is enough" if found.interrupted else "Nothing is enough"
        if found.nearest is not None:
            say(f"{nothing}; {found.nearest}.")
        elif found.first:
            say(f"No change helps: {found.first}.")
            return "These steps as a program:", "sqrp check WORKSPACE TASK --program FILE"
        elif found.kinds:
            say(f"{nothing}.")
    else:
        number = next((n for n, one in enumerate(found.advice, 1) if one.kind in MOTION or not one.worse), 1)
        one = found.advice[number - 1]
        judged = " with --ways first" if found.ways == "first" else ""
        cost = "what it costs is said below" if one.worse else f"no task gets worse{judged}"
        words = f"{one.words[0].upper()}{one.words[1:]}: {found.candidate} then has {_in_words(one, found.want)}"
        say(f"{words}, and {cost}.")
        if one.unwritten:
            say(f"No patch: {one.unwritten}.")
        if one.patch and not written:
            return "To have it, add", f"--apply {number}"
    return None


def _in_words(found: AdvisedFigures, want: Goal) -> str:
    """The figures of a candidate; how late faults are seen only where that is asked for."""
    if found.time is None:
        return "no feasible motion"
    parts = [*named_figures(found, "q_eoi", "q_avg"), f"{found.time:.1f} s"]
    if want.delay is not None and found.unseen is not None:
        late = f"a fault seen after {found.delay_worst:.2f} s at worst" if found.delay_worst is not None else ""
        parts.append(late or "a fault that may never be noticed")
    return ", ".join(parts)


MOST_UNSEEN = 8  # most targets that are named where a goal cannot be met


def bounds_reporter() -> Callable[[str, float | None, float], None]:
    """Lines on stderr now and then about a search that is long: what is sought, the best so far, and the bound."""
    began = latest = monotonic()

    def report(title: str, best: float | None, bound: float) -> None:
        nonlocal latest
        if lines_wanted.get() and monotonic() - latest >= PERIOD:
            latest = monotonic()
            values = (best or 0.0, bound)
            first, last = (f"{100 * v:.1f} %" if title.endswith(" Q") else f"{abs(v):.4g}" for v in values)
            first = "none" if best is None else first
            note(f"choosing cameras: {title}: best so far {first}, bound {last} after {latest - began:.0f} s")

    return report


def print_placement(found: PlaceDocument, *, written: bool = False) -> None:
    """The cameras, the figures of the candidates with them, and the proof. written: whether a patch was written."""
    said = placement_in_words(found)
    say(joined([(", ".join(found.tasks), "bold"), f" in {found.workspace}\n"]))
    if said.unmet:
        say(said.unmet, style="red")
        for unseen in found.unseen[:MOST_UNSEEN]:
            say(f"  {unseen.candidate}: {unseen}", indent=4)
        if len(found.unseen) > MOST_UNSEEN:
            say(f"  and {len(found.unseen) - MOST_UNSEEN} more, see --json", indent=4)
    elif found.cameras:
        places = " and ".join(f"{one.name} at {one.mount}" for one in found.cameras)
        say(f"Put {places}: the {found.by} Q is then {100 * found.objective:.1f} %.")
    say(found.proof)
    if found.survive:
        say("Counted is only what is still seen if any one of the cameras fails.")
        _print_price(found)
    for words in filter(None, (said.moves, said.other_ways, said.scope)):
        say(words)
    if found.cameras:
        say()
        columns = [Column("camera"), Column("mount"), Column("lens", shrink=True), Column("where [m]")]
        columns += numbers("alone\n[%]", "loss if it\nfails [points]")
        priced = any(one.price for one in found.cameras)
        columns += numbers("price") if priced else []
        cameras = []
        for camera in found.cameras:
            where = " ".join(f"{row[3]:z.3f}" for row in camera.pose[:3])
            where += "" if camera.frame == "world" else f" {camera.frame}"
            figures = [f"{100 * camera.alone:.1f}", f"{100 * camera.loss:z.1f}"]
            price = [f"{camera.price:g}"] if priced else []
            cameras.append([camera.name, camera.mount, camera.lens, where, *figures, *price])
        print_table(columns, cameras)
        say()
        several = len(found.tasks) > 1
        columns = [*([Column("task")] if several else []), Column("candidate")]
        rows = [[*([one.task] if several else []), one.candidate, *_figures_of(one)] for one in found.candidates]
        print_table([*columns, *numbers(*_FIGURES)], rows)
    for no in found.infeasible:
        say(joined([("no   ", "dim"), f" {no.task}: {no.candidate}: {no.reason}"]), indent=6)
    say()
    say(f"Compared were {said.comparison}.")
    if found.patch and not written:
        say_command("To have it, add", "--patch FILE")
    say_assumed(found.assumed)


def _print_price(found: PlaceDocument) -> None:
    """What it costs that a camera may fail."""
    without = found.without_spare
    if without is None:
        return
    more, dearer = len(found.cameras) - without.cameras, found.price - (without.price or 0.0)
    worse = without.objective - found.objective
    costs = [f"{count_in_words(more)} more camera{'' if more == 1 else 's'}"] if more > 0 else []
    costs += [f"a price of {dearer:g}"] if dearer > 1e-9 else []
    costs += [f"{100 * worse:.1f} points of the {found.by} Q"] if worse > 5e-4 else []
    if costs:
        have = f"{count_in_words(without.cameras)} with a {found.by} Q of {100 * without.objective:.1f} % would do"
        say(f"That costs {' and '.join(costs)}: if none could fail, {have}.")
    else:
        say(f"That costs nothing: if none could fail, it would be {count_in_words(without.cameras)}, too.")


def print_scorecard(findings: Scorecard) -> None:
    """The table with a row per task, then a sentence for every failure; of two versions what differs."""
    if findings.document == "diff":
        print_difference(findings)
        return
    if findings.results:
        rows: list[list[Styled]] = []
        for one in findings.results:
            best = ["", "", "", "", ""] if one.best is None else [one.best.name, *_figures_of(one.best)]
            rows.append([one.workspace, one.task or "", *best, styled(one.status, _STYLES[one.status])])
        columns = [Column("workspace", shrink=True), Column("task", shrink=True), Column("best", shrink=True)]
        print_table([*columns, *numbers(*_FIGURES), Column("")], rows)
    for score in findings.results:
        for reason in score.reasons:
            named = score.task is None or reason.startswith(score.task)
            where = score.workspace if named else score.named
            say(joined(["\n", (score.status, _STYLES[score.status]), f" {where}: {reason}"]))
    # Improvements, new and vanished tasks, and what changed where nothing got worse.
    for result in findings.results:
        comparison = result.baseline
        if comparison is None:
            continue
        for change in comparison.ways:
            if not change.worse:
                say(joined(["\n", ("improved", "green"), f" {result.named} for {change}"]))
        if comparison.verdict == "new":
            say(joined(["\n", ("new", "yellow"), f" {result.named} is not in the baseline"]))
        for way in comparison.gone:
            say(joined(["\n", ("gone", "yellow"), f" {result.named} for {way}: there is no such way any more"]))
    for name, before in findings.renamed.items():
        say(joined(["\n", ("renamed", "yellow"), f" {name} is {before} of the baseline"]))
    style = "yellow" if findings.may_vanish else "red"
    for gone in findings.vanished:
        say(joined(["\n", ("vanished", style), f" {gone.workspace}, {gone.task} is only in the baseline"]))
    missing = findings.vanished or any(one.baseline and one.baseline.gone for one in findings.results)
    if missing and not findings.may_vanish:
        say("\nWhat is gone fails: --allow-missing lets it pass, --save-baseline makes a new baseline.")
    worse = {result.workspace for result in findings.results if result.baseline and result.baseline.ways}
    for workspace, changes in findings.changes.items():
        if changes and workspace not in worse:
            say(joined(["\n", ("changed", "dim"), f" {workspace}, with no effect: {listed(changes)}"]))
    if findings.results:
        say()
    if findings.results or findings.interrupted:
        say(passed_in_words(findings))


def print_difference(findings: Scorecard) -> None:
    """What differs between two versions, and the effect on every way of doing a task."""
    if findings.interrupted:
        say("Interrupted before the two versions could be compared.")
        return
    changes = [change for changes in findings.changes.values() for change in changes]
    say("What differs in the workspace:" if changes else "Nothing that matters differs in the workspace.")
    for change in changes:
        say(f"  {change}", indent=4)
    ways = [(result, change) for result in findings.results if result.baseline for change in result.baseline.ways]
    say("\nWhat that does:" if ways else "\nNo task gets better or worse.")
    for result, way in ways:
        mixed = any(not shift.worse for shift in way.shifts)
        mark = ("better", "green") if not way.worse else ("mixed ", "yellow") if mixed else ("worse ", "red")
        say(joined(["  ", mark, f"  {result.task} for {way}"]), indent=10)
    for result in findings.results:
        if result.baseline and result.baseline.verdict == "new":
            say(joined(["  ", ("new   ", "yellow"), f"  {result.task}"]), indent=10)
        for name in result.baseline.gone if result.baseline else ():
            say(joined(["  ", ("gone  ", "yellow"), f"  {result.task} for {name}"]), indent=10)
    for vanished in findings.vanished:
        say(joined(["  ", ("gone  ", "yellow"), f"  {vanished.task}"]), indent=10)
    if changes:
        say("Compared are the best ways of both versions; what changes by less than --allow is left out.")


def passed_in_words(findings: Scorecard) -> str:
    """The sentence that ends a run."""
    total = len(findings.results) + (findings.unfinished or 0)
    of_all = f"of {total} task{'s' if total != 1 else ''}"
    counts = [f"{findings.count('passed')} {of_all} passed"]
    if findings.interrupted:
        done = len(findings.results)
        were = "was" if 1 in (done, total) else "were"
        counts = [f"Interrupted: {done} {of_all} {were} finished", f"{findings.count('passed')} passed"]
    counts += [f"{findings.count('failed')} failed"] if findings.count("failed") else []
    errors = findings.count("error")
    counts += [f"{errors} could not be scored"] if errors else []
    counts += [f"{len(findings.vanished)} vanished"] if findings.vanished and not findings.may_vanish else []
    return ", ".join(counts) + "."


def print_variants(found: Sweep) -> None:
    """The table of variants, the best first, and the command that applies the best."""
    paths = max((list(one.values) for one in found.variants), key=len)
    columns = [Column("#", right=True), *(Column(name, right=True, shrink=True) for name in column_titles(paths))]
    columns += numbers(*_FIGURES, "can be\ndone", "tasks\npassed")
    shown = [one for one in found.variants if one.rank <= ROWS or not one.values]
    rows: list[list[Styled]] = []
    reasons: dict[str, list[int]] = {}
    for one in shown:
        errors = [result for result in one.results if result.status == "error"]
        if errors:
            reasons.setdefault(errors[0].reasons[0], []).append(one.rank)
        passed = f"{sum(result.status == 'passed' for result in one.results)} of {len(one.results)}"
        rows.append(
            [
                str(one.rank),
                *(one.values.get(path, "as it is") for path in paths),
                *_figures_of(one),
                f"{one.feasible} of {one.choices}",
                styled("error", "bold red") if errors else passed,
            ]
        )
    print_table(columns, rows)
    for reason, ranks in reasons.items():
        say(f"{', '.join(f'#{rank}' for rank in ranks)}: {reason}")
    if len(found.variants) > len(shown):
        say(styled(f"{len(found.variants) - len(shown)} more are in the document of --json.", "dim"))
    say(styled("Figures are means over the choices of objects, of every task, that can be done.", "dim"))
    say()
    if found.patch is None:
        say("None is better than the workspace as it is.")
        return
    values = ", ".join(f"{path} = {value}" for path, value in found.best.items())
    among = "" if found.equals == 1 else f" Of {found.equals} that are as good it has the most room around it."
    say(f"Best is {values}.{among} To have it:")
    say_line(f"  patch {shlex.quote(found.file)} < {shlex.quote(found.patch)}")


def column_titles(paths: list[str]) -> list[str]:
    """Titles: the end of each path under the name of its owner, such as a camera; whole paths if two look alike."""
    titles = []
    for words in (path.split(".") for path in paths):
        named = words[0] in ("cameras", "objects", "detectors")
        owner, rest = (words[1:2], words[2:]) if named else (words[:1], words[1:])
        titles.append("\n".join([*owner, ".".join(rest[-2:])] if rest else owner))
    return titles if len(set(titles)) == len(titles) else paths
