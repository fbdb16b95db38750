"""Compilers, linkers and simulators of the firmware: finds them, or makes them.

The chip needs a `core` library for its target. There are two ways to one:

- "rustup": the precompiled one that `rustup target add thumbv7em-none-eabihf` fetches, for the
  `rustc` on PATH;
- "own": where no target can be fetched, `core` and `compiler_builtins` compiled from the library
  source that Debian packages (rust-web-src) with the compiler of the same package (rustc-web).
  It takes about 20 s a target and is kept under firmware/target/sysroot. No `alloc` is in it.

HGO_FIRMWARE_CORE=own takes the second way even where the first is open.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parents[1]
SYSROOTS = FIRMWARE / "target" / "sysroot"

THUMB = "thumbv7em-none-eabihf"
A64 = "aarch64-unknown-none"
RISCV = "riscv32imafc-unknown-none-elf"
WASM = "wasm32-unknown-unknown"
# The processors of each target; the first is the default. "generic" adds no -C target-cpu.
CPUS = {
    THUMB: ("cortex-m4", "cortex-m7"),
    A64: ("cortex-a53",),
    RISCV: ("generic-rv32",),
    WASM: ("generic",),
}
# The linkers of Debian's package lld. A rustup toolchain brings its own.
LINKERS = {THUMB: "ld.lld", A64: "ld.lld", RISCV: "ld.lld", WASM: "wasm-ld"}

# What is looked for, and the Debian packages that hold it.
PACKAGES: Mapping[str, tuple[str, ...]] = {
    "qemu-system-arm": ("qemu-system-arm",),
    "qemu-system-aarch64": ("qemu-system-arm",),
    "qemu-system-riscv32": ("qemu-system-misc",),
    "arm-none-eabi-gcc": ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi"),
    "arm-none-eabi-objdump": ("binutils-arm-none-eabi",),
    "aarch64-linux-gnu-objdump": ("binutils-aarch64-linux-gnu",),
    "riscv64-unknown-elf-objdump": ("binutils-riscv64-unknown-elf",),
    "node": ("nodejs",),
}
# What compiles a core, in the same sense.
CORE = "a rustc with its library source"
TOOLS = tuple(PACKAGES)
TARGETS = tuple(CPUS)

# core and compiler_builtins as their own build does it. The second's build script (which needs
# crates that are not packaged) only sets these for a bare processor or WebAssembly.
COMMON = [
    "--edition=2024",
    "--crate-type=rlib",
    "-Copt-level=3",
    "-Cpanic=abort",
    "-Zforce-unstable-if-unmarked",
    "--cap-lints=allow",
]
BUILTINS = [
    '--cfg=feature="compiler-builtins"',
    '--cfg=feature="unstable-intrinsics"',
    '--cfg=feature="mem"',
    "--cfg=intrinsics_enabled",
    "--cfg=arch_enabled",
    "--cfg=optimizations_enabled",
    "-Ccodegen-units=10000",
]
BUILTINS_ENV = {"CFG_CARGO_FEATURES": "[]", "CFG_OPT_LEVEL": "3", "CFG_TARGET_FEATURES": "[]"}


class ToolchainError(RuntimeError):
    """A tool is missing or failed; the message says which, and what to do."""


def _output(*command: str, timeout: float | None = None) -> str:
    """What a command prints, stripped; "" if it is not there or fails."""
    # In firmware/, as cargo is: a toolchain file of the folder counts for both.
    try:
        done = subprocess.run(
            command, cwd=FIRMWARE, capture_output=True, text=True, timeout=timeout, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _own_forced() -> bool:
    choice = os.environ.get("HGO_FIRMWARE_CORE", "")
    if choice not in ("", "own"):
        raise ToolchainError(
            f"HGO_FIRMWARE_CORE={choice!r}: it is 'own' (compile core here) or not set"
        )
    return choice == "own"


def _has_core(target: str) -> bool:
    """Whether the `rustc` on PATH has a precompiled core of the target."""
    folder = _output("rustc", "--print", "target-libdir", "--target", target)
    return bool(folder) and any(Path(folder).glob("libcore-*.rlib"))


@cache
def _add_with_rustup(target: str) -> None:
    """One quiet try to fetch the precompiled core; no network is no error."""
    if shutil.which("rustup"):
        _output("rustup", "target", "add", target, timeout=60.0)


def _use_rustup(target: str) -> bool:
    if _own_forced():
        return False
    if not _has_core(target):
        _add_with_rustup(target)
    return _has_core(target)


def _own_compiler() -> tuple[str, Path] | None:
    """A rustc that has the source of its library beside it, and the folder of that source."""
    for rustc in ("/usr/bin/rustc", "rustc"):
        sysroot = _output(rustc, "--print", "sysroot")
        library = Path(sysroot, "lib/rustlib/src/rust/library")
        if sysroot and (library / "core/src/lib.rs").is_file():
            return rustc, library.resolve()
    return None


@dataclass(frozen=True)
class Toolchain:
    """How to compile for one target and one processor. Made by `Toolchain.find`."""

    target: str
    cpu: str
    kind: str
    """Where core comes from: "rustup" or "own"."""
    rustc: str
    flags: tuple[str, ...]
    linker: str | None
    """None: the target's default, the rust-lld of the rustup toolchain."""

    @classmethod
    def find(cls, target: str, cpu: str | None = None) -> Toolchain:
        """The toolchain of a target and a processor; compiles its `core` if it has to."""
        if target not in CPUS:
            raise ToolchainError(f"no target {target!r}: it is one of {', '.join(CPUS)}")
        cpu = CPUS[target][0] if cpu is None else cpu
        if cpu not in CPUS[target]:
            raise ToolchainError(f"no cpu {cpu!r} for {target}: it is one of {CPUS[target]}")
        flags = () if cpu == "generic" else (f"-Ctarget-cpu={cpu}",)
        if _use_rustup(target):
            return cls(target, cpu, "rustup", "rustc", flags, None)
        own = _own_compiler()
        linker = shutil.which(LINKERS[target])
        if own is None or linker is None:
            raise ToolchainError(
                f"no precompiled core for {target}, and no"
                f" {CORE if own is None else LINKERS[target]} to make one with: run\n"
                f"  rustup target add {target}\nor on Debian, as root,\n"
                f"  {_apt_line(('rustc-web', 'rust-web-src', 'lld'))}"
            )
        rustc, library = own
        sysroot = _sysroot(rustc, library, target, cpu, flags)
        return cls(target, cpu, "own", rustc, ("--sysroot", str(sysroot), *flags), linker)

    @property
    def name(self) -> str:
        """Of a build folder that no other target, processor or kind of core shares."""
        return f"{self.target}-{self.cpu}-{self.kind}"

    def environment(self) -> dict[str, str]:
        """The process's environment with what cargo needs.

        The flags hold for the target alone: cargo, given --target, keeps them from build scripts
        and procedural macros. They replace RUSTFLAGS, so that nobody's settings change the counts.
        """
        env = {
            **os.environ,
            "RUSTC": self.rustc,
            "CARGO_ENCODED_RUSTFLAGS": "\x1f".join(self.flags),
        }
        if self.linker is not None:
            variable = self.target.upper().replace("-", "_")
            env[f"CARGO_TARGET_{variable}_LINKER"] = self.linker
        return env

    def cargo(self, *arguments: str) -> list[str]:
        """The command `cargo build --release --target T` with further arguments."""
        return ["cargo", "build", "--release", "--target", self.target, *arguments]


