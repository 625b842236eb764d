"""The wheel of one platform: with the compiled kernel, which knows no version of Python. `make wheels` makes all."""

import os
import runpy
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

kernel = runpy.run_path("sqrp_cli/kernel/library.py")

PLATFORMS = {
    "manylinux2014_x86_64": ("x86_64-linux-gnu.2.17", "linux", "x86_64"),
    "manylinux2014_aarch64": ("aarch64-linux-gnu.2.17", "linux", "aarch64"),
    "macosx_11_0_arm64": ("aarch64-macos.11.0", "darwin", "arm64"),
}
"""The target of the compiler, and where it runs, for each platform's tag."""

TAG = os.environ.get("SQRP_WHEEL")
"""The platform to build for; None for this machine, whatever it is."""


class BuildKernel(build_py):
    """Put the library beside the sources; those of other sources or platforms go."""

    def run(self) -> None:
        super().run()
        folder = Path("." if self.editable_mode else self.build_lib, "sqrp_cli/kernel")
        target, *runs_on = PLATFORMS[TAG] if TAG else (None, os.uname().sysname.lower(), os.uname().machine)
        for old in folder.glob("kernel-*.so"):
            old.unlink()
        kernel["build"](folder / kernel["library_name"](*runs_on), target)


class PlatformWheel(bdist_wheel):
    """A wheel for every Python of one platform."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", TAG or super().get_tag()[2]


class PlatformDistribution(Distribution):
    """A distribution with compiled parts."""

    def has_ext_modules(self) -> bool:
        return True


setup(distclass=PlatformDistribution, cmdclass={"build_py": BuildKernel, "bdist_wheel": PlatformWheel})
