"""Thumb-2 machine code, as `arm-none-eabi-objdump -d` lists it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field

# Each beside its opposite.
CONDITIONS = re.findall("..", "eqnecsccmiplvsvchilsgeltgtle")
BRANCHES = {"b", "bl", "cbz", "cbnz", *(f"b{condition}" for condition in CONDITIONS)}
OPERAND = re.compile(r"\{[^}]*\}|\[[^]]*\]!?|[^,\s][^,]*")
LINE = re.compile(r"\s*([0-9a-f]+):\t([^\t@;]*)(?:\t([^@;]*))?")
DATA = {".word": 4, ".short": 2, ".byte": 1}


class ImageError(RuntimeError):
    """The file is not one that can be analysed, or has no such function."""


@dataclass(frozen=True)
class Instruction:
    """One line of the disassembly."""

    address: int
    text: str
    mnemonic: str
    """Without width (.w), type (.f32) and the condition that an IT block gives it."""
    operands: tuple[str, ...]
    block: str = ""
    """Of an IT instruction: a t (then) or an e (else) for each instruction that it governs."""

    @property
    def target(self) -> int | None:
        """Where a direct branch or call goes."""
        if self.mnemonic in BRANCHES:
            return int(self.operands[-1].split()[0], 16)
        return None

    @property
    def _pops_pc(self) -> bool:
        several = self.mnemonic == "pop" or self.mnemonic.startswith("ldm")
        return several and "pc" in re.findall(r"\w+", self.operands[-1])

    @property
    def returns(self) -> bool:
        """Back to the caller: through lr, or by taking the pc from the stack."""
        if self._pops_pc:
            return self.mnemonic == "pop" or self.operands[0] == "sp!"
        if self.mnemonic == "ldr":
            return self.operands[:2] == ("pc", "[sp]") and len(self.operands) == 3
        return (self.mnemonic, self.operands) in (("bx", ("lr",)), ("mov", ("pc", "lr")))

    @property
    def indirect(self) -> bool:
        """A call or a jump to an address that only the running program knows."""
        jumps = self.mnemonic in ("bx", "blx") or self._pops_pc or self.operands[:1] == ("pc",)
        return jumps and not self.returns

    @property
    def ends(self) -> bool:
        """Whether the next instruction is never executed after this one."""
        stops = self.mnemonic in ("b", "udf", "tbb", "tbh")
        return stops or self.returns or (self.indirect and self.mnemonic != "blx")


@dataclass
class Listing:
    """Instructions and data of the executable sections."""

    code: dict[int, Instruction] = field(default_factory=dict)
    following: dict[int, int] = field(default_factory=dict)
    """Of an instruction's address, what comes next in memory."""
    data: dict[int, int] = field(default_factory=dict)
    """Literal pools and jump tables, byte by byte."""

    @classmethod
    def parse(cls, text: str) -> Listing:
        """Reads what `objdump -dz --no-show-raw-insn` prints."""
        listing = cls()
        last, block, condition = -1, "", 0
        for line in text.splitlines():
            match = LINE.match(line)
            if match is None:
                if line.endswith(">:"):
                    block = ""
                elif line.startswith("Disassembly of section"):
                    last = -1
                continue
            address, name, rest = int(match[1], 16), match[2].strip(), (match[3] or "").strip()
            if last >= 0:
                listing.following[last] = address
            last = address
            if name in DATA:
                number = int(rest, 16).to_bytes(DATA[name], "little")
                listing.data.update(enumerate(number, address))
                last = -1
                continue
            mnemonic, governed = name.split(".")[0], ""
            if block:
                # The condition is written into the mnemonic: popne, bxeq, ldmiale.
                mnemonic = mnemonic.removesuffix(CONDITIONS[condition ^ (block[0] == "e")])
                block = block[1:]
            elif re.fullmatch("it[te]{0,3}", mnemonic) and rest in CONDITIONS:
                block = governed = "t" + mnemonic[2:]
                condition = CONDITIONS.index(rest)
            listing.code[address] = Instruction(
                address, f"{name} {rest}".strip(), mnemonic, tuple(OPERAND.findall(rest)), governed
            )
        return listing

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
            f"no {command[0]}: on Debian, apt-get install binutils-arm-none-eabi"
        ) from None
    if done.returncode:
        raise ImageError(f"{command[0]}: {done.stderr.strip()}")
    return done.stdout


def demangle(names: Iterable[str]) -> list[str]:
    """Names as the source has them, without the hashes of Rust."""
    plain = run("arm-none-eabi-c++filt", text="\n".join(names)).splitlines()
    return [re.sub(r"\[[0-9a-f]{8,16}\]|::h[0-9a-f]{16}$", "", name) for name in plain]
