"""From the text of a task to its candidates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from itertools import combinations_with_replacement, pairwise, product
from math import comb, prod

from sqrp_cli.cell.recordings import EPISODE
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Problem, bad_input, bad_option, counted, expected_names
from sqrp_cli.files import units
from sqrp_cli.files.units import expected_quantity, read_quantity
from sqrp_cli.logic.conditions import rules_out
from sqrp_cli.logic.literal import Atom
from sqrp_cli.skill.settings import MotionParameter, MotionValue
from sqrp_cli.skill.skill import JointMove, Skill, named_skill
from sqrp_cli.task.candidate import Candidate as Candidate
from sqrp_cli.task.candidate import Task as Task
from sqrp_cli.task.candidate import split_steps, whole_task

MAX_CANDIDATES = 100_000  # A task with more candidates than this is refused
MOST_OF_UNIT = 3  # Most letters of an unknown word that may be meant as a unit


def read_task(text: str, workspace: Workspace, facts: frozenset[Atom] | None = None) -> Task:
    """The candidates of a task such as `pickup red screw`, `place g1 tray` or `pickup peg1 then insert peg1 socket`.

    facts: that hold before it, by default those of the workspace; of a task of several steps, they decide which
    choices go together. Raises InputError if nothing matches.
    """
    parts = split_steps(text)
    recorded = [part for part in parts if part.split()[:1] and part.split()[0] in workspace.recordings]
    if recorded and len(parts) > 1:
        message = f"`{recorded[0]}` is a recording, which is a task of its own and no step of another"
        raise bad_option(message, mend=f"ask about it alone: `{recorded[0]}`")
    steps = [_read_step(part, workspace) for part in parts]
    return steps[0] if len(steps) == 1 else whole_task(text, steps, workspace, facts)


def _read_step(text: str, workspace: Workspace) -> Task:
    """A task of one step, such as `pickup object=g1 speed=0.5`.

    The first word is a skill, or a recording, whose parameter is the number of its episode.
    `name=value` sets a parameter, and `name=a,b` tries several values or objects for it.
    Every other word is the name, the type, the colour or an attribute of an object; with several parameters, the words
    are for the parameters in order, each for one. Raises InputError if nothing matches.
    """
    words = text.split()
    if not words:
        skills = ", ".join(f"`{name}`" for name in (*workspace.skills, *workspace.recordings))
        raise bad_input("empty-task", f"the task is empty; expected a skill ({skills}) and what to do it with")
    if (recorded := workspace.recordings.get(words[0])) is not None:
        from sqrp_cli.motion.recorded_motion import RecordedMotions  # few workspaces have any

        motions = RecordedMotions(recorded, workspace.objects)
        episodes = MotionParameter(EPISODE, tuple(map(float, motions.recording.numbers)))
        skill: Skill | None = replace(recorded.skill, motion_parameters=(episodes,), recorded=motions)
    else:
        skill = named_skill(words[0], workspace.skills)
    if skill is None:
        known = expected_names(words[0], [*workspace.skills, *workspace.recordings])
        place = workspace.places.get("skills", workspace.whole_file)
        raise bad_input("unknown-skill", f"there is no skill `{words[0]}` under `skills`; {known}", place)
    names = [*(p.name for p in skill.action.parameters), *(p.name for p in skill.motion_parameters)]
    moves = {f"{primitive.name}.solution" for primitive in skill.primitives if isinstance(primitive, JointMove)}
    settings, branch = dict[str, str](), dict[str, MotionValue]()
    for name, value in (word.split("=", 1) for word in words[1:] if "=" in word):
        if name in moves:  # a solution of inverse kinematics by its number, such as `a1.solution=3`
            if not value.isdecimal():
                raise bad_input("wrong-value", f"`{name}={value}`: expected the number of a solution, from 0 on")
            branch[name] = float(value)
            continue
        if name not in names:
            message = f"skill `{skill.name}` has no parameter `{name}`; {expected_names(name, names)}"
            raise bad_input("unknown-parameter", message)
        if name in settings:
            raise bad_input("repeated-parameter", f"`{name}` is set twice: {settings[name]} and {value}")
        settings[name] = value
    try:
        choices = _object_choices(skill, workspace, settings, [word for word in words[1:] if "=" not in word])
    except InputError as error:
        hint = _unit_hint(words, skill, workspace)
        raise InputError(*(replace(problem, mend=problem.mend or hint) for problem in error.problems)) from error
    motion = {p.name: _motion_values(p, settings.get(p.name)) for p in skill.motion_parameters}
    counts = [*map(len, choices), *map(len, motion.values())]
    if prod(counts) > MAX_CANDIDATES:
        most = max(range(len(counts)), key=counts.__getitem__)
        message = f"the task has {counted(prod(counts))} candidates, the limit is {MAX_CANDIDATES:,}"
        message += f"; name fewer objects or values, most of all for `{names[most]}` of `{skill.name}`"
        raise bad_input("too-many-candidates", f"{message}, with {counts[most]:,}")
    bindings = [dict(zip(names, objects, strict=False)) for objects in product(*choices)]
    # One that can never be, such as a part on itself, is a candidate only where nothing else is asked for.
    possible = [one for one in bindings if not rules_out(skill.action.precondition, one)]
    found: list[Candidate] = []
    for binding, values in product(possible or bindings, product(*motion.values())):
        bound = dict(zip(motion, values, strict=True))
        shown = in_words(skill, {name: value for name, value in bound.items() if len(motion[name]) > 1})
        own = [*binding.values(), *(f"{name}={value.replace(' ', '')}" for name, value in shown.items())]
        name = " ".join(own) or skill.name
        if skill.recorded:
            one = bound[EPISODE]
            name = f"{EPISODE} {one if isinstance(one, str) else f'{one:.10g}'}"
        found.append(Candidate(skill, binding, bound, branch=branch, name=name))
    return Task(text, skill, tuple(found))


def longer_tasks(text: str, workspace: Workspace) -> Iterator[str]:
    """The texts of a task that goes on as typed with one more word, as a shell proposes them.

    text: of the task; its last word, after the last blank, may be unfinished.
    """
    before = text[: text.rfind(" ") + 1]
    words = before.split()
    if "then" in words:
        words = words[len(words) - words[::-1].index("then") :]
    skill = named_skill(words[0], workspace.skills) if words else None
    following = [] if words else list(workspace.skills)  # not every one leads to a candidate
    if skill is not None:
        types = [parameter.type for parameter in skill.action.parameters]
        objects = workspace.objects.values()
        usable = [obj for obj in objects if any(skill.domain.fits(obj.types, one) for one in types)]
        described = sorted({word for obj in usable for word in _words_for(obj)} - {obj.name.lower() for obj in usable})
        following = [word for word in (*(obj.name for obj in usable), *described) if word not in words]
        set_already = {word.partition("=")[0] for word in words}
        for parameter in (one for one in skill.motion_parameters if one.name not in set_already):
            name = parameter.name
            values = [in_words(skill, {name: value})[name].replace(" ", "") for value in parameter.values]
            following += [f"{name}={value}" for value in values or [""]]
        following.append("then")
    for word in following:
        longer = f"{before}{word}"
        with suppress(InputError):
            if word != "then" and not word.endswith("="):
                read_task(longer, workspace)
            yield longer


def example_task(workspace: Workspace) -> str:
    """A task of the workspace: an expected one, a recording, or a skill with all that it can take; empty if none."""
    for text in (*(one.task for one in workspace.tasks), *workspace.recordings, *workspace.skills):
        with suppress(InputError):
            read_task(text, workspace)
            return text
    return ""


def impossible_tasks(workspace: Workspace) -> Iterator[Problem]:
    """The problems that `rank` would report for the expected tasks, and warnings about impossible expectations."""
    for index, expected in enumerate(workspace.tasks):
        path = f"tasks.{index}"
        try:
            task = read_task(expected.task, workspace)
        except InputError as error:
            place = workspace.places.get(f"{path}.{'steps' if expected.steps else 'task'}")
            mend = "name what there is, or delete this line of `tasks`"
            yield from (replace(one, place=place, mend=one.mend or mend) for one in error.problems)
            continue
        usable = dict.fromkeys(name for candidate in task.candidates for name in candidate.binding.values())
        winner = expected.winner
        if winner is not None and winner not in usable:
            expected_winner = expected_names(winner, usable)
            message = f"`{path}.winner`: no candidate of `{task.text}` uses `{winner}`; {expected_winner}"
            mend = "name an object that the task can use, or correct `task`"
            place = workspace.places.get(f"{path}.winner")
            yield Problem("impossible-winner", message, place, severity="warning", mend=mend)
        # Expectations of the best candidate of a task that is expected to be infeasible.
        names = [field.name for field in fields(expected) if field.name not in ("task", "steps", "feasible")]
        stated = [name for name in names if getattr(expected, name) is not None]
        if expected.feasible is False and stated:
            keys = ", ".join(f"`{name}`" for name in stated)
            message = (
                f"`{path}`: {keys} expected of the best candidate, but `feasible: false` expects that there is none"
            )
            place = workspace.places.get(f"{path}.{stated[0]}")
            mend = f"remove `feasible: false`, or {keys}"
            yield Problem("contradictory-expectations", message, place, severity="warning", mend=mend)


def in_words(skill: Skill, parameters: Mapping[str, MotionValue]) -> dict[str, str]:
    """Values of a skill's parameters as names and tables show them: lengths in mm, angles in deg."""
    dimensions = {p.name: {kind.dimension for kind in p.kinds} for p in skill.motion_parameters}

    said: dict[str, str] = {}
    for name, value in parameters.items():
        said[name] = value if isinstance(value, str) else f"{value:.6g}"
        for dimension, unit in ((units.LENGTH, "mm"), (units.ANGLE, "deg")):
            if dimensions.get(name) == {dimension} and value and not isinstance(value, str):
                said[name] = f"{value / dimension.units[unit]:.6g} {unit}"
    return said


