"""What a Dask cluster is told to do.

Its scheduler imports what every task names, too, and works for nobody else meanwhile: nothing here loads the program
before a worker does it.
"""

from __future__ import annotations

from collections.abc import Mapping


async def prepare_worker() -> None:
    """Load the program, see `shipping.prepare`, beside whatever the worker does for others."""
    import asyncio  # every worker has it, and a run without a cluster need not load it

    await asyncio.to_thread(_prepare)


def _prepare() -> None:
    from sqrp_cli.scoring.work.shipping import prepare

    prepare()


def run_packed(job: bytes, program: str, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Do a job that travels as bytes, see `shipping.run_shipped`."""
    from sqrp_cli.scoring.work.shipping import run_shipped

    return run_shipped(job, program, contents)
