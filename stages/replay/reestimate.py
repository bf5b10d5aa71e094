"""What an episode would have been worth to another estimator, or from another camera: its estimates made again.

The trajectory stays the logged one, open loop: the policy does not act on the new estimates.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from stages.policy import rewards
from stages.replay import relabelling
from stages.replay.logs import LoggedEpisode

Predict = Callable[[np.ndarray], np.ndarray]
"""Images (n, H, W, 3) uint8 → positions of the cube (n, 3) [m]; injected, for it is another room's."""


@dataclass(frozen=True)
class Eye:
    """An estimator that looks at a replay."""

    name: str
    image_size: int  # [pixels]
    predict: Predict
    camera: Mapping[str, Any] = field(default_factory=dict)
    """Its nominal camera (CameraConfig), from which it looks at a run that had none."""


@dataclass(frozen=True)
class WhatIf:
    """Logged against estimated again; None where nothing was estimated when it was logged."""

    estimated_by: str  # and from where
    error_logged: float | None  # mean distance between estimated and true cube [m]
    error: float
    return_dense_true: float
    return_dense_est_logged: float | None
    return_dense_est: float
    moved: float | None  # largest distance between the two estimates of one step [m]

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)

    def message(self) -> str:
        """A few lines for a person."""
        before = "" if self.error_logged is None else f" (logged: {100 * self.error_logged:.2f} cm)"
        worth = "" if self.return_dense_est_logged is None else f" (logged: {self.return_dense_est_logged:.1f})"
        return "\n".join(
            [
                f"estimated again by {self.estimated_by}:",
                f"  mean error {100 * self.error:.2f} cm{before}",
                f"  return, dense from the estimate {self.return_dense_est:.1f}{worth}; "
                f"from the truth {self.return_dense_true:.1f}",
            ]
        )


def reestimate(logged: LoggedEpisode, estimate: np.ndarray, by: str) -> LoggedEpisode:
    """The episode with other estimates, and everything that follows from them.

    Args:
        logged: the episode.
        estimate: position of the cube after each action (n, 3) [m].
        by: who estimated, and from where, in words.
    """
    distance = np.linalg.norm(logged.vector("eef") - estimate, axis=1)
    changed = {
        **{f"cube_est_{axis}": estimate[:, column] for column, axis in enumerate("xyz")},
        "distance_est": distance,
        "estimation_error": np.linalg.norm(estimate - logged.vector("cube_true"), axis=1),
        "reward_dense_est": rewards.dense(logged.task, distance, logged.rows["grasped"], logged.rows["lifted"]),
    }
    rows = logged.rows | {name: values.astype(np.float32) for name, values in changed.items()}
    rows["reward_used"] = relabelling.used(logged.manifest.config, rows)
    returns = {f"return_{term}": float(rows[f"reward_{term}"].sum()) for term in ("dense_est", "used")}
    return replace(logged, rows=rows, summary=logged.summary | returns, reestimated=by)


def what_if(logged: LoggedEpisode, again: LoggedEpisode) -> WhatIf:
    """An episode and the same estimated again, in figures."""
    before, after = logged.vector("cube_est"), again.vector("cube_est")
    known = not np.isnan(before).all()
    return WhatIf(
        estimated_by=again.reestimated or "",
        error_logged=float(np.nanmean(logged.rows["estimation_error"])) if known else None,
        error=float(again.rows["estimation_error"].mean()),
        return_dense_true=float(logged.summary["return_dense_true"]),
        return_dense_est_logged=float(np.nansum(logged.rows["reward_dense_est"])) if known else None,
        return_dense_est=float(again.rows["reward_dense_est"].sum()),
        moved=float(np.linalg.norm(after - before, axis=1).max()) if known else None,
    )
