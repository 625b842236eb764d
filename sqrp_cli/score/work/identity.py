"""Keys of computations: digests of everything that a candidate's figures depend on."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import cache
from importlib import metadata, resources
from pathlib import Path

from sqrp_cli.cell.canonical_values import digest_of_values, with_skills
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.task.task import Candidate
from sqrp_cli.version import __version__

_LIBRARIES = ("numpy", "ruckig", "ompl", "eaik")
"""Libraries that figures depend on."""

_FILE_KEYS = frozenset({"urdf", "srdf", "mesh", "calibration", "hand_eye"})
"""Keys of a workspace file that name other files; the content of those counts, not their place."""


@cache
def program_digest() -> str:
    """Digest of the code and the libraries that compute: results of different ones are never mixed."""
    hashed = hashlib.sha256(__version__.encode())
    hashed.update(code_digest(Path(str(resources.files("sqrp_cli")))).encode())
    for library in _LIBRARIES:
        try:
            version = metadata.version(library)
        except metadata.PackageNotFoundError:
            version = "none"
        hashed.update(f"{library} {version}\n".encode())
    return hashed.hexdigest()


def code_digest(root: Path) -> str:
    """Digest of all code and grammars of a package, however its folders are named.

    Code that only prints counts too: a list of what figures depend on would go stale.
    """
    hashed = hashlib.sha256()
    for file in sorted(path for path in root.rglob("*") if path.suffix == ".py"):
        hashed.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return hashed.hexdigest()


def content_digest(workspace: Workspace, *skills: str) -> str:
    """Digest of everything in a workspace that the figures of candidates of some skills depend on.

    That is what was understood of it, see `cell.canonical_values`, except for other skills.
    """
    return digest_of_values(with_skills(workspace.canonical_values, skills))


def says_something(path: str) -> bool:
    """Whether a value of a workspace file matters by itself.

    It does not if it belongs to a task, or names a file: then the file's content matters.
    """
    lists = ("tasks.", "skills.", "robot.package_roots.")
    return not path.startswith(lists) and path.rpartition(".")[-1] not in _FILE_KEYS


def candidate_key(content: str, candidate: Candidate, sampling: Sampling, seed: int, *, coverage: bool) -> str:
    """The key of a candidate's result; content: see `content_digest`. coverage: whether it has its `Coverage`, too."""
    parameters = list(candidate.parameters.items())
    vias = {name: via.tolist() for name, via in candidate.vias.items()}
    how = [type(sampling).__name__, asdict(sampling), seed, coverage]
    return digest_of([program_digest(), content, candidate.skill.name, parameters, vias, *how])


def digest_of(value: object) -> str:
    """Digest of a JSON value."""
    return hashlib.sha256(json.dumps(value, ensure_ascii=True).encode()).hexdigest()
