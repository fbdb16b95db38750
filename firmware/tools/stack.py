"""Stack bounds of machine code: every path is walked, with the depth of the stack as its state.

What the walk cannot follow (recursion, a call through a register, a frame of unknown size) is
`Unproved`, never a guess. It rests on the calling convention: a callee keeps r4 to r11 and returns
through lr. An interrupt's own frame is not in a bound: up to 36 bytes, 108 with the FPU.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from listing import Instruction
from thumb import CONDITIONS, Thumb

if TYPE_CHECKING:
    from image import Image

REGISTER = re.compile(r"\b(?:r\d+|sl|fp|ip|lr)\b")
CLOBBERED = {"r0", "r1", "r2", "r3", "ip", "lr", "flags"}
# What instructions write of the registers that they name: none, all but the first, the first.
READS = re.compile(r"(str(?!ex)|stm|vst|push|vpush|cmp|cmn|tst|teq|cb|it|tb)")
LOADS_SEVERAL = re.compile("v?ldm")
ARITHMETIC = "(mov|mvn|add|sub|rsb|adc|sbc|and|orr|eor|bic|lsl|lsr|asr|mul)"
WRITES_FIRST = re.compile(ARITHMETIC + "[sw]?$")
WRITES_FLAGS = re.compile("cmp|cmn|tst|teq|msr|bl|svc|bkpt|.*s$")
PUSHES = ("push", "vpush", "stmdb", "vstmdb")
POPS = ("pop", "vpop", "ldmia", "ldm", "vldmia", "stmia", "stm", "vstmia")
ADDS = ("add", "adds", "addw")
SUBTRACTS = ("sub", "subs", "subw")
MOVES = ("mov", "movs", "movw")
ADJUSTS = (*ADDS, *SUBTRACTS, "bic", "bics", "mvn", "mvns", "movt")

Value = tuple[str, int]
"""What is known of a register: ("number", n), or ("sp", d), the stack pointer at entry minus d.
Of the flags: (c, 0), the condition c holds."""


class Unproved(RuntimeError):
    """No bound: names the function, the instruction and the reason."""

    def __init__(self, function: str, instruction: Instruction | None, reason: str) -> None:
        at = f" at {instruction.address:#x} `{instruction.text}`" if instruction else ""
        super().__init__(f"{function}{at}: {reason}")
        self.function = function
        self.instruction = instruction
        self.reason = reason


@dataclass(frozen=True)
class Bound:
    """What the walk of one function found."""

    total: int
    """The most bytes of stack, callees' included."""
    frame: int
    """The most bytes of its own."""
    returns: bool
    """Whether any path comes back to the caller."""
    via: tuple[int, int] | None
    """The callee on the deepest path and the depth at its call; None: the frame is the deepest."""


@dataclass(frozen=True)
class State:
    """The depth of the stack below the entry, and what is known of registers."""

    depth: int
    known: dict[str, Value]
    link: int | None = None
    """Where lr leads, while that is a place in the same function."""

    def at(self, depth: int) -> State:
        return replace(self, depth=depth)

    def knowing(self, register: str, value: Value) -> State:
        return replace(self, known={**self.known, register: value})

    def without(self, registers: Iterable[str]) -> State:
        gone = set(registers)
        return replace(self, known={r: v for r, v in self.known.items() if r not in gone})

    def value(self, operand: str) -> Value | None:
        if operand.startswith("#"):
            return "number", int(operand[1:], 0)
        return ("sp", self.depth) if operand == "sp" else self.known.get(operand)


Successors = list[tuple[int, State]]
"""Addresses that may be executed next, each with its state."""


class Bounds:
    """The bounds of an image's functions, each walked once."""

    def __init__(self, image: Image, walk: type[Walk]) -> None:
        self.image = image
        self.walk = walk
        self.found: dict[int, Bound] = {}
        self.open: set[int] = set()

    def of(self, address: int) -> Bound:
        """The bound of the code that starts at an address."""
        if address in self.open:
            raise Unproved(self.image.name(address), None, "is recursive")
        if address not in self.found:
            self.open.add(address)
            try:
                self.found[address] = self.walk(self, address).run()
            finally:
                self.open.remove(address)
        return self.found[address]