def _sysroot(rustc: str, library: Path, target: str, cpu: str, flags: Sequence[str]) -> Path:
    """A folder that `--sysroot` takes, with core and compiler_builtins of the target."""
    version = _output(rustc, "-vV")
    recipe = "\n".join([version, str(library), *COMMON, *BUILTINS])
    place = SYSROOTS / hashlib.sha256(recipe.encode()).hexdigest()[:16] / f"{target}-{cpu}"
    if place.is_dir():
        return place
    say(f"compiling core for {target} {cpu} with {version.splitlines()[0]} (about 20 s, once)")
    place.parent.mkdir(parents=True, exist_ok=True)
    # Made beside its place and moved there whole: a build that was stopped leaves no half of one.
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=".making-") as temporary:
        made = Path(temporary, "sysroot")
        out = made / "lib" / "rustlib" / target / "lib"
        out.mkdir(parents=True)
        command = [rustc, *COMMON, "--target", target, *flags, "--out-dir", str(out)]
        _compile([*command, "--crate-name=core", str(library / "core/src/lib.rs")])
        builtins = [*BUILTINS, *(["--cfg=thumb"] if target.startswith("thumb") else [])]
        source = library / "compiler-builtins/compiler-builtins/src/lib.rs"
        extern = f"--extern=core={out / 'libcore.rlib'}"
        _compile([*command, "--crate-name=compiler_builtins", extern, *builtins, str(source)])
        try:
            made.rename(place)
        except OSError:
            if not place.is_dir():  # not that another process was faster
                raise
    return place


