"""Exceptions of slf."""

from __future__ import annotations


class Error(Exception):
    """Why a call of slf failed.

    code: the kind of failure, one of slf's exit codes: 1 usage, 2 io, 3 bad_file, 4 failed,
        5 unsupported.
    path: the file or address that the call was about, or None.
    message: the text, which names the file, the place in it, what was expected and what was found.
    """

    code: int = 4

    def __init__(self, message: str, path: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.path = path

    def __str__(self) -> str:
        return self.message

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return type(self), (self.message, self.path)


class UsageError(Error, ValueError):
    """An argument is wrong or contradicts another."""

    code = 1


class IoError(Error, OSError):
    """The operating system refused: no permission, disk full; or a server did not answer."""

    code = 2


class NotFoundError(IoError, FileNotFoundError):
    """The file does not exist."""


class BadFileError(Error, ValueError):
    """A file is damaged, truncated, or not what it claims to be."""

    code = 3


class FailedError(Error, RuntimeError):
    """A correct request could not be completed."""


class OutOfMemoryError(Error, MemoryError):
    """There is not enough memory."""


class UnsupportedError(Error, NotImplementedError):
    """The request is valid, but this version of slf cannot do it."""

    code = 5


class BusyError(FailedError):
    """Another process is writing the file."""


_CLASSES = {"usage": UsageError, "io": IoError, "not_found": NotFoundError,
            "bad_file": BadFileError, "busy": BusyError, "out_of_memory": OutOfMemoryError,
            "unsupported": UnsupportedError}


def error_of(code: str, message: str, path: str | None) -> Error:
    """The exception for an error of the library."""
    return _CLASSES.get(code, FailedError)(message, path)