class Walk:
    """All paths through one function."""

    def __init__(self, bounds: Bounds, entry: int) -> None:
        self.bounds = bounds
        self.image = bounds.image
        self.listing = bounds.image.listing
        self.entry = entry
        self.function = bounds.image.owner(entry)
        self.frame = self.deepest = 0
        self.returns = False
        self.via: tuple[int, int] | None = None
        self.seen: dict[int, dict[tuple[int, int | None], dict[str, Value]]] = {}
        self.todo: Successors = []

    def refuse(self, instruction: Instruction | None, reason: str) -> Unproved:
        return Unproved(self.image.name(self.entry), instruction, reason)

    def owns(self, place: int) -> bool:
        return self.function is not None and place in self.function

    def run(self) -> Bound:
        self.arrive(self.entry, State(0, {}))
        while self.todo:
            place, state = self.todo.pop()
            for successor in self.execute(place, state):
                self.arrive(*successor)
        via = self.via if self.deepest > self.frame else None
        return Bound(max(self.frame, self.deepest), self.frame, self.returns, via)

    def arrive(self, place: int, state: State) -> None:
        """Notes a state; where paths of one depth meet, known is what all of them know."""
        seen = self.seen.setdefault(place, {})
        key = state.depth, state.link
        known = seen.get(key)
        if known is not None:
            common = {r: v for r, v in known.items() if state.known.get(r) == v}
            if common == known:
                return
            state = replace(state, known=common)
        seen[key] = state.known
        if len(seen) > 16:
            raise self.refuse(self.listing.code.get(place), "the stack grows in a loop")
        self.todo.append((place, state))

    def execute(self, place: int, state: State) -> Successors:
        instruction = self.listing.code.get(place)
        if instruction is None:
            raise self.refuse(None, f"runs into data at {place:#x}")
        if not isinstance(instruction, Thumb) or not instruction.block:
            return self.step(instruction, state)
        condition = CONDITIONS.index(instruction.operands[0])
        return self.governed(self.listing.following[place], condition, instruction.block, state)

    def governed(self, place: int, condition: int, block: str, state: State) -> Successors:
        """The instructions of an IT block share one condition: two paths, not one for each.

        The path knows its condition until the flags change: an epilogue may take two blocks.
        """
        found: Successors = []
        for choice in "te":
            holds = CONDITIONS[condition ^ (choice == "e")]
            if state.known.get("flags") == (CONDITIONS[condition ^ (choice == "t")], 0):
                continue
            after, now = place, state.knowing("flags", (holds, 0))
            for index, governs in enumerate(block, 1):
                inner, after = self.listing.code[after], self.listing.following[after]
                if governs != choice:
                    continue
                leads = self.step(inner, now)
                if [place for place, _ in leads] != [after]:
                    found += leads
                    break
                now = leads[0][1]
                if "flags" not in now.known and index < len(block):
                    found += self.governed(after, condition, block[index:], now)
                    break
            else:
                found.append((after, now))
        return found

    def step(self, i: Instruction, state: State) -> Successors:
        """One instruction: its effect on the stack, and where it leads."""
        if not i.mnemonic:
            raise self.refuse(i, "is no instruction")
        if state.link is not None and (i.calls or re.search(r"\blr\b", i.text)):
            if not i.returns:
                raise self.refuse(i, "uses lr in a part that the function itself calls")
            return self.go([state.link], replace(state, link=None))
        state = self.effect(i, state)
        if state.depth < 0:
            raise self.refuse(i, "pops more than was pushed")
        self.frame = max(self.frame, state.depth)
        if i.returns:
            if state.depth:
                raise self.refuse(i, f"returns with {state.depth} bytes still on the stack")
            self.returns = True
            return []
        if i.indirect:
            raise self.refuse(i, "goes to an address that is not known")
        if i.mnemonic in ("tbb", "tbh"):
            return self.go(self.table(i), state)
        following = self.listing.following.get(i.address, -1)
        if i.target is None:
            return self.go([] if i.ends else [following], state)
        if i.calls and i.target not in self.image.functions and self.owns(i.target):
            # Assembly calls a part of itself, which may return to here or for both.
            return self.go([i.target], replace(state.without(CLOBBERED), link=following))
        if i.calls:
            comes_back = self.call(i.target, state.depth)
            return self.go([following], state.without(CLOBBERED)) if comes_back else []
        return self.go([i.target] if i.ends else [i.target, following], state)

    def call(self, target: int, depth: int) -> bool:
        """Counts a callee's stack; whether it comes back."""
        bound = self.bounds.of(target)
        if depth + bound.total > self.deepest:
            self.deepest, self.via = depth + bound.total, (target, depth)
        return bound.returns

    def go(self, places: Iterable[int], state: State) -> Successors:
        """Goes on at each place; to go to another function with an empty frame is a tail call."""
        inside: Successors = []
        for place in places:
            leaves = place in self.image.functions and not self.owns(place)
            if leaves and state.depth == 0 and state.link is None:
                self.returns |= self.call(place, 0)
            else:
                inside.append((place, state))
        return inside

    def table(self, i: Instruction) -> Iterator[int]:
        """The targets of a jump table: it follows its instruction and ends before all of them."""
        size = 1 if i.mnemonic == "tbb" else 2
        base = place = i.address + 4
        first = 1 << 32
        if not i.operands[0].startswith("[pc"):
            raise self.refuse(i, "the jump table is elsewhere")
        while place < first:
            entry = self.listing.number(place, size)
            target = base + 2 * (entry or 0)
            if entry is None or target not in self.listing.code or not self.owns(target):
                break
            first = min(first, target)
            place += size
            yield target
        # What is left before the code is padding: zeros, or instructions that do nothing.
        place += place % 2
        while place < first and (padding := self.listing.number(place, 2)) is not None:
            if padding not in (0, 0xBF00):
                raise self.refuse(i, "the jump table is not understood")
            place += 2

    def effect(self, i: Instruction, state: State) -> State:
        """The state after what an instruction writes to registers."""
        name, operands = i.mnemonic, i.operands
        first = operands[0] if operands else ""
        if name in PUSHES and (first == "sp!" or "push" in name):
            return state.at(state.depth + size_of(operands[-1]))
        if name in POPS and (first == "sp!" or "pop" in name):
            gone = REGISTER.findall(operands[-1])
            return state.at(state.depth - size_of(operands[-1])).without(gone)
        if first == "sp!" or (name == "msr" and first.lower() in ("msp", "psp", "control")):
            raise self.refuse(i, "changes the stack pointer in an unknown way")
        written = written_by(i)
        result = state.without(written)
        if match := re.search(r"\[sp(?:\], |, )#(-?\d+)(?:$|\]!$)", i.text):  # write-back
            return result.at(state.depth - int(match[1]))
        if re.search(r"\[sp\], |\[sp[^]]*\]!|\[sp, #-", i.text):
            raise self.refuse(i, "changes the stack pointer or writes below it")
        value = self.computed(i, state)
        if first == "sp" and not READS.match(name) and not LOADS_SEVERAL.match(name):
            if value is None or value[0] != "sp":
                raise self.refuse(i, "gives the stack pointer an unknown value")
            return result.at(value[1])
        return result if value is None or first not in written else result.knowing(first, value)

    def computed(self, i: Instruction, state: State) -> Value | None:
        """The value that an instruction gives its first operand, where that is known."""
        name, operands = i.mnemonic, i.operands
        if name == "ldr" and len(operands) == 2 and operands[1].startswith("[pc, #"):
            number = self.listing.number((i.address + 4 & ~3) + int(operands[1][6:-1]))
            return None if number is None else ("number", number)
        if name == "bfc" and operands[1] == "#0":
            return aligned(state.value(operands[0]), 1 << int(operands[2][1:]))
        if name in MOVES and len(operands) == 2:
            return state.value(operands[1])
        if name not in ADJUSTS or len(operands) not in (2, 3):
            return None
        source, last = state.value(operands[-2]), state.value(operands[-1])
        if last is None or last[0] != "number":
            return None
        if name in ("mvn", "mvns"):
            return "number", ~last[1] & 0xFFFFFFFF
        if source is None:
            return None
        if name == "movt":
            return ("number", source[1] & 0xFFFF | last[1] << 16) if source[0] == "number" else None
        if name in ("bic", "bics"):
            return aligned(source, last[1] + 1)
        if source[0] != "sp":
            return None
        # A frame may be opened by adding a negative number.
        amount = (last[1] + (1 << 31)) % (1 << 32) - (1 << 31)
        return "sp", source[1] + (-amount if name in ADDS else amount)


