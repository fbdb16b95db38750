"""Wheels for Linux and Windows, made on this machine and tried where they can run.

    python .ci/wheels.py build [TARGET ...]   # dist/*.whl, by maturin with zig or MinGW
    python .ci/wheels.py try [WHEEL ...]      # the digests of .ci/wheel.py, of each wheel of dist/

A wheel for another processor runs under qemu-user on Debian's Python for it; one for Windows under
wine on the CPython that the wheel of panda3d brings for its own use. `try` leaves out, and says so,
what has no tool here: musl without a Python for it (HGO_MUSL_PYTHON), macOS always. All but the
wheels themselves is kept under target/wheels.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST, KEPT = ROOT / "dist", ROOT / "target" / "wheels"
DIGESTS = ROOT / ".ci" / "wheel.py"
MOST = 6 * 10**6
"""Bytes of the largest wheel."""
OLDER = ("numpy<2",)
"""NumPy 2 calls what the C library of wine 8 does not have, and crashes on Debian's musl 1.2.3."""

TARGETS = {
    "x86_64-unknown-linux-gnu": "manylinux2014",
    "aarch64-unknown-linux-gnu": "manylinux2014",
    "x86_64-unknown-linux-musl": "musllinux_1_2",
    "aarch64-unknown-linux-musl": "musllinux_1_2",
    "x86_64-pc-windows-gnu": "",
}
"""What is built, and the libc that zig links against: glibc 2.17, musl 1.2."""


class Missing(Exception):
    """A tool that is not on this machine."""