def _unit_hint(words: Sequence[str], skill: Skill, workspace: Workspace) -> str | None:
    """A remedy for a task with a blank between a number and its unit, or before the number."""
    known = {word for obj in workspace.objects.values() for word in _words_for(obj)}
    kinds = {parameter.name: parameter.kinds for parameter in skill.motion_parameters}
    for setting, word in pairwise(words):
        name, _, values = setting.partition("=")
        value = values.rpartition(",")[2]
        dimensions = [kind.dimension for kind in kinds.get(name, ()) if kind.dimension is not None]
        if "=" in word or not dimensions or word.lower() in known:
            continue
        quantity = read_quantity(f"{value} {word}")
        if quantity is not None and quantity.dimension in (None, *dimensions):
            return f"write a value and its unit without a blank: `{setting}{word}`"
        # Units are short: a longer word after a number is more likely a misspelt object.
        if quantity is not None or (read_quantity(value) is not None and len(word) <= MOST_OF_UNIT):
            expected = expected_quantity(*dict.fromkeys(dimensions))
            return f"if `{word}` is meant as a unit: `{name}` is {expected}, written without a blank"
    return None


def _motion_values(parameter: MotionParameter, setting: str | None) -> tuple[MotionValue, ...]:
    """The values of a motion parameter that a task sets, such as `0.5,0.7`; of one that it does not, all."""
    if setting is None:
        return parameter.values
    values: dict[MotionValue, None] = {}
    for text in setting.split(","):
        value = read_quantity(text) or text
        for kind in parameter.kinds:
            if (complaint := kind.complaint(value)) is not None:
                raise bad_input(complaint[0], f"`{parameter.name}={setting}`: {complaint[1]}")
        plain = value if isinstance(value, str) else value.value
        if plain in values:
            raise bad_input("repeated-value", f"`{parameter.name}={setting}`: a value is given twice")
        values[plain] = None
    return tuple(values)


