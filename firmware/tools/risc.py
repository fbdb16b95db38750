"""A64 and RISC-V machine code, as `objdump -d` of their binutils lists it, and its stack.

Compilers of both move the stack pointer by constants alone, once down and once up: the depth of the
stack is all that a walk has to know. Anything else is `Unproved`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from listing import Instruction, Listing
from stack import State, Walk

LINE = re.compile(r"\s*([0-9a-f]+):\t(\S+)(?:\t(.*))?$")
COMMENT = re.compile(r"\s(?:#|//)\s")
OPERAND = re.compile(r"\[[^]]*\]!?|\{[^}]*\}|[^,\s][^,]*")
# They may name the stack pointer first and do not write it.
A64_READS = re.compile(r"st|cmp|cmn|tst|prfm")
BRANCH = re.compile(r"b(eq|ne|lt|ge|gt|le)u?z?$")
STORE = re.compile(r"f?s[bhwdq]$")


@dataclass(frozen=True)
class A64(Instruction):
    """An instruction of AArch64."""

    @property
    def target(self) -> int | None:
        direct = self.mnemonic in ("b", "bl", "cbz", "cbnz", "tbz", "tbnz")
        if direct or self.mnemonic.startswith("b."):
            return int(self.operands[-1].split()[0], 16)
        return None

    @property
    def calls(self) -> bool:
        return self.mnemonic == "bl"

    @property
    def returns(self) -> bool:
        return self.mnemonic == "ret" and self.operands in ((), ("x30",))

    @property
    def indirect(self) -> bool:
        return self.mnemonic in ("br", "blr", "ret") and not self.returns

    @property
    def ends(self) -> bool:
        return self.mnemonic in ("b", "br", "ret", "udf", "brk")

    @property
    def moves(self) -> int | None:
        """By how many bytes the stack grows; None: by an unknown number."""
        for index, operand in enumerate(self.operands):
            if not operand.startswith("[sp"):
                continue
            after = self.operands[index + 1 :]
            written = re.fullmatch(r"\[sp, #(-?\d+)\]!", operand)
            if written or after:
                number = re.fullmatch(r"#(-?\d+)", after[0]) if after else written
                return -int(number[1]) if number else None
            return None if operand.startswith("[sp, #-") else 0  # writes below it
        if self.operands[:1] != ("sp",) or A64_READS.match(self.mnemonic):
            return 0
        number = re.fullmatch(r"sp, #(0x[0-9a-f]+)(, lsl #12)?", ", ".join(self.operands[1:]))
        if number is None or self.mnemonic not in ("add", "sub"):
            return None
        amount = int(number[1], 16) << (12 if number[2] else 0)
        return amount if self.mnemonic == "sub" else -amount


@dataclass(frozen=True)
class RiscV(Instruction):
    """An instruction of RISC-V. A call or jump through a register has a target where the
    instruction before it puts that address into the register."""

    goes: int | None

    @property
    def target(self) -> int | None:
        return self.goes

    @property
    def calls(self) -> bool:
        return self.mnemonic in ("jal", "jalr") and self.goes is not None

    @property
    def returns(self) -> bool:
        return (self.mnemonic, self.operands) in (("ret", ()), ("jr", ("ra",)))

    @property
    def indirect(self) -> bool:
        return self.mnemonic in ("jal", "jalr", "jr") and self.goes is None and not self.returns

    @property
    def ends(self) -> bool:
        return self.mnemonic in ("j", "jr", "ret", "unimp", "ebreak", "mret")

    @property
    def moves(self) -> int | None:
        """By how many bytes the stack grows; None: by an unknown number."""
        if any(re.fullmatch(r"-\d+\(sp\)", operand) for operand in self.operands):
            return None  # writes below it
        if self.operands[:1] != ("sp",) or STORE.match(self.mnemonic):
            return 0
        by_number = self.operands[1:2] == ("sp",) and re.fullmatch(r"-?\d+", self.operands[-1])
        return -int(self.operands[-1]) if by_number and self.mnemonic in ("add", "addi") else None


class FixedFrames(Walk):
    """All paths through a function whose stack pointer moves by constants."""

    def effect(self, i: Instruction, state: State) -> State:
        if state.link is not None:
            raise self.refuse(i, "is in a part that the function itself calls")
        moved = i.moves if isinstance(i, A64 | RiscV) else None
        if moved is None:
            raise self.refuse(i, "changes the stack pointer in an unknown way or writes below it")
        return state.at(state.depth + moved)


Make = Callable[[int, str, str, tuple[str, ...], str, Instruction | None], Instruction]


def parse(text: str, make: Make) -> Listing:
    """Reads what `objdump -dz --no-show-raw-insn` prints."""
    listing = Listing()
    last: int | None = None
    for line in text.splitlines():
        match = LINE.match(line)
        if match is None:
            if line.startswith("Disassembly of section"):
                last = None
            continue
        address, mnemonic = int(match[1], 16), match[2]
        if last is not None:
            listing.following[last] = address
        previous = None if last is None else listing.code[last]
        last = None
        if mnemonic.startswith("."):
            continue  # data
        rest, *comment = COMMENT.split(match[3] or "", maxsplit=1)
        shown, operands = f"{mnemonic} {rest}".strip(), tuple(OPERAND.findall(rest))
        listing.code[address] = make(address, shown, mnemonic, operands, "".join(comment), previous)
        last = address
    return listing


def a64(
    address: int,
    text: str,
    mnemonic: str,
    operands: tuple[str, ...],
    _: str,
    __: Instruction | None,
) -> A64:
    """An instruction of `aarch64-linux-gnu-objdump`."""
    return A64(address, text, mnemonic, operands)


def riscv(
    address: int,
    text: str,
    mnemonic: str,
    operands: tuple[str, ...],
    comment: str,
    previous: Instruction | None,
) -> RiscV:
    """An instruction of `riscv64-unknown-elf-objdump`, whose comment names where `auipc` leads."""
    goes = None
    if mnemonic in ("j", "jal") or BRANCH.match(mnemonic):
        linked = mnemonic != "jal" or operands[:-1] in ((), ("ra",))
        goes = int(operands[-1].split()[0], 16) if linked else None
    elif mnemonic in ("jalr", "jr") and len(operands) == 1 and previous is not None:
        base = operands[0].rstrip(")").split("(")[-1]
        named = re.match(r"([0-9a-f]+) <", comment)
        if named and (previous.mnemonic, previous.operands[:1]) == ("auipc", (base,)):
            goes = int(named[1], 16)
    return RiscV(address, text, mnemonic, operands, goes)


def parse_a64(text: str) -> Listing:
    """A listing of AArch64."""
    return parse(text, a64)


def parse_riscv(text: str) -> Listing:
    """A listing of RISC-V."""
    return parse(text, riscv)
