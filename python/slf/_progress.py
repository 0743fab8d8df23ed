"""Progress of long calls: a function, or a bar of tqdm."""

from __future__ import annotations

import contextlib
from typing import Any, Callable, Iterator

ProgressFunction = Callable[[int, int, int], Any]
Progress = None | bool | ProgressFunction
"""None or False: silent. True: a bar of tqdm, if it is installed. A function (done, total, skipped)
is called about ten times a second and at the end; if it returns False, the call stops and raises
slf.FailedError; if it raises, the call stops and raises that."""


@contextlib.contextmanager
def reporter(progress: Progress, title: str) -> Iterator[ProgressFunction | None]:
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        yield progress
        return
    try:
        from tqdm.auto import tqdm  # type: ignore[import]
    except ImportError:
        yield None
        return
    with tqdm(desc=title, unit_scale=True) as bar:
        def show(done: int, total: int, skipped: int) -> None:
            bar.total = total
            bar.initial = skipped
            bar.update(done - bar.n)

        yield show
