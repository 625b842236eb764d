"""Figures of the code: `python -m tests.structure [--names] [ANOTHER_CHECKOUT]`, whose figures stand before these."""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import combinations
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "sqrp_cli"
RECORD_FIELDS = {
    "target's box": "encloses",
    "fault's figures": "blind_longest",
    "camera": "latency",
    "camera's pose": "X_FC",
}
"""What should have few records, each with a field by which every record of it is known."""
LEAST_FIELDS = 5
"""Records of fewer fields may be alike by chance."""
LONG = 30
"""Lines of a function, without its docstring, that are many."""

ROOMS = {
    "foundations": ("errors geometry records document figures shapes trajectory shown version", 1_349),
    "files": ("files", 2_038),
    "robot": ("robot", 3_113),
    "camera": ("camera", 2_310),
    "cell": ("cell", 3_383),
    "logic": ("logic", 2_245),
    "skill, program, recording": ("skill program recording", 2_574),
    "task": ("task", 1_013),
    "motion": ("motion", 2_939),
    "sight": ("kernel sight", 1_262),
    "study": ("study", 4_346),
    "search": ("search", 4_237),
    "checks": ("checks", 1_328),
    "run": ("run", 6_811),
    "field": ("field ros", 2_844),
    "score": ("score", 2_290),
    "show": ("show", 4_745),
    "ask": ("ask cli __init__ __main__", 5_084),
    "studio": ("studio", 1_647),
    "starter, platform": ("starter platform", 2_334),
}
"""The rooms of the package: what is in each, the longest beginning of a path counts, and how many lines it may have.

A budget is lowered when its room shrinks, and raised only with a sentence why in the change that does so.
"""

Figure = tuple[int, list[str]]
"""How many, and which."""
Function = ast.FunctionDef | ast.AsyncFunctionDef
KINDS = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef, ast.Call, ast.Dict, ast.Import, ast.ImportFrom)
"""Of the nodes that figures are about."""


