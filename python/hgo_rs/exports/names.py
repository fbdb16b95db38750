"""Names in exported source: what they may be, and how none meets another.

A user's word stays as it is where every language and header leaves it free. Otherwise its role
stands in front of it: a parameter `dt` is `parameter_dt`. Words that stay are given out first, so
that none of the others can take their place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from hgo_rs.errors import check
from hgo_rs.exports.table import FUNCTIONS

__all__ = ["Names", "check_name", "names_of_export"]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_C = _words("""
    auto break case char const continue default do double else enum extern float for goto if inline
    int long register restrict return short signed sizeof static struct switch typedef union
    unsigned void volatile while asm bool true false main
""")
"""Words of C."""

_LANGUAGES = _C | _words("""
    alignas alignof constexpr nullptr static_assert thread_local typeof typeof_unqual noreturn
    complex imaginary I

    and and_eq bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield compl
    concept const_cast consteval constinit contract_assert decltype delete dynamic_cast explicit
    export friend mutable namespace new noexcept not not_eq operator or or_eq private protected
    public reflexpr reinterpret_cast requires static_cast synchronized template this throw typeid
    typename using virtual wchar_t xor xor_eq

    as async await crate dyn fn impl in let loop match mod move mut pub ref self Self super trait
    type unsafe use where yield abstract become box final gen macro override priv try unsized
    None Some Ok Err f16 f32 f64 f128 i8 i16 i32 i64 i128 isize u8 u16 u32 u64 u128 usize str
""")
"""Words of C, C++ and Rust, and what Rust's prelude binds."""

# A name without a lower-case letter is a macro somewhere (PI, B0, HIGH, NAN): none of them is free.
_HEADERS = _words("""
    errno stdin stdout stderr signgam environ unix linux i386 mips sparc sun vax hpux
    near far huge small interface pascal cdecl word byte boolean bit data code idata xdata pdata
    sbit sfr at interrupt critical reentrant naked banked using signals slots emit foreach forever
""")
"""Macros, types and variables of system headers, of boards and of their compilers."""

_OURS = _words("""
    state t dt next real status min max sign sqrt sqrtf abs fabs fabsf isfinite isnan signbit
    copysign copysignf memcpy assert tanh log pow
""") | frozenset((*FUNCTIONS, *FUNCTIONS.values()))
"""Words of every exported program, whatever it is called."""

WORDS = _LANGUAGES | _HEADERS | _OURS

_FILES = _words("""
    assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
    stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar
    wchar wctype stdbit stdckdint unistd features memory strings malloc alloca endian values pthread
    sched semaphore poll fcntl windows arduino
    aux con nul prn com0 com1 com2 com3 com4 com5 com6 com7 com8 com9
    lpt0 lpt1 lpt2 lpt3 lpt4 lpt5 lpt6 lpt7 lpt8 lpt9
    build deps examples incremental
""")
"""Headers of C, which a file of this name would hide; devices of Windows; folders of cargo."""

_LIBRARIES = _words("""
    alloc core std proc_macro test vector default status
    atomic cnd mtx sem
""")
"""Crates and types of Rust; libraries of C that have a function `NAME_init`."""

_LONGEST = 64

OUTPUTS = 12
"""Chains that a model may have."""


def check_name(name: object) -> None:
    """Refuse a name of an export that a language, a library or a file system has taken."""
    fits = isinstance(name, str) and re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name)
    check(
        bool(fits) and len(str(name)) <= _LONGEST,
        "name",
        name,
        f"a lower-case identifier of at most {_LONGEST} characters: letters, digits and single _",
        "for example axis",
    )
    taken = name in _LANGUAGES | _FILES | _LIBRARIES or str(name).startswith("pthread_")
    check(
        not taken,
        "name",
        name,
        "a name that C, C++, Rust, their libraries and file systems leave free",
        f"for example {name}_observer",
    )


def names_of_export(name: str) -> set[str]:
    """Types and functions of an export of this name."""
    words = {
        *FUNCTIONS.values(),
        "min",
        "max",
        "sign",
        "init",
        "step",
        "correct",
        "predict",
        "state",
        "row",
        "vector",
        "to_bits",
        "from_bits",
        "periods",
        "gains",
        *(f"gains_{output}" for output in range(1, OUTPUTS + 1)),
    }
    return {name} | {f"{name}_{word}" for word in words}


class Names:
    """Identifiers, never the same twice, none that a language or the export itself has taken."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self.taken = set(taken)

    def several(self, wishes: Sequence[tuple[str, str]]) -> list[str]:
        """Identifiers for wishes and their roles: first for wishes that are free as they are."""
        words = [_identifier(wish) for wish, _ in wishes]
        found: dict[int, str] = {}
        for i, (word, (wish, _)) in enumerate(zip(words, wishes, strict=True)):
            if word == wish and word not in self.taken and not _is_reserved(word):
                found[i] = self._new(word)
        for i, (word, (_, role)) in enumerate(zip(words, wishes, strict=True)):
            if i not in found:
                free = word not in self.taken and not _is_reserved(word)
                found[i] = self._new(word if free else f"{role}_{word}")
        return [found[i] for i in range(len(wishes))]

    def local(self, wish: str) -> str:
        """A name for a value in between; the second of a name has a number."""
        return self._new(f"value_{wish}" if _is_reserved(wish) else wish)

    def _new(self, word: str) -> str:
        found, count = word, 1
        while found in self.taken:
            count += 1
            found = f"{word}_{count}"
        self.taken.add(found)
        return found


def _is_reserved(word: str) -> bool:
    is_macro = len(word) > 1 and word == word.upper()
    return is_macro or word in WORDS


def _identifier(wish: str) -> str:
    """A word of letters, digits and _: other characters by their code."""
    word = re.sub(r"\s", "_", wish)
    word = "".join(c if re.match(r"\w", c, re.ASCII) else f"u{ord(c):x}" for c in word)
    return word if re.match(r"[A-Za-z]", word) else f"v{word}"
