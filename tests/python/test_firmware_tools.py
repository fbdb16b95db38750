"""The tools of firmware/: stack bounds against gcc's own figures and against a painted stack."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "firmware" / "tools"))

import toolchain
from image import Image, ImageError, Unproved

needs_gcc = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None,
    reason="arm-none-eabi-gcc is not on this machine: `make firmware` installs it, or says how",
)
FLAGS = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
# At -O0 the jump tables are of addresses, which the walk refuses.
LEVELS = ["-O0 -fno-jump-tables", "-O2 -fno-omit-frame-pointer", "-O2", "-O3", "-Os"]

SCRIPT = """
ENTRY(reset)
SECTIONS {
  .vectors 0 : { KEEP(*(.vectors)) }
  .text : { *(.text*) *(.rodata*) }
  .data 0x20000000 : { *(.data*) *(.bss*) *(COMMON) end = .; }
}
"""

PROGRAM = r"""
#include <stdarg.h>
#include <string.h>
#define ALONE __attribute__((noipa))
volatile int sink;
volatile double real;

ALONE int leaf(int a, int b) { return a * b + 3; }
ALONE void fill(char *p, int n) { for (int i = 0; i < n; i++) p[i] = (char)(i + 1); }
ALONE int nested(int a) { return leaf(a, 1) + leaf(a, 2) * leaf(a, 3) + a; }
ALONE int deeper(int a) { char b[40]; fill(b, 40); return nested(b[a & 7]) + nested(a) + b[3]; }
ALONE double doubles(double x, double y) { return (x * y + x / y) - y * 0.5; }
ALONE float floats(float a, float b, float c) {
  float s = a * b;
  for (int i = 0; i < 3; i++) s += (float)leaf((int)s, (int)c) * c - b / a;
  return s + a;
}
ALONE double mixed(float a, double b) { return (double)floats(a, a, a) * doubles(b, b + 1); }
ALONE int tail(int a) { return deeper(a + 1); }
ALONE int tail_after_frame(int a) {
  char b[24];
  fill(b, 24);
  if (a > 4) return nested(b[2]);
  return leaf(b[1], a);
}
ALONE int table(int k, int a) {
  switch (k) {
    case 0: return leaf(a, 3);
    case 1: return nested(a) + 1;
    case 2: sink = 4; return a * 5;
    case 3: return deeper(a) * 2;
    case 4: return (int)doubles(a, 2);
    case 5: sink = 8; break;
    case 6: return leaf(leaf(a, a), 7);
    case 7: return nested(nested(a));
    case 9: sink = a; return 11;
  }
  return a ^ k;
}
ALONE int early(int a, int *p) {
  if (!p) return -1;
  if (a < 0) { *p = leaf(a, a); return 0; }
  for (int i = 0; i < a; i++) if (leaf(i, *p) == 44) return i;
  return nested(*p) + leaf(*p, a);
}
ALONE int big(int a) { char b[5000]; fill(b, 5000); return leaf(b[a], a) + b[9]; }
ALONE int huge(int a) { char b[70000]; fill(b, 70000); return leaf(b[a], a) + b[9]; }
ALONE long long quotient(long long a, long long b) { return a / b + a % 7; }
struct wide { int v[20]; };
ALONE int by_value(struct wide w) { return w.v[3] + leaf(w.v[0], w.v[19]); }
ALONE int passes(int a) {
  struct wide w;
  memset(&w, a, sizeof w);
  return by_value(w) + w.v[1];
}
ALONE int variadic(int n, ...) {
  va_list l;
  va_start(l, n);
  int s = 0;
  while (n--) s = leaf(s, va_arg(l, int));
  va_end(l);
  return s;
}
ALONE int aligned(int a) {
  _Alignas(64) char b[64];
  fill(b, 64);
  return leaf(b[1], a) + ((int)b & 63);
}
__attribute__((noipa, noreturn)) void die(int a) { for (;;) sink = a; }
ALONE int checked(int a) { if (a > 50) die(a); return nested(a) + a; }

