"""The page of the studio: the parts that all pages share, and what moves things."""

from __future__ import annotations

from importlib import resources

from sqrp_cli.report.pages.assembly import assembled

SCRIPTS = ("gizmo", "fields", "runs", "studio")
"""Its own scripts, each after those that it needs."""


def studio_page(title: str, socket: str) -> str:
    """The text of the page. socket: where its scripts may connect to."""
    return assembled(
        title,
        "\n".join(_asset(f"{name}.js") for name in SCRIPTS),
        data={},
        style=_asset("studio.css"),
        further=_asset("studio.html"),
        policy=f"; connect-src {socket}; img-src data:; base-uri 'none'; form-action 'none'",
    )


def _asset(name: str) -> str:
    return resources.files("sqrp_cli.studio").joinpath("browser", name).read_text(encoding="utf-8")
