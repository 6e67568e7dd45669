"""How often the bounds of verdicts hold: records of processes whose quantile and RMS are known.

``python tests/support/coverage.py --records 300 --system`` measures all and prints a table for
docs/developers/coverage.md.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import laplace, norm
from scipy.stats import t as student

from ps_fmu.cosim import Column
from ps_fmu.pointing import AbsoluteError, RelativeError
from ps_fmu.pointing.interpretation import Interpretation
from ps_fmu.requirements.quantity import Limit
from ps_fmu.requirements.record import RequirementRecord
from ps_fmu.requirements.requirement import Requirement
from ps_fmu.requirements.verdict import Answer, judge

STEP = 0.01  # s, between samples
CONFIDENCE = 0.9
STATISTICS = (None, 0.95, 0.9973)
"""RMS and quantiles."""


def white(rng, records, n):
    return rng.standard_normal((records, n))


def markov(rng, records, n, tau_s):
    """Gaussian noise of unit RMS with the correlation exp(-t / tau)."""
    a = math.exp(-STEP / tau_s)
    start = a * rng.standard_normal((records, 1))
    return lfilter([math.sqrt(1.0 - a * a)], [1.0, -a], white(rng, records, n), zi=start)[0]


def resonance(rng, records, n, frequency_hz=1.0, damping=0.02):
    """Noise of unit RMS through a lightly damped oscillator."""
    turn = 2.0 * math.pi * frequency_hz
    pole = np.exp((-damping + 1j * math.sqrt(1.0 - damping**2)) * turn * STEP)
    a = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    settling = int(5.0 / (damping * turn) / STEP)
    variance = (1.0 + a[2]) / ((1.0 - a[2]) * ((1.0 + a[2]) ** 2 - a[1] ** 2))
    return lfilter([1.0], a, white(rng, records, n + settling))[:, settling:] / math.sqrt(variance)


def two_speeds(rng, records, n, share, tau_s):
    """White noise with a slow part that has a share of the variance."""
    return math.sqrt(1.0 - share) * white(rng, records, n) + math.sqrt(share) * markov(rng, records, n, tau_s)


def modulated(rng, records, n, tau_s):
    """The level of white noise varies by half of itself."""
    return white(rng, records, n) * np.exp(0.5 * markov(rng, records, n, tau_s))


def bursts(rng, records, n):
    """Five times as strong in 1 % of the time."""
    return white(rng, records, n) * np.where(rng.random((records, n)) < 0.01, 5.0, 1.0)


def sine(rng, records, n, frequency_hz, noise):
    phase = 2.0 * np.pi * (frequency_hz * STEP * np.arange(n) + rng.random((records, 1)))
    return np.sin(phase) + noise * white(rng, records, n)


@dataclass(frozen=True)
class Process:
    """A stationary process: ``draw`` gives records (records, n), ``above`` the share of magnitudes above a level."""

    name: str
    length_s: float
    draw: Callable[[np.random.Generator, int, int], np.ndarray]
    above: Callable[[float], float] = lambda q: 2.0 * float(norm.sf(q))
    mean_square: float = 1.0

    @cache  # noqa: B019 - there are some thirty
    def truth(self, probability: float | None) -> float:
        if probability is None:
            return math.sqrt(self.mean_square)
        return float(brentq(lambda q: self.above(q) - (1.0 - probability), 1e-6, 1e3, xtol=1e-12))

    def records(self, count: int, seed: int = 1) -> Iterator[np.ndarray]:
        rng = np.random.default_rng([seed, *self.name.encode(), round(self.length_s)])
        for first in range(0, count, 20):
            yield from self.draw(rng, min(20, count - first), round(self.length_s / STEP))


_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(80)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_PHASES = np.sin(2.0 * np.pi * (np.arange(2000) + 0.5) / 2000)


def _mix(sigmas, weights):
    return lambda q: float(2.0 * norm.sf(q / sigmas) @ weights)


def _sine_above(noise):
    return lambda q: float(np.mean(norm.sf((q - _PHASES) / noise) + norm.sf((q + _PHASES) / noise)))


def list_processes(scale: float = 1.0) -> list[Process]:
    """White, coloured, two-speed, resonant, modulated, drifting, periodic and heavy-tailed ones.

    ``scale``: of all times but the step.  At 0.1 there is one length of each, 200 to 2000 samples with as many
    correlation times in it.  A drift has two to twenty of these, which is the least from which anything can be learnt.
    """
    found = []

    def add(name, lengths, draw, *known):
        found.extend(Process(name, length * scale, draw, *known) for length in lengths[: None if scale == 1.0 else 1])

    def slow(share, tau_s):
        return lambda *a: two_speeds(*a, share, tau_s * scale)

    short = (20, 200) if scale == 1.0 else (200,)  # white ones do not scale
    add("white", short, white)
    add("coloured, 0.5 s", (20, 60, 120, 600), lambda *a: markov(*a, 0.5 * scale))
    add("30 % slow, 10 s", (200, 600), slow(0.3, 10.0))
    add("half slow, 30 s", (200, 600), slow(0.5, 30.0))
    add("resonance 1 Hz, 2 %", (60, 120, 200, 600), lambda *a: resonance(*a, 1.0 / scale))
    if scale == 1.0:
        add("10 % slow, 10 s", (200, 600), slow(0.1, 10.0))  # in fewer samples the white part hides it
        add("resonance 5 Hz, 2 %", (20, 60, 120, 600), lambda *a: resonance(*a, 5.0))
    add(
        "modulated, 10 s", (200, 1000), lambda *a: modulated(*a, 10.0 * scale), _mix(np.exp(0.5 * _NODES), _WEIGHTS),
        math.exp(0.5),
    )  # fmt: skip
    add("drift, 100 s", (200,), lambda *a: markov(*a, 100.0 * scale))
    add("drift 50 s, white", (200,), slow(0.5, 50.0))
    add("drift, 20 s", (120, 400), lambda *a: markov(*a, 20.0 * scale))
    add("sine 5 Hz, white", (20, 60), lambda *a: sine(*a, 5.0, 0.5), _sine_above(0.5), 0.75)
    add("sine 0.01 Hz, white", (100,), lambda *a: sine(*a, 0.01 / scale, 0.1), _sine_above(0.1), 0.51)
    add("Laplace", short, lambda r, m, n: r.laplace(size=(m, n)), lambda q: 2 * float(laplace.sf(q)), 2.0)
    add(
        "Student t, 5", short, lambda r, m, n: r.standard_t(5, (m, n)),
        lambda q: 2 * float(student.sf(q, 5)), 5 / 3,
    )  # fmt: skip
    add("bursts", short, bursts, _mix(np.array([1.0, 5.0]), np.array([0.99, 0.01])), 0.99 + 0.25)
    return found


def decide(records, limit, probability, index=None, interpretation=Interpretation.TEMPORAL, step=STEP):
    """The verdict on runs, records (n,) each."""
    statistic = "rms" if probability is None else "quantile"
    required = Requirement(
        "here", "one", ("a.x",), index or AbsoluteError(), Limit(limit, "rad"), statistic, CONFIDENCE, probability,
        interpretation, False, ("active",), 0.0,
    )  # fmt: skip
    runs = []
    for values in records:
        run = RequirementRecord(required, [Column("a.x", "rad", "Real", "")], step, len(values))
        run.block(0, np.arange(len(values)) * step, np.asarray(values)[:, None])
        runs.append(run)
    (verdict,) = judge(required, "active", runs, "")
    return verdict


@dataclass
class Row:
    """What came of the bounds of one process and statistic, in per cent."""

    held: float
    """Bounds that are not below the truth, of all."""
    ranked: float
    """Bounds by order statistics or of the RMS, of all; the others are by Markov's inequality, or there is none."""
    ranked_held: float
    """Of these."""
    excess: float
    """Median of such a bound over the truth."""
    spread: float
    """95 % quantile of all bounds over their values."""
    wrong: float
    """Verdicts that are "met" although the truth is 1 % above the limit, or "not met" although it is 1 % below."""


