"""A policy that is no number, in the real world: its run ends as failed, its neighbour goes on, its end is replayed."""

import json
from pathlib import Path

import numpy as np
import pytest

from stages.policy.td3 import TD3
from tests.pipeline.fakes import Run, refused

TINY = {
    **{"policy.schemes": '["oracle"]', "policy.seeds": "[0, 1]", "policy.episodes": "2", "policy.warmup_episodes": "0"},
    **{"policy.eval_every": "100", "policy.final_episodes": "1", "world.horizon": "20", "policy.td3.hidden": "[16]"},
    **{"policy.td3.batch_size": "8", "policy.processes": "1", "policy.workers": "0"},
}
FAILED, WHOLE = (f"n/reach-oracle-orbit00-seed{seed}" for seed in (0, 1))
STEP = 27  # of all: the eighth of the second episode


@pytest.fixture
def trained(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs, of which the first one's policy breaks."""
    calls, act = [], TD3.act

    def breaking(self: TD3, observations: np.ndarray) -> np.ndarray:
        actions = act(self, observations)
        calls.append(actions)
        if len(calls) > STEP:
            actions[0] = np.nan
        return actions

    monkeypatch.setattr(TD3, "act", breaking)
    settings = [part for key, value in TINY.items() for part in ("--set", f"{key}={value}")]
    result = run("train-policy", "--name", "n", *settings)
    assert result.exit_code == 4 and "not a number in train episode 1, step 7" in result.stderr


@pytest.mark.usefixtures("trained")
def test_the_last_states_are_kept_and_replayed(run: Run, data: Path) -> None:
    status = {cell: json.loads((data / "runs" / cell / "manifest.json").read_text()) for cell in (FAILED, WHOLE)}
    assert [manifest["status"] for manifest in status.values()] == ["failed", "complete"]
    kept = {file["path"] for file in status[FAILED]["files"] if file["path"].startswith("failure/")}
    assert kept == {"failure/episodes.parquet", "failure/transitions/part-00000.parquet"}
    shown = json.loads(run("replay", FAILED, "--failure", "--json").stdout)
    assert (shown["identical"], shown["split"], shown["episode"], shown["steps"]) == (True, "train", 1, 8)
    refused(run("replay", WHOLE, "--failure"), 3, "did not fail in an episode")
    refused(run("replay", WHOLE), 2, "name an episode with --episode N")
    refused(run("replay", FAILED, "--failure", "--episode", "0"), 2, "name an episode with --episode N")


@pytest.mark.usefixtures("trained")
def test_the_episode_is_no_data_of_the_logs(run: Run) -> None:
    rows = json.loads(run("sql", f"SELECT DISTINCT episode FROM transitions WHERE run = '{FAILED}'", "--json").stdout)
    assert rows["rows"] == []  # nothing was due to be kept before, and the second episode never ends
    assert run("verify").exit_code == 0