def _compile(command: Sequence[str]) -> None:
    env = {**os.environ, **BUILTINS_ENV, "RUSTC_BOOTSTRAP": "1"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        tail = "\n".join(done.stderr.strip().splitlines()[-20:])
        raise ToolchainError(
            f"{command[0]} could not compile {command[-1]}; does the source's version match"
            f" the compiler's?\n{tail}"
        )


def say(line: str) -> None:
    """One line for the person who waits."""
    print(f"firmware: {line}", file=sys.stderr, flush=True)


def _apt_line(packages: Iterable[str]) -> str:
    return f"apt-get install -y --no-install-recommends {' '.join(packages)}"


def missing(tools: Iterable[str] = TOOLS, targets: Iterable[str] = TARGETS) -> dict[str, list[str]]:
    """What is not on this machine, with the Debian packages that hold it."""
    lacking: dict[str, list[str]] = {}
    for tool in tools:
        if tool not in PACKAGES:
            raise ToolchainError(f"no tool {tool!r}: it is one of {', '.join(PACKAGES)}")
        if not shutil.which(tool):
            lacking[tool] = list(PACKAGES[tool])
        # gcc prints the bare name of a library that it does not find.
        elif tool.endswith("gcc") and "/" not in _output(tool, "-print-file-name=libm.a"):
            lacking["newlib for arm-none-eabi"] = ["libnewlib-arm-none-eabi"]
    if not all(_use_rustup(target) for target in targets):
        if _own_compiler() is None:
            compiler = [] if Path("/usr/bin/rustc").exists() else ["rustc-web"]
            lacking[CORE] = [*compiler, "rust-web-src"]
        if not all(shutil.which(LINKERS[target]) for target in targets):
            lacking["lld"] = ["lld"]
    return lacking


def require(tools: Iterable[str] = TOOLS, targets: Iterable[str] = TARGETS) -> None:
    """Sees that the tools are there, and a way to a core for the targets.

    What is missing is installed if this is root on a machine with apt-get; otherwise the error
    lists it with the line that installs it.
    """
    tools, targets = tuple(tools), tuple(targets)
    lacking = missing(tools, targets)
    if not lacking:
        return
    packages = sorted({package for group in lacking.values() for package in group})
    line = _apt_line(packages)
    if os.geteuid() == 0 and shutil.which("apt-get"):
        say(f"installing {' '.join(packages)}")
        env = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        # An update may fail for one source of many; what counts is what is there afterwards.
        for command in (["apt-get", "-q", "update"], line.split()):
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        lacking = missing(tools, targets)
        if not lacking:
            return
        line += "\n" + "\n".join(done.stderr.strip().splitlines()[-5:])
    if CORE in lacking:
        line += f"\nor, in place of the Rust packages:\n  rustup target add {' '.join(targets)}"
    raise ToolchainError(f"the firmware needs {', '.join(lacking)}; on Debian, as root:\n  {line}")


def versions(toolchain: Toolchain) -> dict[str, str]:
    """The versions for a report: compilers, simulators, and which kind of core."""

    def first_line(*command: str) -> str:
        return (_output(*command).splitlines() or ["not installed"])[0]

    return {
        "rustc": first_line(toolchain.rustc, "-V"),
        "core": toolchain.kind,
        "arm-none-eabi-gcc": first_line("arm-none-eabi-gcc", "--version"),
        "qemu": first_line("qemu-system-arm", "--version"),
        "node": first_line("node", "--version"),
    }


if __name__ == "__main__":
    try:
        require()
    except ToolchainError as error:
        sys.exit(str(error))
