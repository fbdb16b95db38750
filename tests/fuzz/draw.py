"""Cases at random: an observer, a record and what to check, as lines of Python.

Case i of a seed is drawn from (seed, i) alone. Nothing here calls the core, so that a case can be
told of which the core did not come back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hgo_rs.laws import LAWS

METHODS = (
    "zoh", "bilinear", "euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine",
)  # fmt: skip
NAMES = (
    "q", "v", "x1", "x2", "x3", "a", "b", "c", "d", "k", "r", "e", "l", "z", "w", "p", "phi",
    "int", "dt", "state", "next", "eta_v", "elapsed", "started", "float", "fn", "isfinite", "x_hat",
    "gain", "speed", "omega", "M", "I", "y1", "u1", "double", "main", "self", "status", "new", "dx",
    "HIGH",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Lines that make what the checks take, and the checks by name.

    `record` holds arguments as values (t, y, u, ...): they can be shortened.
    """

    seed: int
    number: int
    lines: tuple[str, ...]
    record: dict[str, Any]
    checks: tuple[str, ...]

    def values(self) -> dict[str, Any]:
        """What the checks take, by name."""
        import hgo_rs as hgo

        scope: dict[str, Any] = {"np": np, "hgo": hgo}
        exec("\n".join(self.lines), scope)
        return scope | self.record

    def cut(self, first: int, samples: int) -> Case:
        """The case with these samples of its record alone."""
        rows = slice(first, first + samples)
        cut = {
            name: value[rows] if name in "tyu" and isinstance(value, np.ndarray) else value
            for name, value in self.record.items()
        }
        return replace(self, record=cut)

    def told(self, check: str) -> str:
        """Lines of Python that make the case and check it."""
        import inspect

        import checks

        names = inspect.signature(getattr(checks, check)).parameters
        lines = ["import checks  # PYTHONPATH=tests/fuzz", "import hgo_rs as hgo"]
        lines += ["import numpy as np", *self.lines]
        lines += [f"{name} = {shown(self.record[name])}" for name in names if name in self.record]
        return "\n".join([*lines, f"checks.{check}({', '.join(names)})"])


def shown(value: Any) -> str:
    """A value as Python."""
    if not isinstance(value, np.ndarray):
        return repr(value)
    return f"np.array({value.tolist()!r})".replace("nan", "np.nan").replace("inf", "np.inf")


def draw(seed: int, number: int, long: int = 1) -> Case:
    """Case `number` of a seed; long records and studies are `long` times as long."""
    return _Draw(seed, number, long).case()


