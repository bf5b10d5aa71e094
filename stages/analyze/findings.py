"""dense2sparse against dense, said no more strongly than the verdicts on the claims allow: they are made by them."""

from collections.abc import Sequence

from stages.analyze.claims import Claim, Setting
from stages.analyze.formats import compared, figure
from stages.analyze.results import Group, misalignment
from stages.analyze.statistics import Statistics
from stages.analyze.verdicts import judge

_SAID = {"reproduced": "higher", "different": "lower"}


def findings(groups: Sequence[Group], statistics: Statistics, confidence: str) -> list[str]:
    """A sentence on every setting that has both."""
    several = len({group.name for group in groups}) > 1
    found = [_finding(ours, groups, statistics, confidence, several) for ours in groups]
    return [sentence for sentence in found if sentence]


def _finding(
    ours: Group, groups: Sequence[Group], statistics: Statistics, confidence: str, several: bool
) -> str | None:
    if ours.scheme != "dense2sparse":
        return None
    subject, rival = (Setting(ours.task, ours.misalignment_deg, scheme) for scheme in ("dense2sparse", "dense"))
    claim = Claim("finding", "dense2sparse above dense", "", "above", "return", subject, rival)
    of_setting = [g for g in groups if (g.name, g.misalignment_kind) == (ours.name, ours.misalignment_kind)]
    (judged,) = judge([claim], of_setting, {}, statistics)
    if judged.effect is None or judged.ours is None or judged.rival is None:
        return None
    where = f"{ours.task}, {misalignment(ours.misalignment_kind, ours.misalignment_deg)}"
    where += f" ({ours.name})" if several else ""
    said = f"{where}: dense2sparse ends at {figure(judged.ours.mean)}, dense at {figure(judged.rival.mean)}"
    said += f", {compared(judged.seeds, judged.effect, judged.low, judged.high, confidence)}"
    if judged.seeds > 1:
        said += f", {_SAID.get(judged.verdict, 'not shown to differ')}"
    return f"{said} ({judged.failed} failed: {judged.note})." if judged.failed else f"{said}."
