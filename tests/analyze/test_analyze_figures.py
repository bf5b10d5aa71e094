"""What the figures draw."""

import json
from typing import Any

import pytest

from stages.analyze.behind import Links
from stages.analyze.figures.policy import learning_curves

ROW: dict[str, Any] = {
    **{"name": "study", "task": "reach", "scheme": "dense", "misalignment_kind": "orbit", "misalignment_deg": 0.0},
    **{"after_episode": 20, "seeds": 2, "std": 10.0},
}


@pytest.mark.parametrize(("task", "mean"), [("reach", 30.0), ("reach", 900.0), ("lift", 1000.0)])
def test_curves_reach_as_far_as_the_data(task: str, mean: float) -> None:
    """Whatever the horizon: the band of ± one standard deviation is drawn whole, and the axis holds it."""
    figure = learning_curves(Links([]), task, [ROW | {"task": task, "mean": mean}], [], "")
    drawn = json.dumps(figure.panels[0].draw(False).to_dict())
    assert f'"domain": [0, {1.04 * (mean + 10.0)}]' in drawn
    assert f'"high": {mean + 10.0}' in drawn


def test_a_still_names_the_schemes_it_shows() -> None:
    """One legend for all panels, of the schemes in any of them, in the order of every table."""
    rows = [
        ROW | {"scheme": scheme, "misalignment_deg": degrees, "mean": 30.0}
        for scheme, degrees in [("dense", 0.0), ("oracle", 10.0), ("dense", 10.0)]
    ]
    figure = learning_curves(Links([]), "reach", rows, [], "")
    drawn = [layer for panel in figure.panels for layer in panel.draw(False).to_dict()["layer"]]
    assert [layer["encoding"]["color"]["legend"]["values"] for layer in drawn] == 4 * [["oracle", "dense"]]
