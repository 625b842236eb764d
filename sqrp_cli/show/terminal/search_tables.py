"""The output of `sqrp advise`, `place`, `score` and `diff`: what helps, what is proven of it, and what got worse."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from math import inf
from time import monotonic

from sqrp_cli.figures import FIGURE_NAMES, AdvisedFigures, Figures, shown_figure
from sqrp_cli.score.result import Scorecard, ScoredVariant, Sweep, listed
from sqrp_cli.search.advice_result import AdviceDocument
from sqrp_cli.search.goal import shown_size
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
from sqrp_cli.show.terminal.progress_lines import PERIOD, Verbosity, lines_wanted, verbosity
from sqrp_cli.show.terminal.rank_table import print_infeasible

_FIGURES = ("noticed\nat the\nlatest [s]", "critical\ntime\nseen [%]", "time\nseen\n[%]", "takes\n[s]")
_STYLES = {"passed": "green", "failed": "red", "error": "bold red"}
MOST_CHANGES = 6  # changes of advice that are shown all; of more, the least of each kind and the one to take
ROWS = 20  # variants in the table; the document has all


def _figures_of(one: AdvisedFigures | Figures | ScoredVariant) -> list[Styled]:
    """The cells of `_FIGURES`."""
    shares = ("-" if share is None else f"{100 * share:.1f}" for share in (one.q_eoi, one.q_avg))
    worst = one.delay if isinstance(one, ScoredVariant) else one.delay_worst
    return [delay(worst, one.unseen), *shares, seconds(one.time)]


def print_advice(found: AdviceDocument, *, written: bool = False) -> None:
    """What to do, what it costs, each change that meets the goal, and details. written: whether one is in a file."""
    command = _conclude(found, written=written)
    way = "in the way that is found first" if found.starts_fastest else "as rank does it"
    wanted = f" in {found.workspace}; wanted of {found.candidate} {way}: {found.want}"
    say(joined(["\n", (found.task, "bold"), wanted]))
    shown = [*enumerate(found.advice, 1)]
    if len(shown) > MOST_CHANGES and verbosity.get() is not Verbosity.VERBOSE:  # the least of each kind, and the choice
        few = {found.choice, *{one.kind: number for number, one in reversed(shown)}.values()}
        shown = [one for one in shown if one[0] in few]
    if found.advice:
        say()
        rows: list[list[Styled]] = []
        for number, one in shown:
            room = "-" if one.margin is None else shown_size(one.size + one.margin.more, one.unit)
            rows.append([str(number), one.words, *_figures_of(one), room])
        print_table([*numbers("#"), Column("change", shrink=True), *numbers(*_FIGURES, "works\nup to")], rows)
        if more := len(found.advice) - len(shown):
            say(f"... and {more} more that are larger (-v)", "dim")
    for number, cost in ((number, cost) for number, one in shown for cost in one.costs):
        say(joined([(f"#{number} makes worse:", "red"), f" {cost}"]), indent=4)
    unmet: dict[str, list[str]] = {}
    for kind in (kind for kind in found.kinds if not kind.found):
        why = kind.why or ""
        if kind.nearest is not None:
            why = f"not enough; {kind.nearest}{kind.nearest.limit and f': {kind.nearest.limit}'}"
        unmet.setdefault(why, []).append(KIND_WORDS[kind.kind])
    for why, kinds in unmet.items():
        say(f"{', '.join(kinds).capitalize()}: {why}.", indent=4)
    if found.whose_figures:
        say(found.whose_figures, "dim")
    if command:
        say()
        say_command(*command)
    say_assumed(found.assumed)


def _conclude(found: AdviceDocument, *, written: bool) -> tuple[str, str] | None:
    """Say what to do, or what comes nearest or has to be done before; the command that does it, with its words."""
    if found.interrupted:
        say("Interrupted before all kinds were searched.")
    now, command = f"Now {found.candidate}: {_in_words(found.before)}.", None
    if found.met:
        say("That is met already: nothing has to change.", "bold")
        if found.unnoticed:
            say(f"{found.unnoticed}.")
            command = "To have faults noticed sooner, add", "--want 'delay 1 s'"
    elif not found.advice:
        nothing = "Nothing that was searched so far is enough" if found.interrupted else "Nothing is enough"
        if found.nearest is not None:
            say(f"{nothing}; {found.nearest}.", "bold")
        elif found.first:
            say(f"No change helps: {found.first}.", "bold")
            command = "These steps as a program:", "sqrp check WORKSPACE TASK --program FILE"
        elif found.kinds:
            say(f"{nothing}.", "bold")
    else:
        one = found.advice[found.choice - 1]
        judged = " with --ways first" if found.ways == "first" else ""
        cost = "What gets worse is below." if one.worse else f"No task gets worse{judged}."
        say(f"{one.words[0].upper()}{one.words[1:]}.", "bold")
        now = f"Then {found.candidate}: {_in_words(one, found.before)}. {cost}"
        now += f" No patch: {one.unwritten}." if one.unwritten else ""
        if one.patch and not written:
            command = "To have it, add", f"--apply {found.choice}"
    say(now)
    if found.best is not None and not found.met:
        already = f"As `rank` and `score` do it, it meets that already: {_in_words(found.best)}."
        say(f"{already} The rest is for --ways first, a motion that is planned without a look at the cameras.")
    return command


def _in_words(found: AdvisedFigures, before: AdvisedFigures | None = None) -> str:
    """The figures of a candidate, with those before where they differ."""
    if found.time is None:
        return "cannot be done"
    said = []
    for name in ("q_eoi", "q_avg", "time", "delay_worst"):
        new, old = (
            shown_figure(name, inf if name == "delay_worst" and one.unseen else getattr(one, name))
            for one in (found, before or found)
        )
        words = "a fault may never be noticed" if new == "never" else f"{FIGURE_NAMES[name]} {new}"
        said += [words + (f" (now {old})" if old != new else "")] if new != "-" else []
    return ", ".join(said)


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
    """Where to put cameras, what is proven, the tables, and details. written: whether a patch was written."""
    said = placement_in_words(found)
    if said.unmet:
        say(said.unmet, style="red")
        for unseen in found.unseen[:MOST_UNSEEN]:
            say(f"  {unseen.candidate}: {unseen}", indent=4)
        if len(found.unseen) > MOST_UNSEEN:
            say(f"  and {len(found.unseen) - MOST_UNSEEN} more, see --json", indent=4)
    elif said.put:
        say(said.put, "bold")
    say(found.proof)
    if found.survive:
        say("Counted is only what is still seen if any one of the cameras fails.")
        _print_price(found)
    say(joined(["\n", (", ".join(found.tasks), "bold"), f" in {found.workspace}"]))
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
    several = len(found.tasks) > 1
    print_infeasible((f"{one.task}: " * several + one.candidate, {}, one.reason) for one in found.infeasible)
    say()
    for words in filter(None, (said.moves, said.other_ways)):
        say(words)
    verbose = verbosity.get() is Verbosity.VERBOSE
    compared = f"Compared were {said.comparison}."
    say(" ".join([compared, said.scope] if verbose else filter(None, [said.scope, "-v says more."])), "dim")
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
    case = "worst case" if found.by == "least" else "mean"
    costs += [f"{100 * worse:.1f} points of the {case}"] if worse > 5e-4 else []
    if costs:
        have = f"{count_in_words(without.cameras)} would do ({case} {100 * without.objective:.1f} %)"
        say(f"That costs {' and '.join(costs)}: if none could fail, {have}.")
    else:
        say(f"That costs nothing: if none could fail, it would be {count_in_words(without.cameras)}, too.")


def print_scorecard(findings: Scorecard) -> None:
    """Whether all tasks pass, and why not; the table, failing tasks first; of two versions what differs."""
    if findings.document == "diff":
        print_difference(findings)
        return
    if findings.results or findings.interrupted:
        say(passed_in_words(findings), "bold")
    for score in findings.results:
        for reason in score.reasons:
            named = score.task is None or reason.startswith(score.task)
            where = score.workspace if named else score.named
            say(joined([(score.status, _STYLES[score.status]), f" {where}: {reason}"]), indent=2)
    if findings.results:
        rows: list[list[Styled]] = []
        for one in sorted(findings.results, key=lambda one: list(_STYLES).index(one.status), reverse=True):
            best = [""] * 5 if one.best is None else [one.best.name, *_figures_of(one.best)]
            rows.append([one.workspace, one.task or "", *best, styled(one.status, _STYLES[one.status])])
        columns = [Column("workspace", shrink=True), Column("task", shrink=True), Column("best", shrink=True)]
        say()
        print_table([*columns, *numbers(*_FIGURES), Column("")], rows)
    for assumed in dict.fromkeys(one.assumed for one in findings.results if one.assumed):
        about = "; ".join(one.named for one in findings.results if one.assumed == assumed)
        say(f"\nFor the times of {about}: {assumed}.")
    # Improvements, new and vanished tasks, and what changed where nothing got worse.
    marks: list[tuple[str, str, str]] = []
    for one in findings.results:
        if one.baseline is not None:
            better = [way for way in one.baseline.ways if not way.worse]
            marks += [("improved", "green", f"{one.named} for {way}") for way in better]
            marks += [("new", "yellow", f"{one.named} is not in the baseline")] * (one.baseline.verdict == "new")
            gone = [f"{one.named} for {way}: there is no such way any more" for way in one.baseline.gone]
            marks += [("gone", "yellow", said) for said in gone]
    marks += [("renamed", "yellow", f"{name} is {was} of the baseline") for name, was in findings.renamed.items()]
    style = "yellow" if findings.may_vanish else "red"
    vanished = [f"{gone.workspace}, {gone.task} is only in the baseline" for gone in findings.vanished]
    for word, style, said in [*marks, *(("vanished", style, said) for said in vanished)]:
        say(joined(["\n", (word, style), f" {said}"]))
    missing = findings.vanished or any(one.baseline and one.baseline.gone for one in findings.results)
    if missing and not findings.may_vanish:
        say("\nWhat is gone fails: --allow-missing lets it pass, --save-baseline makes a new baseline.")
    worse = {result.workspace for result in findings.results if result.baseline and result.baseline.ways}
    for workspace, changes in findings.changes.items():
        if changes and workspace not in worse:
            say(joined(["\n", ("changed", "dim"), f" {workspace}, with no effect: {listed(changes)}"]))


def print_difference(findings: Scorecard) -> None:
    """What differs between two versions, and the effect on every way of doing a task."""
    if findings.interrupted:
        say("Interrupted before the two versions could be compared.")
        return
    changes = [change for changes in findings.changes.values() for change in changes]
    ways = [(result, change) for result in findings.results if result.baseline for change in result.baseline.ways]
    worse = sum(way.worse for _, way in ways)
    counts = ((worse, "worse"), (len(ways) - worse, "better"))
    said = " and ".join(f"{n} candidate{'s' * (n != 1)} get{'s' * (n == 1)} {word}" for n, word in counts if n)
    say(f"{said}:" if ways else "No task gets better or worse.", "bold")
    for result, way in ways:
        mixed = any(not shift.worse for shift in way.shifts)
        mark = ("better", "green") if not way.worse else ("mixed ", "yellow") if mixed else ("worse ", "red")
        say(joined([mark, f"  {result.task} for {way}"]), indent=8)
    new = [one.task for one in findings.results if one.baseline and one.baseline.verdict == "new"]
    gone = [f"{one.task} for {name}" for one in findings.results if one.baseline for name in one.baseline.gone]
    gone += [one.task for one in findings.vanished]
    for word, what in [*(("new   ", task) for task in new), *(("gone  ", task) for task in gone)]:
        say(joined([(word, "yellow"), f"  {what}"]), indent=8)
    say("\nWhat differs in the workspace:" if changes else "\nNothing that matters differs in the workspace.")
    for change in changes:
        say(f"  {change}", indent=4)
    if changes:
        say("Compared are the best ways of both; what changes by less than --allow is left out.", "dim")


def passed_in_words(findings: Scorecard) -> str:
    """The sentence that begins the output: how many tasks pass."""
    total, passed = len(findings.results) + (findings.unfinished or 0), findings.count("passed")
    tasks, gone = f"{total} task{'s' if total != 1 else ''}", 0 if findings.may_vanish else len(findings.vanished)
    if passed == total and not gone:
        return "The task passes." if total == 1 else f"All {tasks} pass."
    statuses = ("failed", "failed"), ("error", "could not be scored"), ("passed", "passed")
    counts = [f"{findings.count(status)} {words}" for status, words in statuses if findings.count(status)]
    counts += [f"{gone} vanished"] if gone else []
    if counts == ["1 failed"] and total == 1:
        return "The task fails."
    done = f"{len(findings.results)} of {tasks} {'was' if 1 in (len(findings.results), total) else 'were'} finished"
    return ", ".join([f"Interrupted: {done}" if findings.interrupted else f"Of {tasks}", *counts]) + "."


def print_variants(found: Sweep) -> None:
    """The best variant and the command that applies it, then the table, the best first."""
    if found.patch is None:
        say("None is better than the workspace as it is.\n", "bold")
    else:
        values = ", ".join(f"{path} = {value}" for path, value in found.best.items())
        among = "" if found.equals == 1 else f" Of {found.equals} that are as good it has the most room around it."
        say(f"Take {values}.{among} To have it:", "bold")
        say_line(f"  patch {shlex.quote(found.file)} < {shlex.quote(found.patch)}\n")
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
        chosen, able = [one.values.get(path, "as it is") for path in paths], f"{one.feasible} of {one.choices}"
        status = styled("error", "bold red") if errors else passed
        rows.append([str(one.rank), *chosen, *_figures_of(one), able, status])
    print_table(columns, rows)
    for reason, ranks in reasons.items():
        say(f"{', '.join(f'#{rank}' for rank in ranks)}: {reason}")
    if len(found.variants) > len(shown):
        say(styled(f"{len(found.variants) - len(shown)} more are in the document of --json.", "dim"))
    say(styled("Figures are means over the choices of objects, of every task, that can be done.", "dim"))


def column_titles(paths: list[str]) -> list[str]:
    """Titles: the end of each path under the name of its owner, such as a camera; whole paths if two look alike."""
    titles = []
    for words in (path.split(".") for path in paths):
        named = words[0] in ("cameras", "objects", "detectors")
        owner, rest = (words[1:2], words[2:]) if named else (words[:1], words[1:])
        titles.append("\n".join([*owner, ".".join(rest[-2:])] if rest else owner))
    return titles if len(set(titles)) == len(titles) else paths
