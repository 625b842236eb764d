"""Settings of all tests: property tests draw the same examples in every run, and none of them is timed."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("sqrp", deadline=None, derandomize=True)
settings.load_profile("sqrp")