class SourceTree:
    """The source of a checkout, and figures of its structure."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.texts = {path: path.read_text(encoding="utf-8") for path in sorted((root / PACKAGE).rglob("*.py"))}
        self.trees = {path: ast.parse(text) for path, text in self.texts.items()}
        self.modules = {self.name(path): path for path in self.texts}
        walks = ((self.name(path), ast.walk(tree)) for path, tree in self.trees.items())
        self.found = [(module, node) for module, walk in walks for node in walk if isinstance(node, KINDS)]

    def name(self, path: Path) -> str:
        return ".".join(path.relative_to(self.root).with_suffix("").parts).removesuffix(".__init__")

    def nodes(self, *kinds: type[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
        yield from ((module, node) for module, node in self.found if isinstance(node, kinds))

    def classes(self) -> list[str]:
        return [node.name for _, node in self.nodes(ast.ClassDef) if isinstance(node, ast.ClassDef)]

    def figures(self) -> dict[str, Figure]:
        """What is counted, by title."""
        lines = {self.name(path): text.count("\n") for path, text in self.texts.items()}
        longest = max(lines, key=lambda name: lines[name])
        hits = [name for path, text in self.texts.items() for name in [self.name(path)] * text.count("dict[str, Any]")]
        found: dict[str, Figure] = {
            "files": (len(lines), []),
            "lines": (sum(lines.values()), []),
            "lines of tests": (sum(file.read_text().count("\n") for file in (self.root / "tests").rglob("*.py")), []),
            "longest file": (lines[longest], [longest]),
            "functions per 1,000 lines": (self._per_1000(ast.FunctionDef, ast.AsyncFunctionDef), []),
            "classes per 1,000 lines": (self._per_1000(ast.ClassDef), []),
            "files under 60 lines": counted(name for name, count in lines.items() if 1 < count < 60),
            "modules with one importer": counted(self.with_one_importer()),
            "dict[str, Any]": counted(hits),
        }
        for subject, field in RECORD_FIELDS.items():
            found[f"records of a {subject}"] = counted(self.records_with(field))
            found[f"modules that write a {subject}"] = counted(self.modules_that_write(field))
        found["types with q_eoi and q_avg"] = counted(self.records_with("q_eoi", "q_avg"))
        found["records of a cause"] = counted(self.records_with("cause"))
        found["pairs of records that share half of their fields"] = counted(self.alike())
        found["class names used twice"] = counted(name for name, count in Counter(self.classes()).items() if count > 1)
        found[f"functions over {LONG} lines"] = counted(self.long_functions())
        found["public functions that return bare tuples"] = counted(self.bare_tuples())
        return found

    def _per_1000(self, *kinds: type[ast.AST]) -> int:
        lines = sum(text.count("\n") for text in self.texts.values())
        return round(1000 * sum(1 for _ in self.nodes(*kinds)) / max(lines, 1))

    def rooms(self) -> dict[str, int]:
        """Lines of Python by room."""
        begins = {begin: room for room, (begins, _) in ROOMS.items() for begin in begins.split()}
        found = dict.fromkeys(ROOMS, 0)
        for path, text in self.texts.items():
            place = path.relative_to(self.root / PACKAGE).with_suffix("").as_posix()
            own = [begin for begin in begins if place == begin or place.startswith(f"{begin}/")]
            if own:
                found[begins[max(own, key=len)]] += text.count("\n")
        return found

    def records_with(self, *fields: str) -> list[str]:
        """The classes that declare the fields."""
        return [name for name, own in self.records() if own.issuperset(fields)]

    def records(self) -> Iterator[tuple[str, set[str]]]:
        """Every class with the fields that it declares itself."""
        for module, node in self.nodes(ast.ClassDef):
            if isinstance(node, ast.ClassDef):
                yield f"{module}.{node.name}", declared(node)

    def alike(self) -> Iterator[str]:
        """Pairs of classes of `LEAST_FIELDS` or more that have half of the fields of the larger one in common."""
        records = [(name, own) for name, own in self.records() if len(own) >= LEAST_FIELDS]
        for (first, own), (second, other) in combinations(records, 2):
            if 2 * len(own & other) >= max(len(own), len(other)):
                yield f"{first} and {second}"

    def modules_that_write(self, field: str) -> set[str]:
        """The modules that declare the field, or hand it over by name: all that another one like it might change."""
        found = {record.rpartition(".")[0] for record in self.records_with(field)}
        for module, node in self.nodes(ast.Call, ast.Dict):
            if isinstance(node, ast.Call) and field in [keyword.arg for keyword in node.keywords]:
                found.add(module)
            if isinstance(node, ast.Dict) and field in keys_with_values(node):
                found.add(module)
        return found

    def with_one_importer(self) -> Iterator[str]:
        importers: dict[str, set[str]] = {name: set() for name in self.modules}
        for module, node in self.nodes(ast.Import, ast.ImportFrom):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            else:
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in importers.keys() & names:
                importers[name].add(module)
        packages = {self.name(path) for path in self.texts if path.name == "__init__.py"}
        yield from (name for name, found in importers.items() if len(found - packages) == 1 and name not in packages)

    def long_functions(self) -> Iterator[str]:
        for module, node in self.nodes(ast.FunctionDef, ast.AsyncFunctionDef):
            if isinstance(node, Function):
                first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
                if (node.end_lineno or 0) - first.lineno + 1 + (node.body[0].lineno - node.lineno) > LONG:
                    yield f"{module}.{node.name}"

    def bare_tuples(self) -> Iterator[str]:
        for module, node in self.nodes(ast.FunctionDef, ast.AsyncFunctionDef):
            if isinstance(node, Function) and not node.name.startswith("_") and node.returns is not None:
                parts = [part for part in ast.unparse(node.returns).split(" | ") if part != "None"]
                if any(part.startswith("tuple[") and "," in part and ", ...]" not in part[-6:] for part in parts):
                    yield f"{module}.{node.name}"


def declared(node: ast.ClassDef) -> set[str]:
    """The fields of a class, as annotated in its body."""
    targets = (part.target for part in node.body if isinstance(part, ast.AnnAssign))
    return {target.id for target in targets if isinstance(target, ast.Name)}


def keys_with_values(node: ast.Dict) -> set[object]:
    """The keys of a dict that is written out, where the value is neither a constant nor a row of a table."""
    items = zip(node.keys, node.values, strict=True)
    rows = (ast.Constant, ast.Tuple)
    return {key.value for key, value in items if isinstance(key, ast.Constant) and not isinstance(value, rows)}


def counted(names: Iterable[str]) -> Figure:
    found = sorted(names)
    return len(found), found


def main(arguments: list[str]) -> None:
    """Print the figures and the rooms of this checkout, behind those of others that are named."""
    trees = [*(SourceTree(Path(one).resolve()) for one in arguments if one != "--names"), SourceTree(ROOT)]
    every, rooms = [tree.figures() for tree in trees], [tree.rooms() for tree in trees]
    for title, (_, names) in every[-1].items():
        print(f"{title:52}" + "".join(f"{figures[title][0]:>9}" for figures in every))
        if "--names" in arguments:
            print("".join(f"    {name}\n" for name in names), end="")
    print(f"\n{'room':52}{'lines':>{9 * len(trees)}}{'budget':>9}{'left':>9}")
    for room, (_, budget) in ROOMS.items():
        lines = [of[room] for of in rooms]
        print(f"{room:52}" + "".join(f"{count:>9}" for count in (*lines, budget, budget - lines[-1])))


if __name__ == "__main__":
    main(sys.argv[1:])