def measure(truth, records, probability, **how) -> Row:
    """``records``: each what :func:`decide` takes."""
    held, close, spread, wrong = [], [], [], 0
    for record in records:
        verdict = decide(record, 0.99 * truth, probability, **how)
        stated = verdict.statement
        held.append(stated.bound >= truth * (1.0 - 1e-9))
        spread.append(stated.bound / stated.value)
        close.append(math.isfinite(stated.bound) and not stated.method.startswith("Markov"))
        wrong += verdict.answer is Answer.MET
        if stated.lower > 1.01 * truth:
            wrong += 1
        close[-1] = stated.bound / truth if close[-1] else math.nan
    excess = np.array(close)
    ranked = np.isfinite(excess)
    if not ranked.any():
        return Row(100 * np.mean(held), 0.0, math.nan, math.nan, np.quantile(spread, 0.95), 100 * wrong / len(held))
    return Row(
        100 * np.mean(held), 100 * ranked.mean(), 100 * np.mean(np.array(held)[ranked]),
        float(np.median(excess[ranked])), np.quantile(spread, 0.95), 100 * wrong / len(held),
    )  # fmt: skip


def measure_process(process: Process, probability: float | None, records: int) -> Row:
    return measure(process.truth(probability), ([one] for one in process.records(records)), probability)


def list_ensembles(kind: str, rng: np.random.Generator, runs: int, samples: int = 2000) -> list[np.ndarray]:
    """Runs of white noise that differ in their level (30 and 60 %), in their bias, or in nothing."""
    level, bias = np.ones((runs, 1)), np.zeros((runs, 1))
    if kind.startswith("level"):
        level = np.exp(float(kind.split()[1]) * rng.standard_normal((runs, 1)))
    elif kind == "bias":
        bias = rng.standard_normal((runs, 1))
    return list(bias + level * rng.standard_normal((runs, samples)))


