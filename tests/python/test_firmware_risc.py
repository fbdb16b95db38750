"""Stack bounds and counts of A64 and RISC-V code, of assembly whose frames one sees."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "firmware" / "tools"))

from image import Image, Unproved
from report import Run

import firmware

CHIPS = {
    "a64": ("aarch64-linux-gnu-", [], []),
    "riscv": ("riscv64-unknown-elf-", ["-march=rv32imafc"], ["-m", "elf32lriscv"]),
}

# name: (assembly, bound in bytes or the reason of the refusal)
A64 = {
    "leaf_only": ("add x0, x0, #1; ret", 0),
    "pushes": ("stp x29, x30, [sp, #-32]!; bl pushes_one; ldp x29, x30, [sp], #32; ret", 32 + 16),
    "pushes_one": ("str x19, [sp, #-16]!; ldr x19, [sp], #16; ret", 16),
    "large": (
        "sub sp, sp, #2, lsl #12; sub sp, sp, #0x40; cmp sp, x1; str x0, [sp, #8];"
        "add sp, sp, #0x40; add sp, sp, #2, lsl #12; ret",
        0x2040,
    ),
    "tail": ("cbz x0, 1f; b pushes; 1: tbz w0, #3, 2f; b.eq 2f; nop; 2: ret", 48),
    "tail_with_frame": ("sub sp, sp, #16; b pushes", "16 bytes still on the stack"),
    "never_back": ("str x30, [sp, #-16]!; bl endless", 16),
    "endless": ("1: b 1b", 0),
    "from_register": ("mov sp, x0; ret", "unknown way"),
    "aligns": ("mov x9, sp; and sp, x9, #0xffffffffffffffc0; ret", "unknown way"),
    "variable": ("sub sp, sp, x0; ret", "unknown way"),
    "post_register": ("ld1 {v0.16b}, [sp], x1; ret", "unknown way"),
    "below": ("str x0, [sp, #-8]; ret", "writes below it"),
    "jumps": ("br x3", "not known"),
    "through": ("str x30, [sp, #-16]!; blr x3; ldr x30, [sp], #16; ret", "not known"),
    "returns_elsewhere": ("ret x5", "not known"),
    "unbalanced": ("sub sp, sp, #32; add sp, sp, #16; ret", "16 bytes still on the stack"),
    "pops_too_much": ("add sp, sp, #16; ret", "pops more than was pushed"),
    "in_loop": ("1: sub sp, sp, #16; cbz x0, 1b; b 1b", "grows in a loop"),
    "recursive": ("str x30, [sp, #-16]!; bl recursive; ldr x30, [sp], #16; ret", "is recursive"),
    "into_data": ("nop; .word 0x12345678", "runs into data"),
}
RISCV = {
    "leaf_only": ("addi a0, a0, 1; ret", 0),
    "pushes": (
        "addi sp, sp, -32; sw ra, 28(sp); fsw fs0, 24(sp); jal pushes_one; lw ra, 28(sp);"
        "addi sp, sp, 32; ret",
        32 + 16,
    ),
    "pushes_one": ("addi sp, sp, -16; sw s0, 12(sp); lw s0, 12(sp); addi sp, sp, 16; ret", 16),
    "far": ("addi sp, sp, -16; call pushes_one; addi sp, sp, 16; tail pushes", 48),
    "large": (
        "addi sp, sp, -2048; addi sp, sp, -2032; addi sp, sp, 2032; addi sp, sp, 2032;"
        "addi sp, sp, 16; ret",
        4080,
    ),
    "tail": ("beqz a0, 1f; j pushes; 1: bltu a0, a1, 2f; nop; 2: ret", 48),
    "never_back": ("addi sp, sp, -16; jal endless", 16),
    "endless": ("1: j 1b", 0),
    "from_register": ("mv sp, a0; ret", "unknown way"),
    "number_unknown": ("li t0, 5000; sub sp, sp, t0; ret", "unknown way"),
    "loads": ("lw sp, 0(a0); ret", "unknown way"),
    "below": ("sw a0, -8(sp); ret", "writes below it"),
    "stores_it": ("sw sp, 0(a0); ret", 0),
    "jumps": ("jr a0", "not known"),
    "through": ("addi sp, sp, -16; jalr a0; addi sp, sp, 16; ret", "not known"),
    # What `lui` left in a register is not where a later call through it goes.
    "stale": ("lui a5, %hi(leaf_only); lw a5, 0(a0); jr a5", "not known"),
    "other_link": ("jal t0, leaf_only; ret", "not known"),
    "unbalanced": ("addi sp, sp, -32; addi sp, sp, 16; ret", "16 bytes still on the stack"),
    "pops_too_much": ("addi sp, sp, 16; ret", "pops more than was pushed"),
    "in_loop": ("1: addi sp, sp, -16; beqz a0, 1b; j 1b", "grows in a loop"),
    "recursive": ("addi sp, sp, -16; call recursive; addi sp, sp, 16; ret", "is recursive"),
    "into_data": ("nop; .word 0x12345678", "runs into data"),
}
ASSEMBLY = {"a64": A64, "riscv": RISCV}


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> dict[str, Image]:
    """The assembly of each processor whose binutils are here, linked."""
    found = {}
    for chip, (prefix, assembler, linker) in CHIPS.items():
        if shutil.which(f"{prefix}objdump") is None:
            continue
        folder = tmp_path_factory.mktemp(chip)
        lines = [".text"]
        for name, (body, _) in ASSEMBLY[chip].items():
            lines += [f".global {name}", f".type {name}, %function", f"{name}:", *body.split(";")]
            lines += [f".size {name}, . - {name}", ".balign 16"]
        (folder / "functions.s").write_text("\n".join(lines) + "\n")
        for command in (
            [f"{prefix}as", *assembler, "functions.s", "-o", "functions.o"],
            [f"{prefix}ld", *linker, "-e", "leaf_only", "functions.o", "-o", "functions.elf"],
        ):
            subprocess.run(command, cwd=folder, check=True)
        found[chip] = Image.load(folder / "functions.elf")
    return found


def of(images: dict[str, Image], chip: str) -> Image:
    if chip not in images:
        pytest.skip(f"no binutils for {chip}: `make firmware` installs them, or says how")
    return images[chip]


@pytest.mark.parametrize(("chip", "name"), [(c, n) for c, names in ASSEMBLY.items() for n in names])
def test_frames_by_hand(images: dict[str, Image], chip: str, name: str):
    image, expected = of(images, chip), ASSEMBLY[chip][name][1]
    if isinstance(expected, int):
        assert image.stack_bound(name) == expected
    else:
        with pytest.raises(Unproved, match=expected):
            image.stack_bound(name)


@pytest.mark.parametrize("chip", CHIPS)
def test_calls_and_sizes(images: dict[str, Image], chip: str):
    image = of(images, chip)
    assert image.reachable("pushes") == {"pushes", "pushes_one"}
    assert image.reachable("tail") == {"tail", "pushes", "pushes_one"}
    sizes = {function.name: function.size for function in image.functions.values()}
    assert image.text_bytes("pushes") == sizes["pushes"] + sizes["pushes_one"]
    assert image.allocator_symbols() == [] == image.undefined()
    with pytest.raises(Unproved, match=re.escape("through at")):
        image.reachable("through")


@pytest.mark.parametrize("chip", CHIPS)
def test_paths_say_how_many_instructions_are_executed(images: dict[str, Image], chip: str):
    image = of(images, chip)
    assert image.executed("leaf_only") == (2, 2)
    assert image.executed("unbalanced") == (3, 3)
    assert image.executed("in_loop") is None  # a loop
    assert image.executed("pushes") is None  # a call
    assert image.executed("jumps") is None


def a_run(observer: str, digest: str, instructions: int = 50, most: int = 6) -> Run:
    """Ten steps of an observer, n = 2."""
    return Run(observer, observer, 2, "f32", digest, 10, instructions, most, 0, ())


def test_counts_that_no_path_allows_fail():
    run = a_run("standard", "0")
    assert list(firmware.miscounted("chip", run, None)) == []
    assert list(firmware.miscounted("chip", run, (5, 6))) == []
    for executed in [(5, 5), (6, 6)]:
        (failure,) = firmware.miscounted("chip", run, executed)
        assert failure.startswith("chip: counted 5 (≤ 6); its code executes")


def test_plain_c_with_other_bits_fails():
    own = [a_run("standard", "a"), a_run("adaptive", "b"), a_run("Kalman filter", "c")]
    assert list(firmware.unlike([*own, a_run("C standard", "a"), a_run("C adaptive", "d")])) == []
    (failure,) = firmware.unlike([*own, a_run("C standard", "b")])
    assert failure == "C standard does not give the bits of standard, n = 2"