class _Draw:
    def __init__(self, seed: int, number: int, long: int) -> None:
        self.seed, self.number, self.long = seed, number, long
        self.rng = np.random.default_rng([seed, number])
        self.lines: list[str] = []
        self.checks: list[str] = []
        self.record: dict[str, Any] = {}
        self.n_y, self.n_u = 1, 0
        self.timed = False  # whether a model looks at the time
        self.names = [str(name) for name in self.rng.permutation(NAMES)]

    # --- numbers ------------------------------------------------------------------------------

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def pick(self, *values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def number_in(self, low: float, high: float) -> float:
        return float(f"{self.rng.uniform(low, high):.3g}")

    def power(self, low: float, high: float) -> float:
        """Log-uniform between powers of ten."""
        return float(f"{10.0 ** self.rng.uniform(low, high):.3g}")

    def take(self, count: int) -> list[str]:
        """Names that no one has yet."""
        taken, self.names = self.names[:count], self.names[count:]
        return taken

    # --- equations ----------------------------------------------------------------------------

    def term(self, symbols: list[str], depth: int, risky: bool) -> str:
        """An expression of the symbols."""
        if depth == 0 or self.chance(0.15):
            if not symbols or self.chance(0.15):
                return str(self.number_in(-3.0, 3.0))
            name = self.pick(*symbols)
            self.timed |= name == "t"
            return f"{name}" if self.chance(0.6) else f"{self.number_in(-2.0, 2.0)}*{name}"

        def part() -> str:
            return self.term(symbols, depth - 1, risky)

        if risky and self.chance(0.5):
            return self.pick("log({})", "sqrt({})", "1/({})", "({})**0.5").format(part())
        kind = int(self.rng.integers(12))
        if kind < 3:
            return f"({part()} {self.pick('+', '-', '*')} {part()})"
        if kind == 3:
            return f"{part()}/(1 + ({part()})**2)"
        if kind == 4:
            return f"saturate({part()}, -2.5, {self.number_in(0.0, 3.0)})"
        if kind == 5:
            sign = self.pick("<", "<=", ">", ">=", "==")
            return f"piecewise({part()}, {part()} {sign} {part()}, {part()})"
        if kind == 6:
            return f"{self.pick('min', 'max', 'atan2')}({part()}, {part()})"
        if kind == 7:
            return f"exp(-abs({part()}))"
        if kind == 8:
            return f"{self.pick('log(1 + ({})**2)', 'sqrt(abs({}))', '({})**3/50')}".format(part())
        return f"{self.pick('sin', 'cos', 'tanh', 'atan', 'abs', 'sign')}({part()})"

    def model(self, form: str, n: int, orders: tuple[int, ...] = ()) -> None:
        """A model of the user's own, as a line `model = ...`."""
        risky = self.chance(0.08)
        states = self.take(n)
        inputs = self.take(int(self.rng.integers(0, 3)))
        parameters = {name: self.number_in(-2.0, 2.0) for name in self.take(self.pick(0, 0, 1, 2))}
        known = [*inputs, *parameters, *(["t"] if self.chance(0.5) else [])]
        depth = int(self.rng.integers(1, 4))

        def sides(count: int, *symbols: list[str]) -> str:
            made = [
                self.term([*symbols[min(i, len(symbols) - 1)]], depth, risky) for i in range(count)
            ]
            return repr(made)

        every = [*states, *known]
        if form == "phase":
            given = f"phi={self.term(every, depth, risky)!r}"
        elif form == "chains":
            given = f"orders={list(orders)}, phi={sides(len(orders), every)}"
        elif form == "triangular":
            given = f"f={sides(n, *([*states[: i + 1], *known] for i in range(n)))}"
        elif form == "sampled":
            first = states[0]
            h = self.pick(first, f"2*{first}", f"{first} + 0.2*sin({states[-1]})", states[-1])
            corrections = [
                f"{self.number_in(0.0, 4.0)}*T*(y - ({h}))*({self.pick('1', 'cos(t)', *states)})"
                for _ in states
            ]
            self.timed = True
            given = f"f={sides(n, every)}, K_T={corrections!r}, h={h!r}"
        else:
            n_x = int(self.rng.integers(1, n))
            self.n_y = n_x = max(n_x, n - n_x)  # as many measured as estimated, or more
            x, n_z = states[:n_x], n - n_x
            f1 = [self.term(x, depth, False) for _ in x]
            g = [
                [self.number_in(0.5, 2.0) if i % n_z == j else self.number_in(-0.2, 0.2)
                 for j in range(n_z)]
                for i in range(n_x)
            ]  # fmt: skip
            rows = [[f"{value}*(1.5 + sin({self.pick(*x)}))" for value in row] for row in g]
            given = f"f1={f1!r}, g={rows!r}, f2={sides(n_z, every)}"
            self.n_z = n_z
        self.n_u = len(inputs)
        self.lines.append(
            f"model = hgo.Model(states={states}, inputs={inputs}, parameters={parameters}, {given})"
        )

    # --- observers ----------------------------------------------------------------------------

    def gain(self, ell: float) -> str:
        kind = self.pick("number", "number", "number", "AdaptiveGain", "DeadZoneGain")
        self.moves = kind != "number"
        if not self.moves:
            return repr(ell)
        p1, p2, b = self.power(-1, 2), self.power(-6, 0), self.number_in(0.05, 0.45)
        return f"hgo.{kind}({p1}, {p2}, {b})"

    def law(self, n: int, model: str, timing: str, ell: float, own_timing: bool = True) -> str:
        """An observer of one output."""
        fits = [law for law in LAWS.values() if law.single and n in law.orders]
        law = self.pick(*[law for law in fits if n > 1 or law.form != "phase"])
        gain, methods, m = self.gain(ell), METHODS, 0
        if not law.placed or (self.moves and law.form == "phase"):
            methods = METHODS[2:]
        elif n > (4 if law.form == "phase" else 6):
            methods = tuple(method for method in METHODS if method != "bilinear")
        options = [f"method={self.pick(*methods)!r}", f"timing={timing!r}"]
        if law.size:
            m = self.pick(*law.size[1])
            options.append(f"{law.size[0]}={m}")
        if self.chance(0.3):
            options.append(f"poles={self.poles(law.pole_count(n, m))}")
        if law.saturated:
            levels = [self.power(-1, 2) for _ in range(n - 1)]
            options.append(f"saturation={levels}, clip={self.pick('hard', 'smooth')!r}")
        if model:
            options.append(f"model={model}")
        if self.unstable:
            options.append("allow_unstable=True")
        return f"hgo.HighGainObserver({law.kind!r}, {n}, {gain}, {', '.join(options)})"

    def poles(self, count: int) -> list[complex]:
        found: list[complex] = []
        while len(found) < count:
            real = -self.number_in(0.8, 2.5)
            if count - len(found) > 1 and self.chance(0.4):
                imaginary = self.number_in(0.1, 1.0)
                found += [complex(real, imaginary), complex(real, -imaginary)]
            else:
                found.append(complex(real, 0.0))
        return found

    def start(self, count: int) -> str:
        """Estimates to start from."""
        if self.chance(0.3):
            return "None"
        scale = self.pick(1.0, 1.0, 1.0, 100.0, 1e-8)
        return repr([float(f"{v:.3g}") for v in scale * self.rng.normal(size=count)])

    def observer(self) -> None:
        """Lines that make `observer` and `start`, the memory."""
        kind = self.pick(*["single"] * 8, "copies", "chains", "chains", "sampled", "reduced")
        timing = self.pick("current", "predictor")
        self.unstable = self.chance(0.6)
        self.ell = self.pick(self.power(0, 2.5), self.power(-2, 6))
        self.n = n = int(min(self.rng.geometric(0.3), 12))
        r0 = ""
        if kind == "single":
            own = self.pick(None, None, "phase", "phase", "triangular", "built-in", "pair")
            model = "model"
            if own is None:
                model = ""
            elif own in ("built-in", "pair"):
                model = self.built_in(own == "pair")
                n = self.n
            else:
                self.model(own, n)
            law = self.law(n, model, timing, self.ell)
            self.lines.append(f"observer = {law}")
            if own == "pair":
                self.lines.append(f"other = {law.replace(f'model={model}', 'model=same')}")
                self.checks.append("own")
            r0 = f", r0={self.power(0, 2)}" if self.moves and self.chance(0.5) else ""
        elif kind == "copies":
            self.copies(timing)
            return
        elif kind == "chains":
            orders = tuple(int(min(self.rng.geometric(0.5), 4)) for _ in range(self.pick(2, 2, 3)))
            n = self.n = sum(orders)
            self.model("chains", n, orders)
            laws = ", ".join(self.law(order, "", timing, self.ell) for order in orders)
            allow = ", allow_unstable=True" if self.unstable else ""
            self.lines.append(f"observer = hgo.MultiOutputObserver([{laws}], model=model{allow})")
            self.n_y = len(orders)
        elif kind == "sampled":
            self.ell = self.power(0, 1)
            if self.chance(0.4):
                self.van_der_pol()
                n = 2
            else:
                n = self.n = int(self.rng.integers(1, 4))
                self.model("sampled", n)
                self.lines.append("observer = hgo.SampledDataObserver(model)")
        else:
            self.ell = 0.4 / self.power(-3, 0)
            epsilon = float(f"{0.4 / self.ell:.3g}")
            if self.chance(0.3):
                self.lines.append(f"observer = hgo.ReducedOrderObserver({epsilon})")
                self.n_y, self.n_u, n = 3, 2, 3
                self.lines.append("start = observer.initial_memory([1.0, 0.1, 0.05])")
                return
            self.model("strict-feedback", int(self.rng.integers(2, 6)))
            n = self.n_z
            self.lines.append(f"observer = hgo.ReducedOrderObserver({epsilon}, model=model)")
        self.lines.append(f"start = observer.initial_memory({self.start(n)}{r0})")

    def built_in(self, pair: bool) -> str:
        """A model of the library, and with `pair` the same equations as a model of one's own."""
        kind = self.pick("Lee", "Crackle", "InputGain", "Unknown", "SanfelicePraly")
        if kind == "InputGain":
            gain, self.n_u = self.number_in(-3.0, 3.0), 1
            made, inputs, sides = f"hgo.InputGain({gain})", ["u"], f"phi='{gain}*u'"
        elif kind == "Unknown":
            made, inputs, sides = "hgo.Unknown()", [], "phi=0"
        elif kind == "Lee":
            self.n, made, inputs = 2, "hgo.Lee()", []
            sides = "phi='-x1/(1 + x1*x1) - x2'"
        elif kind == "Crackle":
            self.n, made, inputs = 5, "hgo.Crackle()", []
            sides = "phi='saturate(0.2*(x1*x1 - 1) - x2 - x3 - 4*x4 - x5, -3, 3)'"
        else:
            nu1 = self.number_in(-2.0, 2.0)
            self.n, made, inputs = 2, f"hgo.SanfelicePraly({nu1})", []
            sides = f"f=['{nu1}*x1', 0]"
        if pair:
            states = [f"x{i + 1}" for i in range(self.n)]
            self.lines.append(f"same = hgo.Model(states={states}, inputs={inputs}, {sides})")
        return made

    def van_der_pol(self) -> None:
        epsilon = self.number_in(0.1, 1.5)
        self.n = 2
        self.lines += [
            f"observer = hgo.SampledDataObserver(hgo.VanDerPol({epsilon}))",
            f"mu = '{epsilon}*(1 - y*y)'",
            f"epsilon = {epsilon}",
            "l2 = f'(5 - {epsilon}*(x1 + y)*x2 + (5 + {mu})*({mu}))*T*(y - x1)'",
            f"f = ['x2', '-x1 + {epsilon}*(1 - x1*x1)*x2']",
            "same = hgo.Model(states=['x1', 'x2'], f=f, K_T=[f'(5 + {mu})*T*(y - x1)', l2])",
            "other = hgo.SampledDataObserver(same)",
        ]
        self.checks.append("own")

    def copies(self, timing: str) -> None:
        kind = self.pick("RepelledCollection", "ModifiedObserver")
        copies, self.n, self.ell, self.moves = int(self.rng.integers(2, 6)), 2, 10.0, True
        model = ""
        if self.chance(0.5):
            self.model("phase", 2)
            model = ", model=model"
        p1, p2, b = self.power(0, 1), self.power(-4, 0), self.number_in(0.05, 0.45)
        method = self.pick(*METHODS[2:])
        self.lines.append(
            f"observer = hgo.{kind}(hgo.AdaptiveGain({p1}, {p2}, {b}), k=[2.0, 1.0], "
            f"k_bar=[{self.number_in(0.0, 0.5)}, {self.number_in(0.0, 0.5)}], copies={copies}, "
            f"method={method!r}, timing={timing!r}{model}, allow_unstable={self.unstable})"
        )
        starts = np.round(self.rng.normal(size=(copies, 2)), 3).tolist()
        main = "[0.1, -0.2], " if kind == "ModifiedObserver" else ""
        self.lines.append(f"start = observer.spread({main}{starts})")

    # --- records ------------------------------------------------------------------------------

    def clock(self, samples: int) -> Any:
        """A period, or times; where a model looks at the time, sums of steps are exact."""
        product = self.pick(0.02, 0.1, 0.3, self.power(-4, 0), self.power(-1, 1))
        period = product / self.ell / (1.0 if self.chance(0.5) else self.n)
        if self.chance(0.25):
            return float(period)
        jitter = self.pick(0.0, 0.2, 0.9)
        steps = period * self.rng.uniform(1.0 - jitter, 1.0 + jitter, samples)
        if self.chance(0.3):  # gaps
            steps = steps * np.where(self.rng.random(samples) < 0.1, self.pick(3.0, 30.0), 1.0)
        if self.timed or self.chance(0.5):
            tick = 2.0 ** (np.floor(np.log2(period)) - 20)
            return np.cumsum(np.maximum(np.round(steps / tick), 1.0)) * tick - tick * np.round(
                steps[0] / tick
            )
        return self.pick(0.0, 0.0, -3.0, 1e3 * period) + np.cumsum(steps) - steps[0]

    def samples(self, count: int) -> None:
        """t, y and u of a record."""
        rng = self.rng
        scale = self.pick(*[1.0] * 12, 1e-6, 1e6, 1e-200, 1e120, 5e-324)
        phase = np.linspace(0.0, rng.uniform(0.1, 10.0), count)[:, None]
        y = scale * (np.sin(phase + rng.uniform(0.0, 6.0, self.n_y)) + 1.2)
        y += scale * self.pick(0.0, 1e-3, 0.1) * rng.normal(size=y.shape)
        if self.chance(0.1):
            y[:] = scale * self.pick(0.0, 1.0)
        if self.chance(0.4):  # rates, and samples that got lost
            for channel in range(self.n_y):
                y[rng.random(count) < self.pick(0.0, 0.1, 0.5, 0.9), channel] = np.nan
        if self.chance(0.1):
            y[: rng.integers(1, 4)] = np.nan
        self.record["t"] = self.clock(count)
        self.record["y"] = y if self.n_y > 1 else y[:, 0]
        u = self.pick(1.0, 1.0, 1e3) * rng.normal(size=(count, self.n_u))
        self.record["u"] = u if self.n_u else None

    # --- cases --------------------------------------------------------------------------------

    def case(self) -> Case:
        kind = self.pick(*["record"] * 6, "study", "study", "long", "refused")
        if kind == "study":
            self.study()
        else:
            self.observer()
            self.samples(int(self.rng.integers(1, 4)) if self.chance(0.1) else 24)
            if kind == "record":
                self.checks += ["loop", "chunks", "twin", "innovation", "copies"]
                if self.number % 24 == 0:
                    self.checks.append("exported")
                self.record["order"] = int(self.rng.integers(2**31))
            elif kind == "long":
                self.record["samples"] = self.long * int(self.rng.integers(2_000, 60_000))
                self.record["order"] = int(self.rng.integers(2**31))
                self.checks = ["long"]
            else:
                self.record["line"], self.record["names"] = self.bad_call()
                self.checks = ["refusal"]
        return Case(self.seed, self.number, tuple(self.lines), self.record, tuple(self.checks))

    def study(self) -> None:
        """A plant, an observer of it, and the options of `simulate`."""
        self.unstable = True
        self.ell = self.power(0, 1.5)
        self.n = n = int(self.rng.integers(1, 5))
        timing, model = self.pick("current", "predictor"), ""
        which = self.pick("own", "own", "lee", "crackle", "van-der-pol")
        if which == "own":
            states = self.take(n)
            known = [*states, "t"]
            last = f"-({states[0]}) - 0.5*({states[-1]}) + tanh({self.term(known, 2, False)})"
            output = self.pick("None", repr(f"2*{states[0]} + 0.1*sin(3*t)"))
            drift = [*states[1:], last]
            noise = [self.term(known, 1, False) for _ in states]
            more = f", diffusion={noise!r}" if self.chance(0.3) else ""
            self.lines.append(
                f"plant = hgo.Plant(states={states}, drift={drift!r}, output={output}{more})"
            )
            if self.chance(0.6):
                self.lines.append(f"model = hgo.Model(states={states}, phi={last!r})")
                model = "model"
        elif which == "lee":
            self.n, model = 2, self.pick("", "hgo.Lee()")
            self.lines.append("plant = hgo.Lee()")
        elif which == "crackle":
            self.n, model = 5, self.pick("", "hgo.Crackle()")
            self.lines.append("plant = hgo.Crackle()")
        else:
            self.n = 2
            self.lines.append(f"plant = hgo.VanDerPol({self.number_in(0.1, 1.0)})")
        n = self.n
        if which == "van-der-pol" and self.chance(0.7):
            self.lines.append("observer = hgo.SampledDataObserver()")
        else:
            self.lines.append(f"observer = {self.law(n, model, timing, self.ell)}")
        runs = self.long * int(self.rng.choice([1, 3, 9, 33, 70]))
        x0 = np.round(0.3 * self.rng.normal(size=(runs, n)), 3)
        self.record |= {"runs": runs, "x0": x0, "dt": float(f"{0.1 / self.ell / n:.3g}")}
        self.record |= {"steps": int(self.rng.integers(20, 400)), "seed": self.number}
        self.record["noise"] = self.pick(0.0, 1e-3, 0.1)
        self.checks += ["blocks", "played_again", "twin_study"]

    def bad_call(self) -> tuple[str, list[str]]:
        """A call that must be refused, and words of which its message has one."""
        n_y = self.n_y
        calls: list[tuple[str, list[str]]] = [
            ("observer.run(0.0, y, u, memory0=start)", ["dt"]),
            ("observer.run(float('nan'), y, u, memory0=start)", ["dt"]),
            ("observer.run('fast', y, u, memory0=start)", ["dt", "t_or_dt"]),
            ("observer.run(1e-6, y[:0], u, memory0=start)", ["y"]),
            ("observer.run(1e-6, 'y', u, memory0=start)", ["y"]),
            ("observer.run(1e-6, np.full_like(y, np.inf), u, memory0=start)", ["y"]),
            ("observer.run(-np.arange(len(y)), np.vstack([y, y]), u, memory0=start)",
             ["y", "t", "u"]),
            ("observer.run(np.zeros(2), np.zeros((2, observer.n_y)), np.zeros((2, observer.n_u)), "
             "memory0=start)", ["t"]),
            ("observer.run([0.0, np.nan], np.zeros((2, observer.n_y)), "
             "np.zeros((2, observer.n_u)), memory0=start)", ["t"]),
            ("observer.run(1e-6, y, np.zeros((len(y) + 1, 3)), memory0=start)", ["u"]),
            ("observer.run(1e-6, y, u, memory0=start[:-1])", ["memory0"]),
            ("observer.run(1e-6, y, u, memory0=start + np.nan)", ["memory0"]),
            ("observer.run(1e-6, y, u, x_hat0=np.zeros(observer.n + 1))", ["x_hat0"]),
            ("observer.run(1e-6, y, u, r0=0.5)", ["r0"]),
            ("observer.run(1e-6, y, u, until=-1.0, memory0=start)", ["until"]),
            ("observer.run(1e-6, y, u, timing='late')", ["timing"]),
            ("observer.step(np.zeros(observer.n_y + 1), np.zeros(observer.n_u), dt=1e-6)", ["y"]),
            ("observer.step(np.zeros(observer.n_y), np.zeros(observer.n_u + 1), dt=1e-6)", ["u"]),
            ("observer.step(np.full(observer.n_y, np.inf), np.zeros(observer.n_u), dt=1e-6)",
             ["y"]),
            ("observer.step(np.zeros(observer.n_y), np.zeros(observer.n_u), dt=-1e-6)", ["dt"]),
            ("observer.step('a', np.zeros(observer.n_u), dt=1e-6)", ["y"]),
            ("setattr(observer, 'memory', start[1:])", ["memory"]),
            ("observer.reset(memory0=[*start, 0.0])", ["memory0"]),
            ("observer.export(to='basic', out='nowhere')", ["to"]),
        ]  # fmt: skip
        if self.n_u:
            calls.append(("observer.run(1e-6, y, memory0=start)", ["u"]))
            calls.append(("observer.run(1e-6, y, u + np.nan, memory0=start)", ["u"]))
        if n_y > 1:
            calls.append(("observer.run(1e-6, y[:, 0], u, memory0=start)", ["y"]))
        return calls[int(self.rng.integers(len(calls)))]
