"""Files that are written whole or not at all: every file of this package is written by `replacing`.

The new content is written beside the file and takes its place when it is on the disk, so that a
write that fails (full disk, Ctrl-C, a crash) leaves the earlier file as it was.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A binary file to write to, which becomes `path` when the block ends without an exception.

    An earlier file keeps its mode, and a symbolic link its name. What is no regular file, such as
    `/dev/stdout`, is written to directly.

    Raises
    ------
    OSError
        The file cannot be written; the earlier one is as it was.
    """
    with together([path]) as (file,):
        yield file


@contextlib.contextmanager
def together(paths: Sequence[str | os.PathLike[str]]) -> Iterator[list[IO[bytes]]]:
    """As `replacing`, for several files: they take their places when all are on the disk."""
    with contextlib.ExitStack() as stack:
        files = [_Beside(path, stack) for path in paths]
        yield [beside.file for beside in files]
        for beside in files:
            beside.keep()
        placed: list[str] = []
        for beside in files:
            try:
                beside.place()
            except OSError as error:
                if placed:  # what is in its place stays there
                    told = f"{error.strerror}; written before it: {', '.join(placed)}"
                    raise OSError(error.errno, told, str(beside.path)) from error
                raise
            placed.append(str(beside.path))


class _Beside:
    """A file beside the one whose place it will take."""

    def __init__(self, path: str | os.PathLike[str], stack: contextlib.ExitStack) -> None:
        self.path = path
        try:
            self._mode: int | None = Path(path).stat().st_mode
        except FileNotFoundError:
            self._mode = None
        self._beside: Path | None = None
        if self._mode is not None and stat.S_ISDIR(self._mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if self._mode is not None and not stat.S_ISREG(self._mode):
            file: IO[bytes] = Path(path).open("wb")  # noqa: SIM115
            self.file = stack.enter_context(file)
            return
        self._target = Path(os.path.realpath(path))
        if self._mode is not None and not os.access(self._target, os.W_OK):
            # a rename would not ask
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        self._beside = self._target.with_name(f".hgo-{secrets.token_hex(8)}.tmp")
        stack.callback(self._remove)
        self.file = stack.enter_context(self._beside.open("xb"))

    def _remove(self) -> None:
        with contextlib.suppress(OSError):
            if self._beside is not None:
                self._beside.unlink()

    def keep(self) -> None:
        """All of it on the disk."""
        self.file.flush()
        if self._beside is not None:
            os.fsync(self.file.fileno())
            self.file.close()
            if self._mode is not None:
                self._beside.chmod(stat.S_IMODE(self._mode))

    def place(self) -> None:
        if self._beside is not None:
            self._beside.replace(self._target)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file whole or not at all; errors as of `replacing`."""
    with replacing(path) as file:
        file.write(content)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """As `write_bytes`, in UTF-8 with the line ends of `text`."""
    write_bytes(path, text.encode())