ALONE int vla(int n) { char b[n]; fill(b, n); return leaf(b[0], n); }
ALONE int recursive(int n) { return n < 2 ? 1 : leaf(n, recursive(n - 1)) + recursive(n - 2); }
int pong(int n);
ALONE int ping(int n) { return n ? leaf(pong(n - 1), n) : 0; }
ALONE int pong(int n) { return n ? leaf(ping(n - 1), 2 * n) : 1; }
ALONE int through(int (*f)(int), int a) { return f(a) + f(a + 1); }
ALONE int tail_through(int (*f)(int), int a) { return f(a + 1); }
ALONE int reaches_pointer(int a) { return through(nested, a) + 1; }

#define ROOT(name, expression) ALONE void run_##name(void) { sink = (int)(expression); }
ROOT(nested, nested(sink)) ROOT(deeper, deeper(sink)) ROOT(tail, tail(sink))
ROOT(doubles, doubles(real, 3.5)) ROOT(mixed, mixed((float)sink, real))
ROOT(tail_after_frame, tail_after_frame(7)) ROOT(table, table(3, sink))
ROOT(early, early(3, (int *)&sink)) ROOT(big, big(3)) ROOT(huge, huge(3))
ROOT(quotient, quotient(1LL << 40, sink + 5)) ROOT(passes, passes(3))
ROOT(variadic, variadic(3, 1, 2, 3)) ROOT(aligned, aligned(2)) ROOT(checked, checked(3))

#define ENTRY(name) {#name, run_##name},
static const struct { const char *name; void (*run)(void); } roots[] = {
  ENTRY(nested) ENTRY(deeper) ENTRY(tail) ENTRY(doubles) ENTRY(mixed) ENTRY(tail_after_frame)
  ENTRY(table) ENTRY(early) ENTRY(big) ENTRY(huge) ENTRY(quotient) ENTRY(passes) ENTRY(variadic)
  ENTRY(aligned) ENTRY(checked)
};

static int semihosting(int operation, const void *argument) {
  register int r0 __asm__("r0") = operation;
  register const void *r1 __asm__("r1") = argument;
  __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}
