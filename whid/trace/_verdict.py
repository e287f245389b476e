"""What the closed loop says: the verdict, its numbers before and after, and the same as one object for programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args

from whid.quantity import Measured, Quantity, Table
from whid.tables import jsonable

Word = Literal["nothing missing", "explained", "ambiguous", "unattributed"]


class Errors(NamedTuple):
    """The error of a model on data that had no part in any choice, with 95 % intervals."""

    rms: Annotated[float, Quantity("output")]
    rms_low: Annotated[float, Quantity("output")]
    rms_high: Annotated[float, Quantity("output")]
    nrmse: Annotated[float, Quantity("1")]
    fit: Annotated[float, Quantity("%")]
    over_floor: Annotated[float, Quantity("1")]  # rms over the noise floor

    def plain(self) -> dict[str, Any]:
        """Return it as `--json` has it."""
        half = 1 / self.rms if self.rms else 0.0
        scaled = {
            name: [float(getattr(self, name)) * side * half for side in (self.rms_low, self.rms_high)]
            for name in ("rms", "nrmse", "over_floor")
        }
        ends = [100 * (1 - x) for x in reversed(scaled["nrmse"])]
        values = {name: float(getattr(self, name)) for name in ("rms", "nrmse", "fit", "over_floor")}
        return values | {"interval": scaled | {"fit": ends}}


class Found(NamedTuple):
    """An effect that was added: its numbers by name, their standard errors, and what it gained, penalties paid."""

    kind: str
    place: str
    parameters: Mapping[str, float]
    std: Mapping[str, float]
    gain: Annotated[float, Quantity("nat")] = 0.0

    @property
    def name(self) -> str:
        """Return `kind@place`."""
        return f"{self.kind}@{self.place}"

    @property
    def course(self) -> bool:
        """Tell whether it is a free course in time through three points or more; a straight line goes on."""
        return "levels.2" in self.parameters

    @property
    def words(self) -> str:
        """Return its numbers as people read them."""
        from whid.tables import measured

        return ", ".join(f"{name} {measured(v, self.std.get(name, float('nan')))}" for name, v in self.parameters.items())


class Step(NamedTuple):
    """One state of the model on the way: which effect was added, and the error then."""

    added: str
    gain: Annotated[float, Quantity("nat")]  # log-likelihood, penalties paid
    on: str  # report, or estimation where there is no report part
    errors: Errors


class Verdict(NamedTuple):
    """What the model lacked, and the error before and after it was added.

    verdict    nothing missing | explained | ambiguous | unattributed
    effects    what was added, in order; of `unattributed` empty: `leads` names what explains a part
    equivalent the other members of the last effect's class: refits that this record cannot tell from it
    on         the use that before and after were measured on: report, or estimation ("in sample, not evidence")
    p          chance of the first residual if nothing were missing
    """

    verdict: Word
    sentence: str
    effects: tuple[Found, ...]
    equivalent: tuple[tuple[str, str], ...]
    leads: tuple[Found, ...]
    on: str
    before: Errors
    after: Errors
    floor: Annotated[float, Quantity("output")]
    floor_from: str
    p: float
    p_left: float
    steps: tuple[Step, ...]
    seconds: Annotated[float, Quantity("s")]

    def doubts(self) -> tuple[str, ...]:
        """Return what must not be believed of an error after: a free course in time does not go on beyond its data."""
        names = [effect.name for effect in self.effects if effect.course and self.on == "report"]
        return tuple(
            f"{name} is a course in time, known where it was fitted: on report data it predicts nothing" for name in names
        )

    def table(self) -> Table:
        """Return the error of every step."""
        rows = tuple(
            (
                step.added, None if k == 0 else round(step.gain, 1), Measured(step.errors.rms, _half(step.errors)),
                step.errors.nrmse, step.errors.fit, step.errors.over_floor,
            )
            for k, step in enumerate(self.steps)
        )  # fmt: skip
        where = "on report data, opened after the verdict" if self.on == "report" else "in sample, not evidence"
        notes = (self.sentence, f"errors {where}; noise floor {self.floor:.4g}, {self.floor_from}", *self.doubts())
        columns = ("model", "gain, nat", "rms, output", "nrmse", "fit, %", "over the noise floor")
        return Table("Verdict", columns, rows, notes)

    def metrics(self) -> dict[str, float | Measured]:
        """Return what bounds and sweeps count: 1 for the word, 0 for the others; the errors; every effect's numbers.

        verdict.explained …, verdict.before.rms, verdict.after.over_floor …, verdict.friction@parallel.coefficient …
        """
        found: dict[str, float | Measured] = {
            f"verdict.{word.replace(' ', '_')}": float(word == self.verdict) for word in get_args(Word)
        }
        for side, errors in (("before", self.before), ("after", self.after)):
            found[f"verdict.{side}.rms"] = Measured(float(errors.rms), float(_half(errors)))
            found |= {f"verdict.{side}.{name}": float(getattr(errors, name)) for name in ("nrmse", "fit", "over_floor")}
        for effect in self.effects:
            for name, value in effect.parameters.items():
                found[f"verdict.{effect.name}.{name}"] = Measured(float(value), float(effect.std.get(name, float("nan"))))
        return found


def _half(errors: Errors) -> float:
    return (errors.rms_high - errors.rms_low) / (2 * 1.96)


def as_object(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as `whid trace --json` prints it.

    {verdict, effects: [{kind, place, parameters, std}], equivalent: [[kind, place], …], before: {rms, nrmse, fit,
    over_floor}, after: {…}, floor, steps: […], seconds}, and beside these sentence, leads, on, floor_from, p, p_left.
    """
    found: dict[str, Any] = jsonable(
        {
            "verdict": verdict.verdict,
            "effects": [_plain(effect) for effect in verdict.effects],
            "equivalent": [list(pair) for pair in verdict.equivalent],
            "before": verdict.before.plain(),
            "after": verdict.after.plain(),
            "floor": verdict.floor,
            "steps": [
                {"added": step.added, "gain": step.gain, "on": step.on, **step.errors.plain()} for step in verdict.steps
            ],
            "seconds": verdict.seconds,
            "sentence": verdict.sentence,
            "leads": [_plain(lead) for lead in verdict.leads],
            "on": verdict.on,
            "floor_from": verdict.floor_from,
            "p": verdict.p,
            "p_left": verdict.p_left,
        }
    )
    return found


def _plain(effect: Found) -> dict[str, Any]:
    return {"kind": effect.kind, "place": effect.place, "parameters": dict(effect.parameters), "std": dict(effect.std)}