def aligned(value: Value | None, unit: int) -> Value | None:
    """The stack pointer rounded down: at worst by one unit less the word it is aligned to."""
    if value is None or value[0] != "sp" or unit & (unit - 1):
        return None
    return "sp", value[1] + max(unit - 4, 0)


def written_by(i: Instruction) -> set[str]:
    """Registers and flags that an instruction may change (too many do no harm)."""
    if i.mnemonic in ("bkpt", "svc"):
        return CLOBBERED
    post = len(i.operands) > 1 and i.operands[-2].endswith("]")
    registers = {"flags"} if WRITES_FLAGS.match(i.mnemonic) else set()
    for index, operand in enumerate(i.operands):
        if operand.startswith("["):
            writes = operand.endswith("!") or post
        elif READS.match(i.mnemonic) or (index == 0 and LOADS_SEVERAL.match(i.mnemonic)):
            writes = operand.endswith("!")
        else:
            writes = index == 0 or not WRITES_FIRST.match(i.mnemonic)
        if writes:
            registers.update(REGISTER.findall(operand))
    return registers


def size_of(registers: str) -> int:
    """Bytes that a list of registers takes: {r4, r5, lr}, {d8-d9}."""
    count = 0
    for item in registers.strip("{}").split(","):
        first, _, last = item.strip().partition("-")
        many = int(last[1:]) - int(first[1:]) + 1 if last else 1
        count += many * (8 if first.startswith("d") else 4)
    return count