/* Paints 100 kB, calls, and counts what the call wrote below the stack pointer of the call. */
__attribute__((naked)) unsigned painted(void (*run)(void)) {
  __asm__("push {r4, r5, r6, lr}\n mov r4, sp\n ldr r5, =100000\n subs r5, r4, r5\n mov r6, r5\n"
          "ldr r1, =0xa5c35a3c\n 1: str r1, [r5], #4\n cmp r5, r4\n bne 1b\n"
          "blx r0\n ldr r1, =0xa5c35a3c\n 2: ldr r0, [r6], #4\n cmp r0, r1\n beq 2b\n"
          "subs r6, #4\n subs r0, r4, r6\n pop {r4, r5, r6, pc}\n .ltorg");
}
void reset(void) {
  *(volatile unsigned *)0xE000ED88 |= 0xF << 20; /* the FPU is off at reset */
  __asm__ volatile("dsb\n isb");
  real = 2.25;
  for (unsigned i = 0; i < sizeof roots / sizeof *roots; i++) {
    sink = 3;
    unsigned used = painted(roots[i].run);
    char digits[12], *p = digits + 11;
    *p = 0;
    *--p = '\n';
    do *--p = (char)('0' + used % 10); while (used /= 10);
    semihosting(4, roots[i].name);
    semihosting(4, " ");
    semihosting(4, p);
  }
  semihosting(0x18, (void *)0x20026); /* exit, without an error */
  for (;;) {}
}
__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {
  (void *)0x20100000, (void *)reset
};
"""

# name: (assembly, bound in bytes or the reason of the refusal)
ASSEMBLY: dict[str, tuple[str, int | str]] = {
    "leaf_only": ("adds r0, #1; bx lr", 0),
    "frame_pointer": ("push {r7, lr}; mov r7, sp; sub sp, #24; mov sp, r7; pop {r7, pc}", 32),
    "offset_pointer": (
        "push {r4, r5, r6, r7, lr}; add r7, sp, #12; str.w r8, [sp, #-4]!; sub.w sp, sp, #4096;"
        "ldr r0, [r7, #4]; add r1, r7, #4; sub.w r4, r7, #16; mov sp, r4; ldr.w r8, [sp], #4;"
        "pop {r4, r5, r6, r7, pc}",
        24 + 4096,
    ),
    # As LLVM aligns a frame: bfc may move the stack pointer by another 28 bytes.
    "aligns": (
        "push {r4, r6, r7, lr}; add r7, sp, #8; sub sp, #40; mov r4, sp; bfc r4, #0, #5;"
        "mov sp, r4; bl leaf_only; sub.w r4, r7, #8; mov sp, r4; pop {r4, r6, r7, pc}",
        16 + 40 + 28,
    ),
    "number": (
        "push {r4, lr}; movw r4, #0x2340; movt r4, #1; sub.w sp, sp, r4; bl leaf_only;"
        "add sp, r4; pop {r4, pc}",
        8 + 0x12340,
    ),
    "float_registers": (
        "push {r3, r4, r5, lr}; vpush {d8-d10}; vstmdb sp!, {s2}; strd r4, r5, [sp, #-16]!;"
        "ldrd r4, r5, [sp], #16; vldmia sp!, {s2}; vpop {d8-d10}; pop {r3, r4, r5, pc}",
        16 + 24 + 4 + 16,
    ),
    "block": (
        "cmp r0, #0; itt eq; moveq r0, #1; bxeq lr; push {r4, lr}; cmp r0, #2; itet ne;"
        "subne sp, #8; moveq r0, #1; addne sp, #8; it eq; popeq {r4, pc}; pop {r4, pc}",
        16,
    ),
    # LLVM's epilogues: one condition over two blocks, a store that closes the frame.
    "two_blocks": (
        "push {r4, lr}; sub sp, #8; cmp r0, #0; itt ne; movne r0, #1; addne sp, #8; it ne;"
        "popne {r4, pc}; str r0, [sp, #4]; vstmia sp!, {d0}; vldmia sp, {d1}; pop {r4, pc}",
        16,
    ),
    "table": (
        "tbb [pc, r0]; .byte 8, 15, 4, 0; .short 0xbf00, 0xbf00; push {r4, r5}; pop {r4, r5};"
        "bx lr; nop; push {r0-r7}; pop {r0-r7}; bx lr; nop; nop; nop; nop; nop; bx lr",
        32,
    ),
    "runs_on": ("push {r4}; pop {r4}; eor r1, r1, r0", 40),
    "next_one": ("push {r0-r9}; pop {r0-r9}; bx lr", 40),
    "branches_away": ("cbz r0, 1f; b leaf_only; 1: b.w next_one", 40),
    "never_back": ("push {r3, lr}; bl endless", 12),
    "endless": ("push {r3}; 1: b 1b", 4),
    "other_stack": ("msr msp, r0; bx lr", "changes the stack pointer"),
    "from_register": ("mov sp, r0; bx lr", "gives the stack pointer an unknown value"),
    "forgotten": (
        "push {r7, lr}; mov r7, sp; ldr r7, [r0]; mov sp, r7; pop {r7, pc}",
        "gives the stack pointer an unknown value",
    ),
    "written_back": (
        "push {r7, lr}; mov r7, sp; ldr r0, [r7], #4; mov sp, r7; pop {r7, pc}",
        "gives the stack pointer an unknown value",
    ),
    "not_kept": (
        "push {r4, lr}; mov r2, sp; bl leaf_only; mov sp, r2; pop {r4, pc}",
        "gives the stack pointer an unknown value",
    ),
    "two_values": (
        "mov r4, sp; cbz r0, 1f; sub.w r4, r4, #8; 1: mov sp, r4; bx lr",
        "gives the stack pointer an unknown value",
    ),
    "pushes_in_loop": ("1: push {r0}; cmp r1, #0; bne 1b; b 1b", "grows in a loop"),
    "unbalanced": ("push {r0, r1}; pop {r0}; bx lr", "4 bytes still on the stack"),
    "pops_too_much": ("pop {r0}; bx lr", "pops more than was pushed"),
    "below": ("str r0, [sp, #-8]; bx lr", "below it"),
    "loads_pc": ("ldr pc, [r0]", "not known"),
    "pops_pc_elsewhere": ("ldmia r0!, {r1, pc}", "not known"),
    "jumps": ("bx r3", "not known"),
    "moves_pc": ("mov pc, r3", "not known"),
    "own_condition": (
        "push {r4}; itt eq; cmpeq r0, #1; addeq sp, #4; pop {r4}; bx lr",
        "pops more than was pushed",
    ),
    # As libgcc's multiplication does it: a part of a function that returns to it, or for it.
    "calls_itself": (
        "push {r4, lr}; bl 1f; pop {r4, pc}; 1: push {r5}; pop {r5}; cbz r0, 2f; pop {r4, pc};"
        "2: bx lr",
        12,
    ),
    "calls_itself_twice": (
        "mov ip, lr; bl 1f; bl 1f; push {r0-r9}; pop {r0-r9}; bx ip; 1: push {r5}; pop {r5}; bx lr",
        "not known",
    ),
    "saves_lr_itself": (
        "push {r4, lr}; bl 1f; pop {r4, pc}; 1: push {lr}; pop {pc}",
        "uses lr in a part",
    ),
    "changed_condition": (
        "push {r4, lr}; ittte ne; andsne r0, r1; cmpne r0, #1; cmpne r0, #2; bleq next_one;"
        "pop {r4, pc}",
        48,
    ),
    "no_instruction": (".inst.w 0xe8000000; bx lr", "no instruction"),
    "falls_into_data": ("nop; .word 0x12345678", "runs into data"),
}


def assembly() -> str:
    """The assembly functions, in order, as a source."""
    lines = [".syntax unified", ".text", ".thumb"]
    for name, (body, _) in ASSEMBLY.items():
        pool = [".pool", ".balign 4"] if name != "runs_on" else []
        start = [f".global {name}", f".type {name}, %function", ".thumb_func", f"{name}:"]
        lines += [*start, *body.split(";"), f".size {name}, . - {name}", *pool]
    return "\n".join(lines) + "\n"


def gcc(folder: Path, *arguments: str) -> None:
    subprocess.run(["arm-none-eabi-gcc", *FLAGS, *arguments], cwd=folder, check=True)


@pytest.fixture(scope="module", params=LEVELS)
def built(request, tmp_path_factory) -> Path:
    """The folder of the program, compiled at one level of optimisation."""
    folder = tmp_path_factory.mktemp("firmware")
    (folder / "script.ld").write_text(SCRIPT)
    (folder / "program.c").write_text(PROGRAM)
    gcc(folder, *request.param.split(" "), "-fstack-usage", "-c", "program.c")
    gcc(folder, "-nostdlib", "-T", "script.ld", "program.o", "-lc", "-lgcc", "-o", "program.elf")
    return folder


@pytest.fixture
def image(built: Path) -> Image:
    return Image.load(built / "program.elf")


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory) -> Image:
    """The image of the assembly functions."""
    folder = tmp_path_factory.mktemp("assembly")
    (folder / "functions.s").write_text(assembly())
    options = ["-nostdlib", "-Wl,--entry=leaf_only", "-Wl,-Ttext=0x8000"]
    gcc(folder, *options, "functions.s", "-o", "functions.elf")
    return Image.load(folder / "functions.elf")


BOARD = [
    *["qemu-system-arm", "-M", "mps2-an386", "-nodefaults", "-display", "none", "-serial", "none"],
    *["-monitor", "none", "-chardev", "stdio,id=sh", "-semihosting-config"],
    *["enable=on,target=native,chardev=sh", "-kernel"],
]
UNBOUNDED = {"vla", "recursive", "ping", "pong", "through", "tail_through", "reaches_pointer"}


@needs_gcc
def test_each_frame_is_the_one_that_gcc_reports(built: Path, image: Image):
    # gcc leaves out the argument registers that by_value and variadic push: 16 bytes.
    pushed = {"by_value": 16, "variadic": 16}
    refused = set()
    for line in (built / "program.su").read_text().splitlines():
        place, size, kind = line.split("\t")
        name = place.split(":")[-1]
        try:
            frame = image.frame(name)
        except Unproved:
            refused.add(name)
        else:
            assert (name, kind, frame) == (name, "static", int(size) + pushed.get(name, 0))
    assert refused == UNBOUNDED | {"painted", "reset"}


@needs_gcc
def test_bounds_hold_on_the_board_and_are_reached(built: Path, image: Image):
    command = [*BOARD, built / "program.elf"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    used = {line.split(" ")[0]: int(line.split(" ")[1]) for line in done.stdout.splitlines()}
    assert len(used) == 15
    for name, most in used.items():
        bound = image.stack_bound(f"run_{name}")
        # The last words of a frame may be padding that nothing writes.
        slack = 16 if name in ("aligned", "variadic") else 0
        assert bound - slack <= most <= bound, name


@needs_gcc
def test_what_has_no_bound_is_refused_with_its_place(image: Image):
    for name, function, reason in [
        ("vla", "vla", "gives the stack pointer an unknown value"),
        ("recursive", "recursive", "is recursive"),
        ("ping", "ping", "is recursive"),
        ("through", "through", "not known"),
        ("tail_through", "tail_through", "not known"),
        ("reaches_pointer", "through", "not known"),
    ]:
        with pytest.raises(Unproved, match=reason) as refused:
            image.stack_bound(name)
        assert refused.value.function == function
        assert (refused.value.instruction is None) == (reason == "is recursive")
    with pytest.raises(Unproved, match=r"^vla at 0x[0-9a-f]+ `sub.*sp, .*`: gives"):
        image.stack_bound("vla")


@needs_gcc
def test_call_graph_and_code_size(image: Image):
    assert image.reachable("nested") == {"nested", "leaf"}
    assert {"deeper", "leaf", "fill", "nested"} == image.reachable("deeper")
    assert {"deeper", "__aeabi_dmul"} < image.reachable("table") - {"die"}
    assert "die" in image.reachable("checked")
    sizes = {f.name: f.size for f in image.functions.values()}
    assert image.text_bytes("nested") == sizes["nested"] + sizes["leaf"]
    # A sum, a product and a quotient of libgcc share code: no byte counts twice.
    reached = image.reachable("doubles")
    assert image.text_bytes("doubles") <= sum(sizes[name] for name in reached)
    with pytest.raises(Unproved, match="through at"):
        image.reachable("reaches_pointer")
    assert image.reachable("reaches_pointer", indirect=True) == {"reaches_pointer", "through"}
    assert image.stack_path("run_tail")[0][0] == "run_tail"
    assert image.stack_path("run_tail")[-1][1] <= image.stack_bound("run_tail")
    assert 0 < image.count_instructions("leaf") < image.count_instructions("nested")
    assert sum(sizes.values()) < image.text_total() < 20_000
    with pytest.raises(ImageError, match="no function of the name 'nesting'"):
        image.stack_bound("nesting")


@needs_gcc
@pytest.mark.parametrize("name", ASSEMBLY)
def test_assembly_by_hand(by_hand: Image, name: str):
    expected = ASSEMBLY[name][1]
    if isinstance(expected, int):
        assert by_hand.stack_bound(name) == expected
    else:
        with pytest.raises(Unproved, match=re.escape(expected)):
            by_hand.stack_bound(name)


@needs_gcc
def test_a_heap_shows(tmp_path: Path, image: Image):
    assert image.allocator_symbols() == []
    assert image.undefined() == []
    source = """
    #include <stdlib.h>
    char heap[4096], *top = heap;
    void *_sbrk(int n) { char *p = top; top += n; return p; }
    int main(void) { char *volatile p = malloc(40); p[3] = 4; free(p); return 0; }
    """
    (tmp_path / "heap.c").write_text(source)
    gcc(tmp_path, "-O2", "-nostartfiles", "-Wl,--entry=main", "heap.c", "-o", "heap.elf")
    heap = Image.load(tmp_path / "heap.elf")
    assert {"malloc", "free", "_sbrk", "_malloc_r"} <= set(heap.allocator_symbols())
    # What the linker is told to leave undefined is wanted all the same. (GNU ld forgets it.)
    if shutil.which("ld.lld"):
        gcc(tmp_path, "-O2", "-c", "heap.c")
        link = ["ld.lld", "--unresolved-symbols=ignore-all", "-e", "main", "heap.o"]
        subprocess.run(link, cwd=tmp_path, check=True)
        wanting = Image.load(tmp_path / "a.out")
        assert wanting.undefined() == ["free", "malloc"]
        assert wanting.allocator_symbols() == ["_sbrk", "free", "malloc"]


@needs_gcc
def test_files_that_are_no_image(tmp_path: Path, built: Path):
    with pytest.raises(ImageError, match="not a linked executable"):
        Image.load(built / "program.o")
    with pytest.raises(ImageError, match=r"absent\.elf"):
        Image.load(tmp_path / "absent.elf")
    stripped = tmp_path / "stripped.elf"
    strip = ["arm-none-eabi-strip", built / "program.elf", "-o", stripped]
    subprocess.run(strip, check=True)
    with pytest.raises(ImageError, match="without stripping"):
        Image.load(stripped)
    (tmp_path / "arm.c").write_text("int main(void) { return 3; }")
    command = [
        "arm-none-eabi-gcc",
        "-marm",
        "-nostdlib",
        "-Wl,--entry=main",
        "arm.c",
        "-o",
        "arm.elf",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)
    with pytest.raises(ImageError, match="main is ARM code"):
        Image.load(tmp_path / "arm.elf")


# --- toolchain -------------------------------------------------------------------------------


@pytest.fixture
def bare(tmp_path: Path, monkeypatch):
    """A machine whose PATH holds nothing, and no Rust with its source."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("HGO_FIRMWARE_CORE", raising=False)
    monkeypatch.setattr(toolchain, "_own_compiler", lambda: None)
    return tmp_path


