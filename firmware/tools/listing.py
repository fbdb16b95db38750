"""A disassembly: instructions of any processor, their places, and the data between them."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field


class ImageError(RuntimeError):
    """The file is not one that can be analysed, or has no such function."""


@dataclass(frozen=True)
class Instruction:
    """One line of a disassembly; each processor says what its own instructions do."""

    address: int
    text: str
    mnemonic: str
    operands: tuple[str, ...]

    @property
    def target(self) -> int | None:
        """Where a direct branch or call goes."""
        raise NotImplementedError

    @property
    def calls(self) -> bool:
        """A call of a known address: it may come back to the next instruction."""
        raise NotImplementedError

    @property
    def returns(self) -> bool:
        """Back to the caller."""
        raise NotImplementedError

    @property
    def indirect(self) -> bool:
        """A call or a jump to an address that only the running program knows."""
        raise NotImplementedError

    @property
    def ends(self) -> bool:
        """Whether the next instruction is never executed after this one."""
        raise NotImplementedError


@dataclass
class Listing:
    """Instructions and data of the executable sections."""

    code: dict[int, Instruction] = field(default_factory=dict)
    following: dict[int, int] = field(default_factory=dict)
    """Of an instruction's address, what comes next in memory."""
    data: dict[int, int] = field(default_factory=dict)
    """Literal pools and jump tables, byte by byte."""

    def number(self, address: int, size: int = 4) -> int | None:
        """A little-endian number among the data."""
        found = [self.data.get(place) for place in range(address, address + size)]
        whole = [byte for byte in found if byte is not None]
        return int.from_bytes(whole, "little") if len(whole) == size else None


def run(*command: str, text: str | None = None) -> str:
    """What one of the binutils prints."""
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise ImageError(
            f"no {command[0]}: on Debian, apt-get install binutils-{command[0].rpartition('-')[0]}"
        ) from None
    if done.returncode:
        raise ImageError(f"{command[0]}: {done.stderr.strip()}")
    return done.stdout


def demangle(names: Iterable[str]) -> list[str]:
    """Names as the source has them, without the hashes of Rust."""
    plain = run("arm-none-eabi-c++filt", text="\n".join(names)).splitlines()
    return [re.sub(r"\[[0-9a-f]{8,16}\]|::h[0-9a-f]{16}$", "", name) for name in plain]
