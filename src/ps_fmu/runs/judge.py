"""The requirements of a run: checked before it begins, observed in each of its cases, judged when all are done."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from ..cosim import Column
from ..pointing.index import PointingIndex
from ..pointing.indices import AbsoluteError, DriftError, MeanError, ReproducibilityError
from ..requirements.distribution import Distribution
from ..requirements.record import RequirementRecord
from ..requirements.requirement import Requirement, RequirementError, find_targets, read_requirements
from ..requirements.verdict import Verdict, judge, no_run
from .index_record import SIGNALS, WINDOW_S, is_alike, list_kinds
from .options import OptionError, RunOptions
from .scenario import ORIGINAL

SLOW = AbsoluteError, MeanError, DriftError, ReproducibilityError  # indices of which a drift is a part
LEAST_DRIFT = 0.7  # of a value: what is left is hardly anything else
SOME = 0.1  # of a limit: smaller errors are not worth a word
USUAL_LEVEL = 0.95  # of a quantile beside an RMS or a peak


@dataclass(frozen=True)
class RunJudge:
    """Requirements and their records, case by case; without requirements it observes nothing."""

    requirements: tuple[Requirement, ...] = ()
    floats: bool = False
    """The bus is free, and nothing controls its attitude."""
    _records: list[tuple[str, RequirementRecord]] = field(default_factory=list)
    _cases: list[str] = field(default_factory=list)

    def observe(
        self, case: str, columns: Sequence[Column], step_s: float, steps: int, lead_s: float = 0.0
    ) -> list[RequirementRecord]:
        """The observers of a case, for each requirement that judges it; ``lead_s`` of its ``steps`` are its lead-in.

        Raises :class:`..requirements.requirement.RequirementError` if the case is too short for one.
        """
        self._cases.append(case)
        wanted = [requirement for requirement in self.requirements if requirement.judges(case)]
        records = [RequirementRecord(requirement, columns, step_s, steps + 1, lead_s) for requirement in wanted]
        self._records.extend((case, record) for record in records)
        return records

    def list_signals(self, case: str, columns: Sequence[Column]) -> set[str]:
        """Names of the columns that the requirements of a case look at."""
        wanted = [requirement for requirement in self.requirements if requirement.judges(case)]
        targets = [target for requirement in wanted for target in find_targets(requirement, columns)]
        return {columns[place].name for target in targets for place in target.places}

    def list_distributions(self) -> Iterator[tuple[Requirement, str, str, Distribution]]:
        """Requirement, case, target and its distribution, of all that have values."""
        for case, record in self._records:
            for target, found in zip(record.targets, record.distributions, strict=False):  # none before a full window
                yield record.requirement, case, target.label, found

    def list_levels(self) -> list[tuple[PointingIndex, float]]:
        """Index and probability of each requirement on the payload, each once; that of an RMS or a peak is 95 %."""
        levels = [
            (one.index, one.probability or USUAL_LEVEL)
            for one in self.requirements
            if any(signal == name or name.startswith(f"{signal}.") for signal in one.signals for name in SIGNALS)
        ]
        return list(dict.fromkeys(levels))

    def list_windows(self) -> tuple[float, ...]:
        """Windows of :meth:`list_levels`, s, other than that of all runs."""
        found = [(index, getattr(index, "window", WINDOW_S)) for index, _ in self.list_levels()]
        others = [w for index, w in found if w != WINDOW_S and any(is_alike(index, one) for one in list_kinds(w))]
        return tuple(dict.fromkeys(others))

    def choose_unit(self, unit: str) -> tuple[str, float]:
        """The unit of the first requirement that fits a unit, and the factor into it; without any, the unit itself."""
        for requirement in self.requirements:
            with suppress(ValueError):
                return requirement.limit.unit, requirement.limit.value / requirement.limit.to(unit)
        return unit, 1.0

    def conclude(self) -> list[Verdict]:
        """The verdicts, in the order of the requirements, then of the cases."""
        found: list[Verdict] = []
        for requirement in self.requirements:
            own = [(case, record) for case, record in self._records if record.requirement is requirement]
            for case, record in own:
                verdicts = judge(requirement, case, [record], f"every step of {record.step:g} s{record.after}")
                found += map(self._note_drift, verdicts, record.drifts)
            if not own:
                found.append(no_run(requirement, self._cases))
        return found

    def _note_drift(self, verdict: Verdict, drift: float) -> Verdict:
        """The verdict, with a remark if its value is made by the drift, in the unit of its signal, of a free bus."""
        stated = verdict.statement
        if stated is None or not self.floats or not isinstance(verdict.requirement.index, SLOW):
            return verdict
        if drift < LEAST_DRIFT * max(stated.value, SOME * verdict.limit):
            return verdict
        remark = (
            f"The signal drifts by {verdict.convert(drift):.3g} {verdict.requirement.limit.unit} from the first to the "
            "last row judged. The bus has no attitude control: the momentum that the disturbance leaves keeps turning "
            "it, and a longer run has a larger error. The attitude control of your spacecraft limits this drift; to "
            "see the error without it, take the mean out of the disturbance."
        )
        return replace(verdict, remark=" ".join(filter(None, (verdict.remark, remark))))


def read_judge(options: RunOptions, columns: Sequence[Column], *, floats: bool = False) -> RunJudge:
    """The requirements of the options, checked against the outputs of the system, the step, and the runs.

    ``floats``: nothing controls the attitude of the bus.

    Raises :class:`OptionError` for what cannot be used.
    """
    if options.requirements is None:
        return RunJudge()
    try:
        requirements, cases = read_requirements(options.requirements), options.scenario.find_cases()
        if options.replace and options.scenario.compares:
            cases = (*cases, ORIGINAL)
        for requirement in requirements:
            find_targets(requirement, columns)
            requirement.check_times(options.step_s, options.duration_s)
            if cases:
                requirement.check_cases(cases)
    except RequirementError as error:
        raise OptionError(f"--requirements: {error}") from error
    return RunJudge(requirements, floats)
