"""Thumb-2 machine code, as `arm-none-eabi-objdump -d` lists it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from listing import Instruction, Listing

# Each beside its opposite.
CONDITIONS = re.findall("..", "eqnecsccmiplvsvchilsgeltgtle")
BRANCHES = {"b", "bl", "cbz", "cbnz", *(f"b{condition}" for condition in CONDITIONS)}
OPERAND = re.compile(r"\{[^}]*\}|\[[^]]*\]!?|[^,\s][^,]*")
LINE = re.compile(r"\s*([0-9a-f]+):\t([^\t@;]*)(?:\t([^@;]*))?")
DATA = {".word": 4, ".short": 2, ".byte": 1}


@dataclass(frozen=True)
class Thumb(Instruction):
    """A Thumb-2 instruction. The mnemonic is without width (.w), type (.f32) and the condition
    that an IT block gives it."""

    block: str = ""
    """Of an IT instruction: a t (then) or an e (else) for each instruction that it governs."""

    @property
    def target(self) -> int | None:
        if self.mnemonic in BRANCHES:
            return int(self.operands[-1].split()[0], 16)
        return None

    @property
    def calls(self) -> bool:
        return self.mnemonic == "bl"

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
        jumps = self.mnemonic in ("bx", "blx") or self._pops_pc or self.operands[:1] == ("pc",)
        return jumps and not self.returns

    @property
    def ends(self) -> bool:
        stops = self.mnemonic in ("b", "udf", "tbb", "tbh")
        return stops or self.returns or (self.indirect and self.mnemonic != "blx")


def parse(text: str) -> Listing:
    """Reads what `objdump -dz --no-show-raw-insn` prints."""
    listing = Listing()
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
        listing.code[address] = Thumb(
            address, f"{name} {rest}".strip(), mnemonic, tuple(OPERAND.findall(rest)), governed
        )
    return listing