ENSEMBLES = {
    "alike": _mix(np.ones(1), np.ones(1)),
    "level 0.3": _mix(np.exp(0.3 * _NODES), _WEIGHTS),
    "level 0.6": _mix(np.exp(0.6 * _NODES), _WEIGHTS),
    "bias": lambda q: float(2.0 * norm.sf(q / math.sqrt(2.0))),
}
"""Kind of ensemble -> probability that a magnitude at a random time of a random run is above."""


def measure_mixed(kind: str, runs: int, probability: float, ensembles: int) -> Row:
    truth = float(brentq(lambda q: ENSEMBLES[kind](q) - (1.0 - probability), 1e-6, 1e3, xtol=1e-12))
    rng = np.random.default_rng([runs, *kind.encode()])
    drawn = (list_ensembles(kind, rng, runs) for _ in range(ensembles))
    return measure(truth, drawn, probability, interpretation=Interpretation.MIXED)


def measure_system(length_s: float, probability: float | None, values: np.ndarray, step: float, records: int) -> Row:
    """Of RPE over 1 s; ``values`` (signals, n): the rotation of the payload of the default system, settled."""
    index, count = RelativeError(1.0, "uniform"), round(length_s / step)
    rows = []
    for one in values:
        sizes = np.abs(index.values(one[:, None], step, stride=round(1.0 / step))).ravel()
        truth = math.sqrt(np.mean(sizes**2)) if probability is None else np.quantile(sizes, probability)
        parts = [[one[first : first + count]] for first in range(0, len(one) - count + 1, count)][: records // 3]
        rows.append((len(parts), measure(float(truth), parts, probability, index=index, step=step)))
    weights = [number for number, _ in rows]
    ranked = [number * row.ranked for number, row in rows]
    return Row(
        np.average([row.held for _, row in rows], weights=weights), sum(ranked) / sum(weights),
        np.average(np.nan_to_num([row.ranked_held for _, row in rows]), weights=ranked) if any(ranked) else math.nan,
        float(np.nanmean([row.excess for _, row in rows])) if any(ranked) else math.nan,
        np.average([row.spread for _, row in rows], weights=weights),
        np.average([row.wrong for _, row in rows], weights=weights),
    )  # fmt: skip


def simulate_system(length_s: float, runs: int) -> tuple[np.ndarray, float]:
    """Rotation of the payload (3, n) over runs of the default system with the isolator, each settled for 10 s."""
    import ps_fmu

    step, found = 0.005, []
    with ps_fmu.Session("isolation", duration=length_s + 10.0, storage_step=step) as session:
        for seed in range(1, runs + 1):
            case = session.run(seed=seed, cases=("active",))["active"]
            found.append(case["payload_rotation"].transpose("axis", "time").values[:, 2001:])
            print(f"\r{seed} of {runs} runs", end="", file=sys.stderr, flush=True)
    return np.concatenate(found, axis=1), step


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=300)
    parser.add_argument("--only", default="", help="part of the names of the processes")
    parser.add_argument("--scale", type=float, default=1.0, help="of all times but the step")
    parser.add_argument("--system", action="store_true", help="the default system, too")
    given = parser.parse_args()
    head = "| {} | held | by ranks | of these held | bound over truth | over value, 95 % | wrong |"
    print(head.format("record | statistic"), "|---|---|---|---|---|---|---|---|", sep="\n")

    def show(name: str, probability: float | None, row: Row) -> None:
        what = "RMS" if probability is None else f"{100 * probability:g} %"
        shares = [f"{share:.0f} %" for share in (row.held, row.ranked, row.ranked_held)]
        cells = (*shares, f"{row.excess:.2f}", f"{row.spread:.2f}", f"{row.wrong:.0f} %")
        print("|", " | ".join((name, what, *("-" if "nan" in cell else cell for cell in cells))), "|")
        sys.stdout.flush()

    for process in list_processes(given.scale):
        if given.only in process.name:
            for probability in STATISTICS:
                row = measure_process(process, probability, given.records)
                show(f"{process.name}, {process.length_s:g} s", probability, row)
    for kind in ENSEMBLES:
        for runs in (5, 10, 20, 45):
            if given.only in f"mixed, {kind}":
                for probability in STATISTICS[1:]:
                    show(
                        f"mixed, {kind}, {runs} runs",
                        probability,
                        measure_mixed(kind, runs, probability, given.records),
                    )
    if given.system:
        values, step = simulate_system(600.0, max(1, -(-given.records // 3)))  # three axes of each
        for length in (20.0, 60.0, 120.0, 600.0):
            for probability in STATISTICS:
                row = measure_system(length, probability, values, step, given.records)
                show(f"default system, {length:g} s", probability, row)


if __name__ == "__main__":
    main()
