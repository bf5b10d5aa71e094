"""Logged transitions that a step learns from or labels anew: complete runs, or complete new labels of runs."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.artifacts.inputs import load
from pipeline.artifacts.names import existing_ids
from schemas.errors import ArtifactError


def complete(root: Path, texts: Sequence[str], kinds: Sequence[str] = ("runs",)) -> list[str]:
    """Ids that the texts mean: NAME (its complete cells) or NAME/CELL, of runs unless KIND/ stands before it.

    Raises:
        ArtifactError: nothing of that name is there, or none of its cells is complete.
    """
    return list(dict.fromkeys(each for text in texts for each in _meant(root, text.strip("/"), kinds)))


def _meant(root: Path, text: str, kinds: Sequence[str]) -> list[str]:
    kind = next((kind for kind in kinds if text.startswith(f"{kind}/")), kinds[0])
    wanted, there = f"{kind}/{text.removeprefix(f'{kind}/')}", existing_ids(root, kind)
    if wanted in there:
        return [wanted]  # whoever loads it says what is wrong with one that is not complete
    cells = [each for each in there if each.startswith(f"{wanted}/")]
    if not cells:
        names = ", ".join(sorted({each.rpartition("/")[0] for each in there})) or f"no {kind}"
        raise ArtifactError(f"no {wanted} under {root}; there: {names}")
    found = [each for each in cells if load(root, each).status == "complete"]
    if not found:
        raise ArtifactError(f"none of the {len(cells)} cells of {wanted} is complete")
    return found
