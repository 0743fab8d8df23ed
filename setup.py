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


setup(version=VERSION, packages=["slf"], package_dir={"": "python"},
      package_data={"slf": ["py.typed", "*.pyi"]},
      ext_modules=[Extension("slf._slf", sources=[])], cmdclass={"build_ext": BuildWithCMake})