def tool(folder: Path, name: str, body: str = "") -> None:
    (folder / name).write_text(f"#!/bin/sh\n{body}\n")
    (folder / name).chmod(0o755)


def test_what_is_missing_is_listed_with_its_packages(bare: Path, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(toolchain.ToolchainError) as refused:
        toolchain.require()
    message = str(refused.value)
    assert "qemu-system-arm, qemu-system-aarch64, qemu-system-riscv32, arm-none-eabi-gcc" in message
    assert "aarch64-linux-gnu-objdump, riscv64-unknown-elf-objdump, node" in message
    line = next(line for line in message.splitlines() if "apt-get install" in line)
    assert line.split("--no-install-recommends ")[1].split(" ") == sorted(
        ["qemu-system-arm", "gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "nodejs", "lld"]
        + ["qemu-system-misc", "binutils-aarch64-linux-gnu", "binutils-riscv64-unknown-elf"]
        + ["binutils-arm-none-eabi", "rust-web-src"]
        + ["rustc-web"] * (not Path("/usr/bin/rustc").exists())
    )
    chips = "thumbv7em-none-eabihf aarch64-unknown-none riscv32imafc-unknown-none-elf"
    assert f"rustup target add {chips} wasm32-unknown-unknown" in message
    with pytest.raises(toolchain.ToolchainError, match="no precompiled core for thumbv7em"):
        toolchain.Toolchain.find(toolchain.THUMB)


def test_root_installs_exactly_what_is_missing(bare: Path, monkeypatch, capsys):
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    tool(bare, "node")
    tool(bare, "arm-none-eabi-gcc", 'echo "libm.a"')  # as gcc says that it has none
    tool(
        bare,
        "apt-get",
        f'echo "$@" >> {bare}/log; [ $1 = install ] || exit 100; cd {bare}\n'
        "for t in qemu-system-arm arm-none-eabi-objdump; do echo > $t; /bin/chmod +x $t; done\n"
        "printf '#!/bin/sh\\necho /usr/lib/libm.a\\n' > arm-none-eabi-gcc",
    )
    needed = ("qemu-system-arm", "arm-none-eabi-gcc", "arm-none-eabi-objdump", "node")
    toolchain.require(needed, targets=())
    packages = "binutils-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
    assert capsys.readouterr().err == f"firmware: installing {packages}\n"
    assert (bare / "log").read_text().splitlines() == [
        "-q update",
        f"install -y --no-install-recommends {packages}",
    ]
    toolchain.require(needed, targets=())  # nothing is left to do
    assert len((bare / "log").read_text().splitlines()) == 2


def test_an_install_that_fails_says_so(bare: Path, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    tool(bare, "apt-get", "echo E: no such package >&2; exit 100")
    with pytest.raises(toolchain.ToolchainError, match=r"needs node(?s:.*)E: no such package"):
        toolchain.require(["node"], targets=())


def test_a_precompiled_core_is_preferred_unless_own_is_asked_for(bare: Path, monkeypatch):
    library = bare / "library"
    library.mkdir()
    (library / "libcore-0.rlib").touch()
    tool(bare, "rustc", f"echo {library}")
    found = toolchain.Toolchain.find(toolchain.THUMB, "cortex-m7")
    assert (found.kind, found.rustc, found.linker) == ("rustup", "rustc", None)
    assert found.environment()["CARGO_ENCODED_RUSTFLAGS"] == "-Ctarget-cpu=cortex-m7"
    assert found.cargo("-p", "board")[-4:] == ["--target", toolchain.THUMB, "-p", "board"]
    assert "lld" not in toolchain.missing()
    monkeypatch.setenv("HGO_FIRMWARE_CORE", "own")
    assert toolchain.CORE in toolchain.missing()
    assert toolchain.missing()["lld"] == ["lld"]


def test_an_own_core_is_compiled_once_and_whole(bare: Path, monkeypatch):
    monkeypatch.setenv("HGO_FIRMWARE_CORE", "own")
    monkeypatch.setattr(toolchain, "SYSROOTS", bare / "sysroot")
    monkeypatch.setattr(toolchain, "_own_compiler", lambda: (str(bare / "rustc"), bare))
    tool(bare, "ld.lld")
    tool(bare, "rustc", f'echo rustc 1.96; [ "$1" = -vV ] || echo "$@" >> {bare}/log')
    first = toolchain.Toolchain.find(toolchain.THUMB, "cortex-m4")
    assert first == toolchain.Toolchain.find(toolchain.THUMB)
    calls = (bare / "log").read_text().splitlines()
    assert [re.findall("crate-name=([a-z_]+)", call) for call in calls] == [
        ["core"],
        ["compiler_builtins"],
    ]
    assert all("-Ctarget-cpu=cortex-m4" in call for call in calls)
    assert first.environment()["CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER"] == str(bare / "ld.lld")
    sysroot = Path(first.flags[1])
    assert (sysroot / "lib/rustlib/thumbv7em-none-eabihf/lib").is_dir()
    # A build that fails leaves nothing behind.
    tool(bare, "rustc", '[ "$1" = -vV ] && echo rustc 1.97 || { echo error: E0514 >&2; exit 1; }')
    with pytest.raises(toolchain.ToolchainError, match=r"could not compile(?s:.*)E0514"):
        toolchain.Toolchain.find(toolchain.THUMB, "cortex-m7")
    left = [path.name for path in (bare / "sysroot").glob("*/*")]
    assert left == ["thumbv7em-none-eabihf-cortex-m4"]


def test_unknown_names_are_refused(monkeypatch):
    with pytest.raises(toolchain.ToolchainError, match="no target 'thumbv6m'"):
        toolchain.Toolchain.find("thumbv6m")
    with pytest.raises(toolchain.ToolchainError, match="no cpu 'cortex-m0'"):
        toolchain.Toolchain.find(toolchain.THUMB, "cortex-m0")
    with pytest.raises(toolchain.ToolchainError, match="no tool 'gdb'"):
        toolchain.require(["gdb"])
    monkeypatch.setenv("HGO_FIRMWARE_CORE", "mine")
    with pytest.raises(toolchain.ToolchainError, match="it is 'own'"):
        toolchain.Toolchain.find(toolchain.THUMB)