def run(*words: object, env: dict[str, str] | None = None) -> str:
    command = [str(word) for word in words]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **(env or {})}, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(f"{' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def need(tool: str, package: str) -> str:
    if found := shutil.which(tool):
        return found
    raise Missing(f"no {tool}: on Debian apt-get install {package}")


def build(target: str) -> None:
    libdir = run("rustc", "--print", "target-libdir", "--target", target).strip()
    if not Path(libdir).is_dir():
        run("rustup", "target", "add", target)
    linked = ["--zig", "--compatibility", TARGETS[target]]
    if not TARGETS[target]:
        need("x86_64-w64-mingw32-gcc", "gcc-mingw-w64-x86-64")
        linked = []
    own = {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
    maturin = [sys.executable, "-m", "maturin", "build", "--release", "--out", DIST]
    run(*maturin, "--target", target, *linked, env=own)


# --- where a wheel is tried ----------------------------------------------------------------------


def installed(
    wheel: Path, name: str, python: str, platforms: list[str], more: tuple[str, ...] = ()
) -> Path:
    """A folder with a wheel and what it declares, for another machine than this."""
    place = KEPT / name
    shutil.rmtree(place, ignore_errors=True)
    tags = [word for tag in platforms for word in ("--platform", tag)]
    abis = ["--abi", f"cp{python.replace('.', '')}", "--abi", "abi3", "--abi", "none"]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
    run(*pip, "--target", place, "--python-version", python, *abis, *tags, wheel, *more)
    return place


def here(wheel: Path) -> str:
    home = KEPT / "here"
    run(sys.executable, "-m", "venv", "--clear", home)
    run(home / "bin" / "python", "-m", "pip", "install", "--quiet", wheel)
    return run(home / "bin" / "python", DIGESTS)


def under_qemu(wheel: Path) -> str:
    """On the Python of Debian for the other processor, unpacked by an apt of its own."""
    qemu = need("qemu-aarch64", "qemu-user")
    root, apt = KEPT / "aarch64", KEPT / "aarch64-apt"
    if not (root / "usr/bin/python3").exists():
        need("apt-get", "apt")
        for folder in ("lists/partial", "cache/archives/partial"):
            (apt / folder).mkdir(parents=True, exist_ok=True)
        (apt / "status").touch()
        settings = {
            "APT::Architecture": "arm64",
            "APT::Architectures": "arm64",
            "Dir::State": apt,
            "Dir::State::status": apt / "status",
            "Dir::Cache": apt / "cache",
            "APT::Sandbox::User": "root",
        }
        options = [word for key, value in settings.items() for word in ("-o", f"{key}={value}")]
        run("apt-get", *options, "-qq", "update")
        fetch = ("install", "-qq", "--download-only", "--no-install-recommends", "-y")
        run("apt-get", *options, *fetch, "python3", "libpython3-stdlib", "libstdc++6")
        for package in sorted((apt / "cache/archives").glob("*.deb")):
            run("dpkg-deb", "-x", package, root)
    python = (root / "usr/bin/python3").readlink().name.removeprefix("python")
    tags = [f"manylinux_2_{minor}_aarch64" for minor in (17, 24, 26, 27, 28, 31, 34)]
    site = installed(wheel, "aarch64-site", python, ["manylinux2014_aarch64", *tags])
    return run(qemu, "-L", root, root / "usr/bin/python3", DIGESTS, env={"PYTHONPATH": str(site)})


_STUB = """#include <windows.h>
int wmain(int n, wchar_t **a)
{ return ((int (*)(int, wchar_t **))GetProcAddress(LoadLibraryW(L"%s.dll"), "Py_Main"))(n, a); }
"""
_PRIMITIVES = """#include <windows.h>
#include <bcrypt.h>
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE out, SIZE_T n)
{ return BCryptGenRandom(0, out, n, BCRYPT_USE_SYSTEM_PREFERRED_RNG) >= 0; }
"""
"""Rust's source of random bytes, which wine before version 9 does not have."""


def under_wine(wheel: Path) -> str:
    """On the python3*.dll of panda3d's wheel, with this Python's library of the same version."""
    wine, gcc = need("wine", "wine64"), need("x86_64-w64-mingw32-gcc", "gcc-mingw-w64-x86-64")
    dump = need("x86_64-w64-mingw32-objdump", "binutils-mingw-w64-x86-64")
    version = ".".join(platform.python_version_tuple()[:2])
    name = f"python{version.replace('.', '')}"
    home = KEPT / "windows"
    site = installed(wheel, "windows-site", version, ["win_amd64"], OLDER)
    if not (home / f"{name}.dll").exists():
        (home / "Lib").parent.mkdir(parents=True, exist_ok=True)
        fetch = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", home]
        where = ["--only-binary", ":all:", "--platform", "win_amd64", "--python-version", version]
        run(*fetch, *where, "panda3d")
        with zipfile.ZipFile(next(home.glob("panda3d*.whl"))) as archive:
            for entry in archive.namelist():
                if entry.startswith("deploy_libs/") and not Path(entry).name.startswith("api-"):
                    (home / Path(entry).name).write_bytes(archive.read(entry))
        library = Path(os.__file__).parent
        ignored = shutil.ignore_patterns("site-packages", "lib-dynload", "test", "__pycache__")
        shutil.copytree(library, home / "Lib", ignore=ignored, dirs_exist_ok=True)
        (home / "stub.c").write_text(_STUB % name)
        (home / "primitives.c").write_text(_PRIMITIVES)
        run(gcc, "-municode", "-o", home / "python.exe", home / "stub.c")
        shared = [gcc, "-shared", "-o"]
        run(*shared, home / "bcryptprimitives.dll", home / "primitives.c", "-lbcrypt")
    # python3.dll, the stable interface, hands on what the module takes of it
    taken: list[str] = []
    for line in run(dump, "-p", site / "hgo_rs" / "_core.pyd").splitlines():
        if "DLL Name:" in line:
            mine = line.split()[-1] == "python3.dll"
        elif len(words := line.split()) == 3 and words[2].lstrip("_").startswith("Py") and mine:
            taken.append(words[2])
    exports = "".join(f"  {symbol} = {name}.{symbol}\n" for symbol in sorted(set(taken)))
    (home / "python3.def").write_text(f"LIBRARY python3.dll\nEXPORTS\n{exports}")
    run(gcc, "-shared", "-nostdlib", "-o", home / "python3.dll", home / "python3.def")
    windows = {
        "WINEPREFIX": str(home / "prefix"),
        "WINEDEBUG": "-all",
        "PYTHONHOME": f"Z:{home}",
        "PYTHONPATH": f"Z:{site};Z:{home}",
    }
    return run(wine, home / "python.exe", f"Z:{DIGESTS}", env=windows)


def on_musl(wheel: Path) -> str:
    python = os.environ.get("HGO_MUSL_PYTHON")
    if not python:
        raise Missing("no Python for musl: name one by HGO_MUSL_PYTHON, such as that of Alpine")
    told = run(python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip()
    tags = [f"musllinux_1_{minor}_{platform.machine()}" for minor in (1, 2)]
    site = installed(wheel, "musl-site", told, tags, OLDER)
    return run(python, DIGESTS, env={"PYTHONPATH": str(site)})


def way(wheel: Path) -> Callable[[Path], str] | None:
    """What runs a wheel here."""
    tag = wheel.stem.split("-")[-1]
    if tag.startswith("win"):
        return here if os.name == "nt" else under_wine
    mine = sys.platform == "linux" and tag.endswith(platform.machine())
    if tag.startswith(("manylinux", "linux")):
        return here if mine else under_qemu if tag.endswith("aarch64") else None
    return on_musl if mine and tag.startswith("musllinux") else None


def main() -> int:
    verb, *names = sys.argv[1:] or [""]
    if verb == "build" and set(names) <= set(TARGETS):
        for target in names or TARGETS:
            print(f"{target} ...", flush=True)
            build(target)
        return 0
    if verb != "try":
        sys.exit(__doc__)
    wheels = [Path(name).resolve() for name in names] or sorted(DIST.glob("*.whl"))
    for wheel in wheels:
        size = wheel.stat().st_size
        if size > MOST:
            sys.exit(f"{wheel.name}: {size} bytes, more than {MOST}")
        try:
            runs = way(wheel)
            told = "not tried: nothing here runs it" if runs is None else runs(wheel).strip()
        except Missing as missing:
            told = f"not tried: {missing}"
        print(f"{wheel.name}: {size / 1e6:.1f} MB, {told}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
