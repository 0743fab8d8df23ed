"""Builds the extension module with CMake, which also installs the package's sources."""

import pathlib
import re
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = pathlib.Path(__file__).resolve().parent
VERSION = re.search(r"project\(slf VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]


class BuildWithCMake(build_ext):
    def build_extension(self, ext):
        build = pathlib.Path(self.build_temp).resolve()
        place = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve().parent.parent
        for command in (
                ["cmake", "-S", ROOT, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                 "-DCMAKE_UNITY_BUILD=ON", "-DSLF_BUILD_TESTS=OFF", "-DBUILD_SHARED_LIBS=OFF",
                 "-DSLF_PYTHON=ON", f"-DPython3_EXECUTABLE={sys.executable}",
                 f"-DSLF_PYTHON_DIR={place}"],
                ["cmake", "--build", build, "--target", "slf_python"],
                ["cmake", "--install", build, "--component", "python"]):
            subprocess.run(list(map(str, command)), check=True)
        (place / "slf" / "packages.txt").write_text(" ".join(needed(place / "slf")))


def needed(folder):
    """The Debian packages of the shared libraries that modules in a folder load; none elsewhere."""
    names = {"libcurl.so.4"}  # loaded at first use
    for module in folder.glob("*.so"):
        dump = subprocess.run(["objdump", "-p", module], capture_output=True, text=True).stdout
        names |= set(re.findall(r"NEEDED +(\S+)", dump))
    try:
        found = subprocess.run(["dpkg-query", "-S", *(f"*/{name}" for name in names)],
                               capture_output=True, text=True).stdout
    except OSError:
        return []
    return sorted(set(re.findall(r"^([^:\s]+):.*/lib/[^/]+-linux-[^/]+/[^/]+$", found, re.M)))


setup(version=VERSION, packages=["slf"], package_dir={"": "python"},
      package_data={"slf": ["py.typed", "*.js", "packages.txt"]},
      ext_modules=[Extension("slf._slf", sources=[])], cmdclass={"build_ext": BuildWithCMake})
