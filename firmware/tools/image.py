"""A linked ELF image of a processor: its functions, its call graph, proven stack bounds.

    image = Image.load("firmware.elf")
    image.stack_bound("step")         # bytes, or the error Unproved
    image.text_bytes("step")          # code of all that step reaches
    image.allocator_symbols()         # []: no heap

The binutils read the file; thumb.py and risc.py understand what they print, stack.py walks it.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import risc
import thumb
from listing import ImageError, Instruction, Listing, demangle, run
from stack import Bounds, Unproved, Walk

__all__ = ["Function", "Image", "ImageError", "Unproved"]

# A symbol that only a heap needs, of C, of C++ or of Rust.
ALLOCATOR = re.compile(
    r"^_?(malloc|calloc|realloc|reallocarray|free|memalign|aligned_alloc|sbrk)(_r)?(\.|$)"
    r"|^operator (new|delete)|__r(ust|g|dl)_\w*alloc|(?<![\w:])alloc::"
)
# Num: Value Size Type Bind Vis Ndx Name
SYMBOL = re.compile(r"\s*\d+: ([0-9a-f]+)\s+(\w+) (\w+)\s+(\w+)\s+\w+\s.*?(\w+) (\S+)$")


@dataclass(frozen=True)
class Processor:
    """What reads the code of a processor."""

    binutils: str
    """The prefix of its binutils."""
    parse: Callable[[str], Listing]
    walk: type[Walk]
    thumb: bool = False


# By the machine that `readelf -h` names.
PROCESSORS = {
    "ARM": Processor("arm-none-eabi-", thumb.parse, Walk, thumb=True),
    "AArch64": Processor("aarch64-linux-gnu-", risc.parse_a64, risc.FixedFrames),
    "RISC-V": Processor("riscv64-unknown-elf-", risc.parse_riscv, risc.FixedFrames),
}


@dataclass
class Function:
    """A function symbol and its code."""

    name: str
    """As the linker has it."""
    demangled: str
    """As the source has it, without hashes."""
    names: tuple[str, ...]
    """All symbols of the address, mangled and demangled."""
    address: int
    size: int
    """In bytes, with literal pools and jump tables."""
    instructions: list[Instruction] = field(default_factory=list)
    calls: set[int] = field(default_factory=set)
    """Addresses outside its own code that it calls or jumps to, and its own if it calls itself."""
    indirect: list[Instruction] = field(default_factory=list)
    """Its calls and jumps to addresses that only the running program knows."""

    def __contains__(self, address: int) -> bool:
        return self.address <= address < self.address + self.size


class Image:
    """A linked image. Functions are asked for by mangled or by demangled name."""

    def __init__(self, path: Path, processor: Processor, listing: Listing) -> None:
        self.path = path
        self.processor = processor
        self.listing = listing
        self.functions: dict[int, Function] = {}
        self._symbols: set[str] = set()
        self._undefined: set[str] = set()
        self._bounds = Bounds(self, processor.walk)

    @classmethod
    def load(cls, path: str | Path) -> Image:
        """Reads an executable ELF file."""
        header = run("arm-none-eabi-readelf", "-h", str(path))  # it reads any processor's
        if not re.search(r"Type:\s+EXEC", header):
            raise ImageError(f"{path} is not a linked executable: link it first")
        machine = re.search(r"Machine:\s+(\S+)", header)
        processor = PROCESSORS.get(machine[1]) if machine else None
        if processor is None:
            raise ImageError(f"{path} is for none of the processors {', '.join(PROCESSORS)}")
        objdump = [f"{processor.binutils}objdump", "-dz", "--no-show-raw-insn"]
        image = cls(Path(path), processor, processor.parse(run(*objdump, str(path))))
        image._read_symbols(run("arm-none-eabi-readelf", "-sW", str(path)))
        if not image.functions:
            raise ImageError(f"{path} has no function symbols: link it without stripping")
        for function in image.functions.values():
            image._connect(function)
        return image

    def _read_symbols(self, table: str) -> None:
        entries: dict[int, tuple[int, list[str]]] = {}
        for match in filter(None, map(SYMBOL.match, table.splitlines())):
            value, size, kind, binding, section, name = match.groups()
            if kind in ("FILE", "SECTION"):
                continue
            if section == "UND":
                if binding != "WEAK":
                    self._undefined.add(name)
                continue
            self._symbols.add(name)
            # The lowest bit says that it is thumb code.
            address = int(value, 16) - self.processor.thumb
            if kind == "FUNC" and address < int(value, 16) in self.listing.code:
                raise ImageError(f"{self.path}: {name} is ARM code, which no Cortex-M runs")
            if kind == "FUNC" and address in self.listing.code:
                largest, names = entries.get(address, (0, []))
                entries[address] = max(largest, int(size, 0)), [*names, name]
        mangled = [name for _, names in entries.values() for name in names]
        plain = dict(zip(mangled, demangle(mangled), strict=True))
        starts = [*sorted(entries), 1 << 32]
        for address, (size, names) in entries.items():
            if size == 0:  # assembly that does not say: up to the next function, data or gap
                end, stop = address, starts[bisect_right(starts, address)]
                while end < stop and end in self.listing.following:
                    end = self.listing.following[end]
                size = end - address
            both = tuple(dict.fromkeys([*names, *(plain[name] for name in names)]))
            self.functions[address] = Function(names[0], plain[names[0]], both, address, size)

    def _connect(self, function: Function) -> None:
        places = range(function.address, function.address + function.size, 2)
        for instruction in filter(None, map(self.listing.code.get, places)):
            function.instructions.append(instruction)
            target = instruction.target
            if instruction.indirect:
                function.indirect.append(instruction)
            elif target is not None and (instruction.calls or target not in function):
                function.calls.add(target)
        # Assembly may run on into the next function. (A call that comes last does not come back.)
        last = function.instructions[-1]
        after = self.listing.following.get(last.address)
        if after in self.functions and not last.ends and not last.calls:
            function.calls.add(after)

    def function(self, name: str) -> Function:
        """The function of a name, mangled or demangled."""
        found = [function for function in self.functions.values() if name in function.names]
        if len(found) == 1:
            return found[0]
        many = f"{len(found)} functions" if found else "no function"
        raise ImageError(f"{self.path} has {many} of the name {name!r}")

    def owner(self, address: int) -> Function | None:
        """The function whose code holds an address."""
        if address in self.functions:
            return self.functions[address]
        return next((f for f in self.functions.values() if address in f), None)

    def name(self, address: int) -> str:
        """Of the function that holds an address."""
        function = self.owner(address)
        return function.demangled if function else f"{address:#x}"

    def reachable(self, root: str, *, indirect: bool = False) -> set[str]:
        """The functions that a call of `root` may execute, itself included.

        A call through a register is `Unproved`, unless `indirect=True` says that what such calls
        reach may be left out.
        """
        return {function.name for function in self._reach(root, indirect)}

    def _reach(self, root: str, indirect: bool) -> list[Function]:
        found: dict[int, Function] = {}
        todo = [self.function(root)]
        while todo:
            function = todo.pop()
            if function.address in found:
                continue
            found[function.address] = function
            if function.indirect and not indirect:
                reason = "goes to an address that is not known"
                raise Unproved(function.demangled, function.indirect[0], reason)
            todo += filter(None, map(self.owner, function.calls))
        return list(found.values())

    def text_bytes(self, root: str, *, indirect: bool = False) -> int:
        """Bytes of code of all that `root` reaches: with literal pools, without .rodata."""
        covered: set[int] = set()
        for function in self._reach(root, indirect):
            covered.update(range(function.address, function.address + function.size))
        return len(covered)

    def text_total(self) -> int:
        """Bytes of flash for code, vectors and constants (.rodata): the text that `size` counts."""
        return int(run(f"{self.processor.binutils}size", str(self.path)).splitlines()[1].split()[0])

    def allocator_symbols(self) -> list[str]:
        """Symbols of a heap, demangled, defined or wanted. None: the image is heap free."""
        names = demangle(self._symbols | self._undefined)
        return sorted({name for name in names if ALLOCATOR.search(name)})

    def undefined(self) -> list[str]:
        """Symbols that the link left undefined, but for weak ones, which may be absent."""
        return sorted(self._undefined)

    def count_instructions(self, name: str) -> int:
        """Instructions in the code of one function (not the number that a call executes)."""
        return len(self.function(name).instructions)

    def executed(self, name: str) -> tuple[int, int] | None:
        """The least and the most instructions that a call of a function executes.

        None where paths alone do not say: loops, calls, Thumb's conditional returns.
        """
        function = self.function(name)
        returns = sum(i.returns for i in function.instructions)
        if function.calls or function.indirect or (returns > 1 and self.processor.thumb):
            return None
        found: dict[int, tuple[int, int]] = {}
        for i in reversed(function.instructions):
            targets = [] if i.target is None else [i.target]
            if any(target <= i.address for target in targets):
                return None
            after = [] if i.ends else [self.listing.following.get(i.address, -1)]
            paths = [found[place] for place in targets + after if place in found]
            if i.returns or paths:
                least = min((path[0] for path in paths), default=0)
                found[i.address] = 1 + least, 1 + max((path[1] for path in paths), default=0)
        return found.get(function.address)

    def stack_bound(self, root: str) -> int:
        """The most bytes of stack that a call of `root` takes, counted from its entry."""
        return self._bounds.of(self.function(root).address).total

    def frame(self, name: str) -> int:
        """The most bytes of stack that the function itself takes, without its callees."""
        return self._bounds.of(self.function(name).address).frame

    def stack_path(self, root: str) -> list[tuple[str, int]]:
        """The deepest path: each function with the bytes it has taken when it calls the next."""
        path: list[tuple[str, int]] = []
        address: int | None = self.function(root).address
        while address is not None:
            bound = self._bounds.of(address)
            callee, depth = bound.via or (None, bound.frame)
            path.append((self.name(address), depth))
            address = callee
        return path
