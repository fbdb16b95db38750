"""One structure: what it does at each gain, the gain of a criterion, and the doubts left."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hgo_rs.design import response
from hgo_rs.design.discretisation import step_limit
from hgo_rs.errors import HgoError, check, check_array, explain
from hgo_rs.laws import LAWS
from hgo_rs.models import Model
from hgo_rs.observers import HighGainEKF, Observer
from hgo_rs.tuning.linear import Slopes, path
from hgo_rs.tuning.offers import Build
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.reference import Reference
from hgo_rs.tuning.result import Array, TradeOff

_POINTS = 41
_LONG, _FEW = 8000, 21  # a record from which on fewer gains are tried
_COARSE = 3  # every so many gains are looked at first
_SPAN = 1e-3, 5.0  # of ell dt; beyond, an observer is all but deadbeat
_LANES = 9  # gains of the variational equation, over those of up to so many times the least RMS
_WIDE = 2.0  # innovation,
_STEPS, _WORK = (60, 1200), 1600  # in how many steps, and in how many of all stretches
_NEAR = 2.0  # innovations up to this many times the least variance tell of noise and model error
_LAGS = 20  # of the innovations' autocorrelation
_FAR = 500  # lags after which what R and Q give of it has died out
_LEVEL = 1e-3  # of the test that they are white
_LATER = dict.fromkeys(("bandwidth", "settling", "peaking", "noise", "model"), math.nan)
# What is not white is said where it reaches the choice: see `Candidate.doubts`.
_MISFIT, _CORRELATED = 0.15, 1.5
_DITHER = 1.2  # noise up to this many times step/sqrt(12) is rounding and little else


class Candidate:
    """One structure: its trade-off over the gain."""

    curve: TradeOff
    noise: float
    model_error: float
    near: int  # gains of which the innovation is near the least
    lasts = False  # whether rounding does, for several samples
    silent = False  # whether the record has no noise beside the rounding of its numbers
    misfit: float  # RMS of what the fit of R and Q leaves there, of the measured variance

    def __init__(
        self, build: Build, dt: float, ells: npt.ArrayLike | None, *, ours: bool = False
    ) -> None:
        self.build, self.dt, self.n, self.ours = build, dt, 0, ours
        self.slopes: Slopes | None = None
        self.refused: list[tuple[float, Exception]] = []
        self.ells = None if ells is None else np.unique(check_array(ells, "ells"))
        if self.ells is None:
            tried = [part / dt for part in (0.1, 1e-3, 1e-2, 1.0, 5.0)]
        else:
            sound = self.ells.size >= 3 and np.all((self.ells > 0.0) & np.isfinite(self.ells))
            allowed = "three gains or more, each > 0 and finite"
            check(sound, "ells", ells, allowed, "leave it out")
            tried = self.ells.tolist()
        for ell in tried:
            try:
                observer = self.made(ell)
            except HgoError as error:
                self.refused.append((ell, error))
            else:
                self.n, self.any = observer.n, observer
                self.refused.clear()
                return
        raise self.none_left()

    def made(self, ell: float) -> Observer:
        """The observer with this gain, which must be what `build` is there for."""
        call = f"build({ell:.6g})"
        try:
            observer = self.build(ell)
        except HgoError:
            raise
        except Exception as error:
            raise HgoError(f"{call} raised {type(error).__name__}: {error}") from error
        remedy = "build ell -> StandardObserver(n, ell), for example"
        check(isinstance(observer, Observer), call, observer, "an observer", remedy)
        spec = observer.spec
        law = spec.get("gain")
        law = law if isinstance(law, Mapping) else {}
        kinds = [law.kind for law in LAWS.values() if law.single]
        moves = isinstance(observer, HighGainEKF)
        sound = law.get("law") == "constant" and (moves or spec["kind"] in kinds)
        shown = " with gain law ".join([spec["kind"], *([law["law"]] if "law" in law else [])])
        check(sound, "observer", shown, f"one with a constant gain: {', '.join(kinds)}", remedy)
        follows = math.isclose(law["ell"], ell, rel_tol=1e-6) or (moves and self.ours)
        allowed = f"{ell:.6g}, the gain that is asked for"
        check(follows, f"gain of {call}", law["ell"], allowed, remedy)
        check(self.n in (0, observer.n), f"order of {call}", observer.n, f"{self.n}", remedy)
        return observer

    def look(self, record: Record | None, *, coarse: bool = False) -> None:
        """Compute the curve of the estimate, over a record where there is one.

        ``coarse``: at every third gain.
        """
        noise, reference = self.noise, self.reference
        for turn in filter(None, self.any.wrap):
            allowed = f"> {6.0 * noise:.6g}, six standard deviations of the noise"
            remedy = "noise of half a turn cannot be separated from motion; check the units"
            check(not turn <= 6.0 * noise, "wrap", turn, allowed, remedy)
        if record is not None:
            record.moves(self.n)
        kept, squares, figures, far = [], [], [], []
        lean = self.ours and reference is not None
        grid = self.grid(record)
        for ell in grid[:: _COARSE if coarse else 1].tolist():
            try:
                with np.errstate(all="ignore"):
                    square, distance = self.at(ell, record)
                    figures.append(_LATER if lean else self.figures(self.made(ell)))
            except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
                self.refused.append((ell, error))
            else:
                kept.append(ell)
                squares.append(square)
                far.append(distance)
        if len(kept) < 3:
            raise self.none_left()
        grid, measured = np.array(kept), np.array(squares)
        self.silent = record is not None and np.min(measured) <= record.smallest**2
        if record is not None and not lean:
            self.found(grid, measured, record.smallest)
        self.curve = TradeOff(
            ell=grid,
            innovation=np.sqrt(measured),
            measured=self.with_spread(np.array(far)),
            noise=self.noise * np.sqrt([of["noise"] for of in figures]),
            model=self.model_error * np.sqrt([of["model"] for of in figures]),
            **{
                name: np.array([of[name] for of in figures])
                for name in ("bandwidth", "settling", "peaking")
            },
        )
        if record is not None and reference is None:
            self.refine(record)

    def begin(
        self, index: int, noise: float, model_error: float, reference: Reference | None
    ) -> None:
        """Say which estimate is wanted, and what it is judged by."""
        self.index, self.noise, self.model_error = index, noise, model_error
        self.reference = reference
        self._seen: dict[float, tuple[float, float]] = {}

    def at(self, ell: float, record: Record | None) -> tuple[float, float]:
        """Mean square innovation with a gain, and the distance from the smoothed state; NaN where
        there is none.
        """
        if record is None:
            self.made(ell)
            return math.nan, math.nan
        if ell not in self._seen:
            run = record.run(self.made(ell), self.start(record), spare=self.ours)
            square, distance = float(np.mean(run.innovation[record.judged, 0] ** 2)), math.nan
            if self.reference is not None:
                distance = self.reference.distance(run.x_hat, record, self.index)
            finite = math.isfinite(square) and not math.isinf(distance)
            remedy = "choose a smaller gain, or a larger unit of y"
            check(finite, "mean square innovation", square, "finite", remedy)
            self._seen[ell] = square, distance
        return self._seen[ell]

    def glance(self, record: Record) -> float:
        """The least distance from the smoothed state at every third gain; infinite if all are
        refused.
        """
        least = math.inf
        with np.errstate(all="ignore"):
            for ell in self.grid(record)[::_COARSE].tolist():
                with contextlib.suppress(ArithmeticError, ValueError, np.linalg.LinAlgError):
                    least = min(least, self.at(ell, record)[1])
        return float(self.with_spread(np.array(least)))

    def start(self, record: Record) -> Array | None:
        """Where to start on the record: by its own later samples, where these are known."""
        if self.reference is None:
            return None
        start = np.zeros(self.n)
        known = self.reference.start[: self.n]
        start[: len(known)] = known
        return start

    def with_spread(self, distance: Array) -> Array:
        """Errors for distances from the smoothed state."""
        if self.reference is None:
            return distance
        return np.asarray(np.hypot(distance, self.reference.spread[self.index]))

    def grid(self, record: Record | None) -> Array:
        """The gains asked for; else gains that are stable and, on a record without a reference,
        forget the start of this estimate before they are judged.
        """
        if self.ells is not None:
            return self.ells
        limit = step_limit(self.any.spec).c / self.dt
        low, high = _SPAN
        low, high = low / self.dt, min(high / self.dt, 0.9 * limit)
        if record is not None and self.reference is None:
            spec = self.any.spec
            settling = float(response.settling(spec)[self.index])
            low = max(low, settling * spec["gain"]["ell"] / record.skip)
        remedy = "give a longer log or a longer skip, or ells="
        check(low < high, "least gain that settles within skip", low, f"< {high:.4g}", remedy)
        long = record is not None and len(record.y) > _LONG
        return np.geomspace(low, high, _FEW if long else _POINTS)

    def figures(self, observer: Observer) -> dict[str, float]:
        """What an observer does to the estimate that is asked about, per unit of noise and model
        error.
        """
        spec, dt, i = observer.spec, self.dt, self.index
        out = {
            "bandwidth": float(response.bandwidth(spec, dt)[i]),  # may be infinite
            "settling": float(response.settling(spec, dt)[i]),
            "peaking": float(observer.peaking(dt)[i]),
        }
        noise, model = self.gains(observer)
        out |= {"noise": float(noise[i]), "model": float(model[i])}
        for name, value in out.items():
            sound = value >= 0.0 and (name == "bandwidth" or math.isfinite(value))
            check(sound, name, value, "finite", "choose gains nearer to 1/dt")
        return out

    def gains(self, observer: Observer) -> tuple[Array, Array]:
        """Variances of all estimates per unit of noise and of model error, (n,) each."""
        spec = observer.spec
        if self.slopes is not None:
            of_noise, of_model = self.slopes.shown(np.array([spec["gain"]["ell"]]))[:, 0]
            return of_noise, of_model
        unit = observer.units
        model = response.model_gain(spec, self.dt) * (unit[-1] / unit) ** 2
        return observer.noise_gain(self.dt), model

    def refine(self, record: Record) -> None:
        """R, Q and what they give, once more with the model's slopes along the estimate."""
        if self.noise != self.noise:
            self.found(self.curve.ell, self.curve.innovation**2, record.smallest)
        model = self.any.model
        own = isinstance(model, Model) and model.compiled and model.form in ("phase", "triangular")
        if not (own and math.isfinite(self.noise)):
            return
        assert isinstance(model, Model)
        if model.unknown:  # corrected by a slope of its own, which the law's matrices have not
            return
        curve = self.curve
        least = float(np.min(curve.innovation))
        ends = np.flatnonzero(curve.innovation <= _WIDE * least)[[0, -1]] + [-1, 1]
        first, last = np.clip(ends, 0, len(curve.ell) - 1)
        some = np.unique(np.linspace(first, last, _LANES).astype(int))
        steps = math.ceil(np.clip(8.0 / (curve.ell[first] * self.dt), *_STEPS))
        near = self.made(float(curve.ell[np.argmin(curve.innovation)]))
        run = record.run(near, self.start(record), spare=self.ours)
        moves = path(record, model, run.x_hat, max(_WORK // steps, 2), steps)
        specs = [self.made(float(ell)).spec for ell in curve.ell[some]]
        self.slopes = Slopes.of(specs, self.dt, moves)
        if self.slopes is None:
            return
        self.found(curve.ell, curve.innovation**2, record.smallest)
        noise, lack = np.sqrt(self.slopes.shown(curve.ell)[:, :, self.index])
        self.curve = replace(curve, noise=self.noise * noise, model=self.model_error * lack)

    def rounded(self, record: Record) -> None:
        """sqrt(R) with all of a quantised y's rounding.

        Where that lasts for samples it looks like motion one sample ahead: then R and Q are those
        for which the smoothed state is the best one.
        """
        rounding = record.coarse_step() / math.sqrt(12.0)
        self.lasts = self.noise < _DITHER * rounding
        if self.lasts and self.reference is not None:
            self.noise, self.model_error = self.reference.noise, self.reference.model_error
        self.noise = max(self.noise, record.step() / math.sqrt(12.0))  # NaN stays

    def complete(self) -> None:
        """All columns of the curve, for the structure that is chosen."""
        figures = [self.figures(self.made(float(ell))) for ell in self.curve.ell]
        columns = {name: np.array([of[name] for of in figures]) for name in _LATER}
        columns["noise"] = self.noise * np.sqrt(columns["noise"])
        columns["model"] = self.model_error * np.sqrt(columns["model"])
        self.curve = replace(self.curve, **columns)

    def found(self, grid: Array, squares: Array, smallest: float) -> None:
        """sqrt(R) and sqrt(Q) from innovations: S(ell) = R s_R(ell) + Q s_Q(ell) near its least."""
        from scipy.optimize import nnls

        self.near, self.misfit = 0, math.nan
        if np.min(squares) <= smallest**2:  # no noise: nothing is left beside rounding
            return
        used = np.argsort(squares)
        self.near = int(np.sum(squares <= _NEAR * np.min(squares)))
        used = used[: max(self.near, 3)]
        if self.slopes is not None:
            shares = self.slopes.innovation(grid[used])
        else:
            specs = [self.made(ell).spec for ell in grid[used].tolist()]
            shares = np.array([response.innovation_gain(spec, self.dt) for spec in specs])
            shares[:, 1] *= self.any.units[-1] ** 2
        unit = np.max(shares, axis=0)
        relative = shares / unit / squares[used, None]
        fit, _ = nnls(relative, np.ones(used.size))
        noise, lack = np.sqrt(fit / unit)
        left = (relative @ fit - 1.0)[: self.near]
        self.noise, self.model_error = float(noise), float(lack)
        self.misfit = float(np.sqrt(np.mean(left**2)))

    def point(self, ell: float, measured: float = math.nan) -> dict[str, float]:
        """All columns at one gain, with the error there if it was measured."""
        out = self.figures(self.made(ell))
        noise = self.noise * math.sqrt(out["noise"])
        model = self.model_error * math.sqrt(out["model"])
        error = math.hypot(noise, model)
        measured = measured if self.reference is not None else math.nan
        return {**out, "noise": noise, "model": model, "error": error, "measured": measured}

    def errors(self, ell: float, record: Record | None) -> tuple[Array, Array]:
        """The RMS error of each estimate at one gain, (n,), and what it exceeds hardly.

        On paper from R and Q; over a record by the distance from the smoothed state, whose own
        error adds at most as it stands, and 2 / sqrt(number of times 1/gain) of it by chance.
        """
        noise, model = self.gains(self.made(ell))
        error = np.hypot(self.noise * np.sqrt(noise), self.model_error * np.sqrt(model))
        bound = error.copy()
        if record is None or self.reference is None:
            return error, bound
        run = record.run(self.made(ell), self.start(record), spare=self.ours)
        lasted = self.dt * float(np.sum(record.two_sided)) * ell
        for i in range(min(self.n, len(self.reference.spread))):
            far, spread = self.reference.distance(run.x_hat, record, i), self.reference.spread[i]
            error[i] = math.hypot(far, spread)
            bound[i] = (far + spread) * (1.0 + 2.0 / math.sqrt(max(lasted, 1.0)))
        return error, bound

    def reach(self, name: str, wanted: float) -> float:
        """The least gain with this cutoff, or within this settling time."""
        if name == "cutoff":
            highest = math.pi / self.dt
            remedy = "sample faster, or choose a lower one"
            check(wanted < highest, name, wanted, f"below pi/dt = {highest:.4g} rad/s", remedy)
        figure = response.bandwidth if name == "cutoff" else response.settling
        values = self.curve.bandwidth if name == "cutoff" else -self.curve.settling
        sign = 1.0 if name == "cutoff" else -1.0
        there = np.flatnonzero(values >= sign * wanted)
        if there.size == 0 or there[0] == 0:
            ends = np.abs(values[[0, -1]])
            allowed = f"between {min(ends):.4g} and {max(ends):.4g}, what gains from "
            allowed += f"{self.curve.ell[0]:.4g} to {self.curve.ell[-1]:.4g} /s reach"
            raise HgoError(explain(name, wanted, allowed, "choose another, or give ells="))
        low, high = np.log(self.curve.ell[there[0] - 1 : there[0] + 1]).tolist()
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            if (
                sign * figure(self.made(math.exp(middle)).spec, self.dt)[self.index]
                >= sign * wanted
            ):
                high = middle
            else:
                low = middle
        return math.exp(high)

    def least_error(self) -> float:
        """The gain of the least error: measured where a record tells of it, else R n + Q m."""
        remedy = "there is no noise to compare with; give a noise level and model_error, or cutoff="
        rms = float(np.nanmin(self.curve.innovation)) if self.silent else math.nan
        check(rms != rms, "least RMS innovation", rms, "above the rounding of y", remedy)
        if self.reference is not None:
            return self.least_measured()
        from scipy.optimize import minimize_scalar

        def error(log_ell: float) -> float:
            noise, model = (of[self.index] for of in self.gains(self.made(math.exp(log_ell))))
            return math.hypot(self.noise * math.sqrt(noise), self.model_error * math.sqrt(model))

        k = int(np.argmin(self.curve.error))
        ends = np.log(self.curve.ell[[max(k - 1, 0), min(k + 1, len(self.curve.ell) - 1)]])
        best = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 1e-6})
        return float(math.exp(best.x))

    def least_measured(self) -> float:
        """Where a parabola through the three points around the least has its own, over ln(ell)."""
        measured = np.log(self.curve.measured)
        k = int(np.argmin(measured))
        if k in (0, len(measured) - 1):
            return float(self.curve.ell[k])
        at = np.log(self.curve.ell[k - 1 : k + 2])
        two, one, _ = np.polyfit(at - at[1], measured[k - 1 : k + 2], 2)
        shift = -0.5 * one / two if two > 0.0 else 0.0
        return float(np.exp(at[1] + np.clip(shift, at[0] - at[1], at[2] - at[1])))

    # --- what it cannot know ---

    def none_left(self) -> HgoError:
        """Why there are too few gains: what all say, if it is the same; else what each says."""
        texts = self.left_out()
        first = self.refused[0][1]
        if len(texts) == 1 and isinstance(first, HgoError):
            return first
        return HgoError("fewer than three gains are left: " + "; ".join(texts))

    def left_out(self) -> list[str]:
        """The gains that were refused, and why; reasons that differ by their numbers are one."""
        groups: dict[str, list[tuple[float, Exception]]] = {}
        for ell, error in self.refused:
            groups.setdefault(re.sub(r"[-+]?\d\S*|inf|nan", "#", str(error)), []).append(
                (ell, error)
            )
        out = []
        for group in groups.values():
            gains = [f"{ell:.4g}" for ell, _ in group]
            shown = ", ".join(gains) if len(gains) < 6 else f"{gains[0]}, ..., {gains[-1]}"
            error = group[0][1]
            reason = (
                str(error) if isinstance(error, HgoError) else f"{type(error).__name__}: {error}"
            )
            out.append(f"{len(gains)} of the gains left out ({shown} /s): {reason}")
        return out

    def at_an_edge(self, ell: float) -> list[str]:
        """A least error at an end of the gains that were tried is not known to be the least."""
        low, high = self.curve.ell[[0, -1]].tolist()
        if ell <= low * (1.0 + 1e-3):
            remedy = "give ells= that begin lower, on a log with a longer skip"
            if any(refused < low for refused, _ in self.refused):
                remedy = "lower ones were left out"
            return [f"the least error is at the lowest gain tried, {low:.4g} /s: {remedy}"]
        if ell >= high * (1.0 - 1e-3):
            remedy = "give ells= that end higher, sample faster, or improve the model"
            if any(refused > high for refused, _ in self.refused):
                remedy = "higher ones were left out"
            return [f"the least error is at the highest gain tried, {high:.4g} /s: {remedy}"]
        return []

    def doubts(self, ell: float, record: Record, by_target: bool) -> tuple[float, list[str]]:
        """Whether the innovation at this gain is what white noise R and white model error Q give.

        A portmanteau test. Of the autocorrelations r_j, over n_j pairs, less those rho_j that R and
        Q give with this law, sqrt(n_j) (r_j - rho_j) is normal with Bartlett's covariance if so;
        their normed sum of squares is chi-squared (Box and Pierce, J. Am. Stat. Assoc. 65, 1970,
        for rho_j = 0, the Kalman filter's). A model error that lasts, as friction does,
        makes every long record fail that, at little cost for the gain. It costs where the variance
        S(ell) itself does not follow R and Q, or where the correlation is most of the innovation.
        """
        from scipy.special import chdtrc

        try:
            observer = self.made(ell)
            run = record.run(observer, self.start(record), spare=self.ours)
            innovation = np.where(record.judged, np.ravel(run.innovation), np.nan)
        except HgoError as error:
            return math.nan, [f"the chosen gain, {ell:.4g} /s, is refused over the log: {error}"]
        said = []
        so = "so that the gain may be far too high; compare with lower ones, or choose by cutoff="
        if by_target or self.reference is not None:
            so = "so that noise and model error may be wrong; the gain does not depend on them"
        if 0 < self.near < 3:
            said.append(
                f"the innovation is near its minimum at {self.near} of the gains tried, too few to "
                "estimate noise and model error; give ells= that are closer together"
            )
        if self.lasts and self.reference is not None:
            so = ""
        said += self.of_rounding(record, so)
        whiteness = math.nan
        if math.isfinite(self.misfit):
            far = np.array(
                [self.noise**2, (self.model_error * self.any.units[-1]) ** 2]
            ) @ response.innovation_covariance(observer.spec, self.dt, _LAGS + _FAR)
            rho = far / far[0]
            e, there = np.nan_to_num(innovation), np.isfinite(innovation)
            lags = np.arange(1, _LAGS + 1)
            pairs = np.array([np.sum(there[j:] & there[:-j]) for j in lags])
            products = np.array([e[j:] @ e[:-j] for j in lags])
            excess = products / np.maximum(pairs, 1) / np.nanmean(innovation**2) - rho[lags]
            # Bartlett's covariance of sample autocorrelations, spread @ spread.T / N: 1 if rho = 0
            i, k = lags[:, None], np.arange(1, _FAR + 1)
            spread = rho[k + i] + rho[np.abs(k - i)] - 2.0 * rho[i] * rho[k]
            normal = np.linalg.lstsq(spread, np.sqrt(pairs) * excess, rcond=None)[0]
            whiteness = float(chdtrc(_LAGS, normal @ normal))
            size = float(np.sqrt(np.sum(excess**2)))
            rests = not by_target and self.reference is None
            severe = self.misfit > _MISFIT or (size > _CORRELATED and rests)
            if whiteness < _LEVEL and severe and not said:
                said.append(
                    f"white noise of {self.noise:.3g} and model error of {self.model_error:.3g} do "
                    "not explain the innovation: its autocorrelations differ by "
                    f"{size:.2g} in all (p = {whiteness:.1g}), its variance over the "
                    f"gain by {100.0 * self.misfit:.0f} %, {so}; look for hum, filtering, held "
                    "samples, or terms that the model lacks"
                )
        return whiteness, said

    def of_rounding(self, record: Record, so: str = "") -> list[str]:
        """What to say of rounding that lasts, and what follows; nothing where it does not.

        By itself: the gain is judged by the smoothed state.
        """
        if not self.lasts:
            return []
        so = so or (
            "so that noise and model error are those of the smoothed state; the gain does not "
            "depend on them"
        )
        step = record.coarse_step()
        return [
            f"y moves in steps of {step:.4g}, and most samples differ from the one before by one "
            f"step or not at all; the noise found is little more than rounding "
            f"({step / math.sqrt(12.0):.3g}): it lasts for several samples and is not white, {so}"
        ]
