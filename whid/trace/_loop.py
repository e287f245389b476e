"""The closed loop: what is left over, what would explain it, add it, again; then the verdict, and only then the report."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Screened
from whid.effects._look import Look, Noise
from whid.effects._sites import Sites
from whid.errors import WhidError
from whid.fit import Estimate
from whid.methods._method import Model
from whid.record import Record
from whid.signal import Floats, rms
from whid.stages._whiten import autoregression, whitened
from whid.system import System
from whid.trace._floor import Floor, floor
from whid.trace._gate import Gate, gate
from whid.trace._left_over import left_over
from whid.trace._measure import measured
from whid.trace._options import Trace
from whid.trace._refit import Refit, error2, fitted, polished, refit
from whid.trace._report import Ranking, ResidualReport
from whid.trace._selection import Bools, cut
from whid.trace._verdict import Errors, Found, Step, Verdict, Word

NEEDED = 10.0  # nats that an effect must gain beyond its penalty
FINALISTS = 4  # effects that are refitted in a round
STARTS = 2  # of each
STUCK = 1.5  # of the noise's variance: such a base fit is tried again from other starts
SCATTERED = 3  # of them
NEAR = 0.05  # of the range of v: how far off a declared breakpoint may be
BORDERS = ("breaks", "low", "high", "inputs", "at")
QUIET = 0.01  # p of the gate above which effects of the input are not looked for again
CERTAIN = ("dropouts", "quantizer")  # seen without a model
OF_TIME = (
    "drift", "gain_drift", "offset_step", "gain_step", "hum", "outliers", "dropouts", "quantizer", "jitter",
    "coloured_noise", "process_noise", "level_noise",
)  # fmt: skip
PROMISING = 3.0  # nats by score, below which a refit would not reach what is needed
BEHIND = 0.25  # of the best score: what promises less is not refitted
CLASS = 4.0  # nats: refits closer than this to the best cannot be told from it
MOST = 0.5  # of what was left over: what an effect must explain to be named


def trace(system: System, records: Sequence[Record], options: Trace, path: str = "exact") -> Iterator[Any]:
    """Yield the residual report, the ranking of every round, the verdict, and last the refined Model.

    system   the declared tree: its structure counts, its numbers are start values
    records  with their report samples: these are looked at once, when the verdict is frozen
    """
    return _Loop(system, tuple(records), options, path).run()


@dataclass
class _State:
    """The model so far."""

    look: Look
    estimate: Estimate
    gate: Gate
    added: Refit | None = None
    rivals: tuple[Refit, ...] = ()


@dataclass
class _Loop:
    system: System
    records: tuple[Record, ...]
    options: Trace
    path: str
    began: float = field(default_factory=time.perf_counter)
    states: list[_State] = field(default_factory=list)
    selection: tuple[Bools, ...] = ()
    floor: Floor = field(init=False)
    coloured: bool = field(init=False)

    def run(self) -> Iterator[Any]:
        closed = self.closed_records()
        seen, self.selection = cut(closed)
        self.coloured = any(noise.kind == "ar" for noise in self.system.noise)
        self.floor = floor(closed, self.coloured)
        self.states = [self.base(seen)]
        yield self.residual_report(self.states[0])
        effects = self.options.every()
        for _ in range(self.options.rounds):
            ranking, state = self.round(effects)
            yield ranking
            if state is None:
                break
            self.states.append(state)
            self.backward()
            effects = self.options.every()
            if (
                self.states[-1].gate.p > QUIET
            ):  # nothing answers to the input any more: what is left lives in time, or is noise
                effects = tuple(e for e in effects if e.place in ("noise", "output", "time") and e.kind in OF_TIME)
        verdict = self.verdict()
        state = self.states[-1] if verdict.verdict in ("explained", "ambiguous") else self.states[0]
        yield left_over(self.closed_records(), self.states[0].look, state.look, verdict.floor)
        yield self.opened(verdict)
        yield Model(state.look.system, state.estimate, "none")

    def base(self, seen: Sequence[Record]) -> _State:
        """Fit the declared model, the noise with it."""
        std = self.floor.std if self.floor.dof else 1.0
        noise = Noise(std, tuple(self.floor.ar)) if self.floor.dof else Noise()
        look, estimate = fitted(
            Look(self.system, tuple(seen), (noise,) * len(seen), (0, len(self.system.series)), self.path)
        )
        if self.floor.dof and error2(look) > STUCK * look.samples:
            look, estimate = self.best_of(look, estimate)
        if not self.floor.dof:
            for _ in range(3 if self.coloured else 1):
                look = self.with_noise(look)
                look, estimate = fitted(look)
        return _State(look, estimate, gate(look))

    def best_of(self, look: Look, estimate: Estimate) -> tuple[Look, Estimate]:
        """Return the best fit from other starts: a gross error may be a fit that stopped at a wrong place.

        Breakpoints are searched without derivatives, all other numbers absorbing what they can; then all numbers scattered.
        """
        starts = []
        borders = [p.name for p in look.system.tree.parameters() if _head(p.name) in BORDERS]
        if borders:
            low, high = look.span((Sites(look.system, look.core).nonlinear or [0])[0])
            searched = Candidate(
                look.system, look.core, tuple(borders), (), tuple((b, NEAR * (high - low)) for b in borders)
            )
            starts += [polished(look, searched).system]
        rng = np.random.default_rng(SCATTERED)
        for _ in range(SCATTERED):
            free = self.system.tree.parameters()
            factors = 1 + 0.1 * rng.standard_normal(len(free))
            moved = {p.name: float(np.clip(p.value * f, p.lower, p.upper)) for p, f in zip(free, factors, strict=True)}
            starts.append(replace(self.system, chain=self.system.tree.with_parameters(moved).chain))
        for start in starts:
            try:
                other, found = fitted(look.moved(start))
            except (WhidError, ValueError, np.linalg.LinAlgError):
                continue
            if error2(other) < error2(look):
                look, estimate = other, found
        return look, estimate

    def with_noise(self, look: Look) -> Look:
        """Return the look with each record's noise as its residual shows it."""
        noises = []
        for error, use, noise in zip(look.errors, look.use, look.noises, strict=True):
            ar = autoregression(error, use) if self.coloured or noise.ar else np.empty(0)
            white = whitened(np.where(use, error, 0.0)[:, None], use, ar)[:, 0]
            shape = np.ones(len(use)) if noise.shape is None else noise.shape
            noises.append(Noise(max(rms(white[use] / shape[use]), 1e-300), tuple(ar), noise.shape))
        return replace(look, noises=tuple(noises), _courses={})

    def round(self, effects: Sequence[Effect]) -> tuple[Ranking, _State | None]:
        """Screen everything, refit the best few, and say which is to be added."""
        here = self.states[-1]
        look = here.look
        dirty = here.gate.p < here.gate.threshold
        ranked = sorted((s for e in effects if (s := e.screen(look))), key=lambda s: -s[0].gain)
        fits: list[Refit] = []
        for starts in ranked:
            first = starts[0]
            if first.told is not None and dirty and first.effect.kind not in CERTAIN:
                continue  # what answers to the input is no noise
            best = max(fits, key=lambda f: f.gain, default=None)
            if len(fits) == FINALISTS or first.gain < PROMISING or (best and first.gain < BEHIND * best.gain):
                break
            found = refit(look, starts[: 1 if best and self.clean(best) else STARTS])
            if found is not None:
                fits.append(found if found.told else self.ranked_by_selection(look, found))
        good = self.in_order([f for f in fits if not self.vetoed(f) and not f.entangled])
        taken = good[0] if good and good[0].gain > NEEDED else None
        ranking = _ranking(ranked, fits, [f.effect.name for f in fits if self.vetoed(f)], taken, good)
        if taken is None:
            return ranking, None
        rivals = tuple(f for f in good[1:] if taken.gain - f.gain < CLASS)
        after = taken.look if self.floor.dof or taken.told else self.with_noise(taken.look)
        return ranking, _State(after, taken.estimate, gate(after), taken, rivals)

    def in_order(self, fits: Sequence[Refit]) -> list[Refit]:
        """Return refits, the best first: by likelihood where the noise was measured.

        Where no period repeats, the last model's misfit passes for noise and likelihoods compare misfits: a free course in
        time fits any of them. Then the gain on selection data decides, and where that does not, the fewer numbers.
        """
        by_gain = sorted(fits, key=lambda f: -f.gain)
        if self.floor.dof or not fits or any(f.told for f in fits):
            return by_gain
        best = max(fits, key=lambda f: f.selection)
        worse = best.selection - best.selection_std
        return sorted(by_gain, key=lambda f: (f.selection < worse, len(f.candidate.new)))

    def clean(self, found: Refit) -> bool:
        """Tell whether a refit leaves nothing that answers to the input."""
        tested = gate(found.look)
        return tested.p >= tested.threshold

    def ranked_by_selection(self, before: Look, found: Refit) -> Refit:
        """Return the refit with its gain on selection data and that gain's standard error."""
        total, change2 = 0.0, 0.0
        for r, old, new, keep, noise in zip(
            self.closed_records(), before.predicted, found.look.predicted, self.selection, found.look.noises, strict=True
        ):
            columns = np.stack([r.y - old, r.y - new], axis=1)
            white = whitened(np.where(keep[:, None], columns, 0.0), keep, np.array(noise.ar))[keep] / noise.std
            total += float(white[:, 0] @ white[:, 0] - white[:, 1] @ white[:, 1]) / 2
            change2 += float(np.sum((white[:, 0] - white[:, 1]) ** 2))
        return found._replace(selection=total, selection_std=float(np.sqrt(change2)))

    def closed_records(self) -> list[Record]:
        """Return what the loop may see: records without their report samples, those that are all report left out."""
        closed = [r.without("report") if r.using("report").any() else r for r in self.records]
        return [r for r in closed if (r.using("estimation") | r.using("selection")).any()]

    def vetoed(self, found: Refit) -> bool:
        """Tell whether selection data speak against a refit: a loss that chance would not make."""
        expected = found.selection_std**2 / 2
        return found.selection < -1.0 and found.selection < expected - 2.5 * found.selection_std

    def backward(self) -> None:
        """Drop an earlier effect that the last one made redundant."""
        if len(self.states) < 3:
            return
        last = self.states[-1].added
        if last is None or last.told is not None:
            return
        for k in range(len(self.states) - 2, 0, -1):
            added = self.states[k].added
            if added is None or added.told is not None:
                continue
            before = self.states[k - 1].look
            starts = last.effect.screen(before)
            alone = refit(before, starts[:STARTS]) if starts else None
            both = self.states[-1].look
            if (
                alone is not None
                and error2(replace(alone.look, noises=both.noises, _courses={})) - error2(both) < 2 * NEEDED
            ):
                state = _State(alone.look, alone.estimate, gate(alone.look), alone)
                self.states = [*self.states[:k], state]
                return

    def residual_report(self, state: _State) -> ResidualReport:
        look = state.look
        pairs = zip(self.closed_records(), look.predicted, self.selection, strict=True)
        selection = np.concatenate([(r.y - p)[keep] for r, p, keep in pairs])
        errors = np.concatenate([e[np.isfinite(e)] for e in look.errors])
        std, origin = self.noise_level()
        return ResidualReport(
            rms(errors), rms(selection), std, origin, rms(errors) / std, state.gate.p,
            tuple(t.name for t in state.gate.tests), np.array([t.statistic for t in state.gate.tests]),
            np.array([t.p for t in state.gate.tests]), tuple(t.where for t in state.gate.tests),
        )  # fmt: skip

    def noise_level(self) -> tuple[float, str]:
        """Return σ of the noise on y, and where it comes from."""
        if self.floor.dof:
            return self.floor.std, f"from the scatter of repeated periods, {self.floor.dof} degrees of freedom"
        errors = np.concatenate([e[np.isfinite(e)] for e in self.states[-1].look.errors])
        return rms(errors), "assumed: the last model's residual is taken for noise, since no period repeats"

    def verdict(self) -> Verdict:
        """Say what is missing, the report still closed."""
        std, origin = self.noise_level()
        first, last = self.states[0], self.states[-1]
        steps = self.states[1:]
        found = tuple(_found(s.added) for s in steps if s.added is not None)
        rivals = tuple((f.effect.kind, f.effect.place) for f in last.rivals) if steps else ()
        before, after = (self.excess(s, std) for s in (first, last))
        explained = 1 - after / before if before > 0 else 1.0
        dirty = last.gate.p < last.gate.threshold
        leads: tuple[Found, ...] = ()
        word: Word
        if not steps and first.gate.p >= first.gate.threshold:
            word, sentence = (
                "nothing missing",
                "nothing missing: the residual is noise, and no effect would pay for its numbers",
            )
        elif not steps or (dirty and explained < 1 - MOST / 2):
            word, leads, found, rivals = "unattributed", found, (), ()
            sentence = f"unattributed: {(last if steps else first).gate.words}"
            if leads:
                sentence += f"; leads, each a part only: {', '.join(f.name for f in leads)}"
        elif rivals:
            word = "ambiguous"
            sentence = f"ambiguous: {found[-1].name} or {' or '.join(f'{k}@{p}' for k, p in rivals)}"
        else:
            word, sentence = "explained", f"explained: {'; '.join(f'{f.name} ({f.words})' for f in found)}"
        blank = Errors(*([float("nan")] * 6))
        return Verdict(
            word, sentence, found, rivals, leads, "", blank, blank, std, origin, first.gate.p, last.gate.p, (),
            time.perf_counter() - self.began,
        )  # fmt: skip

    def excess(self, state: _State, std: float) -> float:
        errors = np.concatenate([e[np.isfinite(e)] for e in state.look.errors])
        return max(rms(errors) ** 2 - std**2, 0.0)

    def opened(self, verdict: Verdict) -> Verdict:
        """Return the verdict with the errors before and after: the one time that report data are looked at."""
        on = "report" if any(r.using("report").any() for r in self.records) else "estimation"
        kept = self.states if verdict.verdict in ("explained", "ambiguous") else self.states[:1]
        steps = tuple(
            Step(
                "as declared, refitted" if s.added is None else f"+ {s.added.effect.name}",
                0.0 if s.added is None else s.added.gain, on,
                measured(s.look.system, self.records, on, verdict.floor, self.path),
            )
            for s in kept
        )  # fmt: skip
        return verdict._replace(
            on=on, before=steps[0].errors, after=steps[-1].errors, steps=steps,
            seconds=time.perf_counter() - self.began,
        )  # fmt: skip


