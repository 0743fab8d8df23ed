"""The extension module. Private: the package slf gives it names, types and documentation."""

from typing import Any

def __getattr__(name: str) -> Any: ...
