"""Results of analyses as they are kept in docs/paper."""

import json
from pathlib import Path

from ps_fmu.analyses.result import AnalysisResult
from ps_fmu.paper.published import make_finding
from ps_fmu.results.report import Picture
from ps_fmu.results.tables import Table

KEPT = Path(__file__).parents[2] / "docs" / "paper"
PARTS = ("workspace", "trajectories", "transmissibility", "stability", "jitter")


def read_result(name: str, parts: tuple[str, ...] = ()) -> AnalysisResult:
    """The result of an analysis, and of those that it puts together, as when it was written."""
    content = json.loads((KEPT / f"{name}.json").read_text(encoding="utf-8"))
    keys = ("key", "computed", "cosimulated", "remark", "setting")
    return AnalysisResult(
        name=name,
        title=content["title"],
        text=content["text"],
        findings=[make_finding(**{key: entry[key] for key in keys}) for entry in content["findings"]],
        tables=[Table(**table) for table in content["tables"]],
        pictures=[Picture(KEPT / picture["file"], picture["caption"]) for picture in content["pictures"]],
        parts=[read_result(part) for part in parts],
    )
