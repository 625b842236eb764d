"""The files that `sqrp score` writes; loads nothing of the program, so that they can be checked first of all."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.platform.files import check_distinct, check_writable


@dataclass(frozen=True)
class Outputs:
    """Files to write."""

    junit: Path | None
    summary: Path | None
    baseline: Path | None
    report: Path | None

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them."""
        return tuple(path for path in (self.junit, self.summary, self.baseline, self.report) if path is not None)

    def check(self) -> None:
        """Raises InputError before anything is computed where one of them cannot be written, or two are the same."""
        options = ("--junit", "--summary", "--save-baseline", "--report")
        check_distinct(dict(zip(options, (self.junit, self.summary, self.baseline, self.report), strict=True)))
        for path in self.paths:
            check_writable(path)
        if self.report is not None:
            from sqrp_cli.report.pages.libraries import check_libraries

            check_libraries()
