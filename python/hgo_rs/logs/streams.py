"""A log as bytes of UTF-8: files, gzip, standard input, and what is written in other encodings."""

from __future__ import annotations

import codecs
import contextlib
import gzip
import re
import shutil
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, cast

from hgo_rs.logs.table import DataError

STDIN = Path("-")
"""Standard input, in place of a file."""
START = 2**18
"""Bytes at the begin of a log by which it is told how it is written."""

_BOMS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_OTHER = {
    b"PK\x03\x04": "a zip archive, as .xlsx and .npz files are: give it its own suffix",
    b"PAR1": "Parquet: call it .parquet",
    b"\x89HDF": "HDF5: call it .h5",
    b"MATLAB": "a MATLAB file: call it .mat",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook: save it as CSV",
    b"ARROW1": "Feather: call it .feather",
    b"BZh": "packed by bzip2: unpack it",
    b"\xfd7zXZ": "packed by xz: unpack it",
    b"\x28\xb5\x2f\xfd": "packed by zstd: unpack it",
}
"""What a file that is no text begins with."""
_MARKUP = (
    (rb"<(?:html|!doctype|\?xml|table)\b", "HTML or XML: save it as CSV"),
    (rb"\{\s*\"|\[\s*[\[{]", "JSON: write it as CSV, for example by pandas.read_json(...).to_csv"),
)
"""How text begins that holds no lines of cells."""
_OTHERS = (
    *("cp1252", "cp1250", "cp1251", "koi8-r", "mac-roman", "cp850", "cp437"),
    *("shift_jis", "gbk", "euc-kr", "big5", "euc-jp"),
)
"""Encodings beside Unicode's, in the order of trial."""
_PACKED = b"\x1f\x8b"

_spool: list[IO[bytes]] = []
"""Standard input, kept in a file: it may be read again."""


def suffix_of(path: Path) -> str:
    """The suffix that says the format: .csv of log.csv.gz and of standard input."""
    if path == STDIN:
        return ".csv"
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix


def stem_of(path: Path) -> str:
    """The name of a log without its suffixes."""
    if path == STDIN:
        return "stdin"
    return Path(path.name.removesuffix(".gz")).stem


class Stream:
    """The bytes of a log, in UTF-8 and with the line ends of Unix or Windows.

    Attributes
    ----------
    remarks : tuple of str
        What was found out about the encoding.
    """

    def __init__(self, path: Path, file: IO[bytes], names: Sequence[str]) -> None:
        self._path, self._file = path, file
        start = file.read(START)
        self._refuse_other(start)
        self.encoding, self.remarks, skipped = _encoding(start, names)
        self._start = start[skipped:]
        self._decoder: codecs.IncrementalDecoder | None = None
        if self.encoding != "utf-8":
            self._decoder = codecs.getincrementaldecoder(self.encoding)(errors="replace")
        held = self._transcoded(self._start, not start)
        self._bare = b"\r" in held and b"\n" not in held
        self._start = self._ended(held)

    def read(self, size: int) -> bytes:
        """Up to about `size` bytes; none: the log has ended."""
        if self._start:
            start, self._start = self._start, b""
            return start
        while raw := self._file.read(size):
            if found := self._ended(self._transcoded(raw, False)):
                return found
        return self._ended(self._transcoded(b"", True))

    def _transcoded(self, raw: bytes, final: bool) -> bytes:
        return raw if self._decoder is None else self._decoder.decode(raw, final).encode()

    def _ended(self, held: bytes) -> bytes:
        return held.replace(b"\r", b"\n") if self._bare else held

    def _refuse_other(self, start: bytes) -> None:
        for magic, what in _OTHER.items():
            if start.startswith(magic):
                raise DataError(f"{self._path} is not text but {what}")
        for begin, what in _MARKUP:
            if re.match(rb"\s*(?:%b)" % begin, start, re.IGNORECASE):
                raise DataError(f"{self._path} holds {what}")


def _encoding(start: bytes, names: Sequence[str]) -> tuple[str, tuple[str, ...], int]:
    """How the text is written, a remark, and the length of its mark at the begin.

    Text that is not of Unicode is taken in the first encoding in which it holds the `names` that
    are asked for.
    """
    mark, named = next(((m, n) for m, n in _BOMS if start.startswith(m)), (b"", ""))
    body = start[len(mark) :]
    if not mark:  # what a logger had reserved when its power went
        body = body.rstrip(b"\0") or body
    nul = body.count(0)
    if named not in ("", "utf-8") and nul:
        return named, (f"read as {named[:6].upper()}",), len(mark)
    if not named and nul > len(body) // 4:
        odd = body[1::2].count(0)
        encoding = "utf-16-le" if odd > nul - odd else "utf-16-be"
        lines = body[: len(body) // 2 * 2].decode(encoding, errors="replace")
        if (min(odd, nul - odd) <= nul // 50 and lines.isascii()) or "\ufffd" not in lines:
            return encoding, (f"read as {encoding[:6].upper()}",), 0
        raise DataError("")
    if b"\0" in body[:1000]:
        raise DataError("")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(body)
    except UnicodeDecodeError:
        if (other := _in_which(body, names)) not in (None, "cp1252"):
            told = f"not UTF-8: read as {other}, in which it holds the names that are asked for"
            return str(other), (told,), len(mark)
        told = "not UTF-8: read as cp1252, as Windows writes it; save as UTF-8 if names are wrong"
        try:
            body.decode("cp1252")
        except UnicodeDecodeError:
            return "latin-1", (told.replace("cp1252, as Windows writes it", "latin-1"),), len(mark)
        return "cp1252", (told,), len(mark)
    return "utf-8", (), len(mark)


def _in_which(body: bytes, names: Sequence[str]) -> str | None:
    """The first encoding of `_OTHERS` in which the text holds all names, some of them not ASCII."""
    if not all(names) or all(name.isascii() for name in names):
        return None
    for encoding in _OTHERS:
        with contextlib.suppress(UnicodeError):
            text = codecs.getincrementaldecoder(encoding)().decode(body)
            if all(name in text for name in names):
                return encoding
    return None


@contextlib.contextmanager
def opened(path: Path, names: Sequence[str] = ()) -> Iterator[Stream]:
    """A log that is open for reading, unpacked; `names`: columns that are asked for.

    Raises
    ------
    DataError
        Bytes that are no text; a gzip file that is broken or cut off.
    """
    with contextlib.ExitStack() as stack:
        file: IO[bytes]
        if path == STDIN:
            file = _standard_input()
        else:
            file = stack.enter_context(path.open("rb"))
        packed = file.read(len(_PACKED)) == _PACKED
        file.seek(0)
        if packed:
            file = cast("IO[bytes]", stack.enter_context(gzip.GzipFile(fileobj=file)))
        try:
            try:
                stream = Stream(path, file, names)
            except DataError as error:
                told = f"{path} holds bytes that are no text; say its format by its suffix"
                raise error if str(error) else DataError(told) from None
            yield stream
        except EOFError:
            raise DataError(f"{path}: the packed log is cut off; pack it again") from None
        except (gzip.BadGzipFile, zlib.error) as error:
            raise DataError(f"{path} is not a readable gzip file: {error}") from error


def _standard_input() -> IO[bytes]:
    """Standard input as a file that can be read again, on disk."""
    if not _spool:
        kept = tempfile.TemporaryFile()  # noqa: SIM115  # it lives as long as the process
        copy: Callable[..., None] = shutil.copyfileobj
        copy(sys.stdin.buffer, kept, 2**20)
        _spool.append(kept)
    _spool[0].seek(0)
    return _spool[0]