def _object_choices(
    skill: Skill, workspace: Workspace, settings: Mapping[str, str], filters: Sequence[str]
) -> list[list[str]]:
    """The possible objects of each parameter of the skill, in the order of the parameters."""
    parameters = skill.action.parameters
    fitting = {
        parameter.name: [
            name for name, obj in workspace.objects.items() if skill.domain.fits(obj.types, parameter.type)
        ]
        for parameter in parameters
    }
    for name, value in settings.items():
        stated = value.split(",") if name in fitting else []
        for index, one in enumerate(stated):
            if one not in fitting[name]:
                known = expected_names(one, fitting[name])
                raise bad_input("unknown-object", f"`{one}` cannot be the {name} of `{skill.name}`; {known}")
            if one in stated[:index]:
                raise bad_input("repeated-value", f"`{name}={value}`: `{one}` is named twice")
        fitting.update({name: stated} if stated else {})
    open_names = [parameter.name for parameter in parameters if parameter.name not in settings]
    if open_names and len(open_names) * comb(len(filters) + len(open_names) - 1, len(filters)) > MAX_CANDIDATES:
        words = f"{len(filters)} word{'s' * (len(filters) != 1)}"
        message = f"{words} may be meant for {len(open_names):,} parameters of `{skill.name}` in too many ways"
        raise bad_input("ambiguous-task", message, mend="say which parameter each is for: `name=object`")
    said = {name: _words_for(workspace.objects[name]) for names in fitting.values() for name in names}
    matched: list[list[str]] | None = None
    for groups in _splits([word.lower() for word in filters], len(open_names)):
        pairs = zip(open_names, groups, strict=True)
        chosen = [[one for one in fitting[name] if said[one].issuperset(words)] for name, words in pairs]
        if all(chosen):
            matched = chosen
            break
    if matched is None:
        used = set[str]().union(*said.values())
        unknown = next((word for word in filters if word.lower() not in used), None)
        if unknown is not None:
            listed = {*unknown.lower().split(",")}
            meant = next((one for one in fitting if listed <= {name.lower() for name in fitting[one]}), None)
            hint = expected_names(unknown, used) if meant is None else f"did you mean `{meant}={unknown}`?"
            message = f"no object that `{skill.name}` can use is called or described as `{unknown}`; {hint}"
            raise bad_input("no-match", message)
        usable = "; ".join(
            f"{name}: {', '.join(f'`{one}`' for one in able) or 'no object fits'}" for name, able in fitting.items()
        )
        wanted = " ".join(filters) or "anything"
        raise bad_input("no-match", f"nothing matches `{wanted}`; `{skill.name}` can use {usable}")
    for word in filters:
        if filters.count(word) > len(open_names):
            message = f"`{word}` is said {filters.count(word)} times; `{skill.name}` takes {len(open_names)} by words"
            raise bad_input("repeated-value", message)
    found = dict(zip(open_names, matched, strict=True))
    return [found.get(parameter.name, fitting[parameter.name]) for parameter in parameters]


def _splits(words: Sequence[str], count: int) -> Iterator[list[Sequence[str]]]:
    """Ways to assign words to parameters in order, those with the fewest parameters without a word first."""
    if count == 0:
        if not words:
            yield []
        return
    ways = [
        [words[start:end] for start, end in zip((0, *cuts), (*cuts, len(words)), strict=True)]
        for cuts in combinations_with_replacement(range(len(words) + 1), count - 1)
    ]
    yield from sorted(ways, key=lambda groups: sum(not group for group in groups))


def _words_for(obj: SceneObject) -> set[str]:
    words = {obj.name, obj.type, *obj.attributes, *([obj.color] if obj.color else [])}
    return {word.lower() for word in words}