def _found(added: Refit) -> Found:
    if added.told is not None:
        return Found(added.effect.kind, added.effect.place, added.told.numbers, added.told.std)
    values = added.candidate.values
    std = dict(zip(added.estimate.names, added.estimate.std.tolist(), strict=True))
    short = {
        name: ".".join(name.split(".")[-2:]) if name.split(".")[-1].isdecimal() else name.split(".")[-1] for name in values
    }
    return Found(
        added.effect.kind, added.effect.place, {short[n]: float(v) for n, v in values.items()},
        {short[n]: float(std.get(n, float("nan"))) for n in values},
    )  # fmt: skip


def _ranking(
    ranked: Sequence[Sequence[Screened]], fits: Sequence[Refit], vetoed: Sequence[str], taken: Refit | None,
    good: Sequence[Refit],
) -> Ranking:  # fmt: skip
    by_name = {f.effect.name: f for f in fits}
    rows = sorted(
        ranked, key=lambda s: -(by_name[s[0].effect.name].gain if s[0].effect.name in by_name else s[0].gain - 1e9)
    )
    names = tuple(s[0].effect.name for s in rows)
    n = taken.look.samples if taken else (fits[0].look.samples if fits else 1)

    def column(value: Any) -> Floats:
        return np.array([value(by_name.get(s[0].effect.name), s[0]) for s in rows], float)

    nan = float("nan")
    count = column(lambda f, s: len(s.candidate.new))
    tried = column(lambda f, s: s.candidate.tried)
    return Ranking(
        names, count, tried, count / 2 * np.log(n) + np.log(tried), column(lambda f, s: s.gain),
        column(lambda f, s: f.gain if f else nan), column(lambda f, s: f.selection if f else nan),
        column(lambda f, s: f.selection_std if f else nan), tuple(vetoed), taken.effect.name if taken else "",
        good[0].gain - (good[1].gain if len(good) > 1 else 0.0) if good else nan, NEEDED,
    )  # fmt: skip


def _head(name: str) -> str:
    """Return the field that a number belongs to: `breaks` of chain.1.breaks.0."""
    parts = name.split(".")
    return parts[-2] if parts[-1].isdecimal() else parts[-1]
