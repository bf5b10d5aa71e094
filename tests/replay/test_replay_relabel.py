"""New labels of logged transitions: what changes is what the scheme, or the estimator, changes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.arrays import constant
from schemas.errors import ArtifactError, ConfigError
from schemas.files import write_parquet
from schemas.manifest import read_manifest
from schemas.progress import Silent
from stages.replay.reestimate import Eye
from stages.replay.relabel import Labels, check_possible, relabel
from tests.replay.tiny_run import edit_manifest

TRUTH = ("cube_true_x", "cube_true_y", "cube_true_z")


def with_cube(observations: np.ndarray, cubes: np.ndarray) -> np.ndarray:
    changed = observations.copy()
    changed[:, :3] = cubes
    return changed


def labelled(run_dir: Path, out: Path, scheme: str, eye: Eye | None = None, switch: int = 0) -> dict[str, np.ndarray]:
    config = read_manifest(run_dir).config
    config = config | {
        "run": config["run"] | {"scheme": scheme},
        "policy": {"switch_episode": switch, "warmup_episodes": 0},
    }
    out.mkdir(exist_ok=True)
    relabel(run_dir, Labels(f"new/{scheme}", config, with_cube, eye), out, Silent())
    return rows(out)


def rows(run: Path) -> dict[str, np.ndarray]:
    table = pa.concat_tables(map(pq.read_table, sorted((run / "transitions").glob("*.parquet"))))
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


def test_sparse_labels(run_dir: Path, tmp_path: Path) -> None:
    before, after = rows(run_dir), labelled(run_dir, tmp_path / "x", "sparse")
    assert np.array_equal(after["reward_used"], before["reward_sparse"])
    assert set(after["scheme"]) == {"sparse"} and set(after["run"]) == {"new/sparse"}
    same = [name for name in before if name not in ("run", "scheme", "phase", "reward_used")]
    for name in same:
        np.testing.assert_array_equal(after[name], before[name], err_msg=name)
    schema = pq.read_schema(next((run_dir / "transitions").glob("*.parquet")))
    assert pq.read_schema(next((tmp_path / "x" / "transitions").glob("*.parquet"))) == schema


def test_the_switch_divides_dense2sparse(run_dir: Path, tmp_path: Path) -> None:
    before = rows(run_dir)
    early, late = (labelled(run_dir, tmp_path / f"{n}", "dense2sparse", switch=n) for n in (0, 5))
    assert np.array_equal(early["reward_used"], before["reward_sparse"]) and set(early["phase"]) == {"sparse"}
    assert np.array_equal(late["reward_used"], before["reward_dense_est"]) and set(late["phase"]) == {"dense"}


def test_an_oracle_sees_the_truth_from_the_first_state_on(run_dir: Path, tmp_path: Path) -> None:
    after = labelled(run_dir, tmp_path / "x", "oracle")
    truth = np.stack([after[name] for name in TRUTH], axis=1)
    assert np.array_equal(after["reward_used"], after["reward_dense_true"])
    np.testing.assert_allclose(after["next_observation"][:, :3], truth, atol=1e-7)
    inner = after["step"] > 0
    np.testing.assert_allclose(after["observation"][inner, :3], truth[np.flatnonzero(inner) - 1], atol=1e-7)
    first = after["observation"][after["step"] == 0, :3]
    np.testing.assert_allclose(first, truth[after["step"] == 0], atol=0.002)  # the cube hardly moves in one step


def test_another_estimator_looks_again_and_sums_follow(run_dir: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, ...]] = []

    def predict(frames: np.ndarray) -> np.ndarray:
        seen.append(frames.shape)
        return np.tile([0.1, 0.2, 0.9], (len(frames), 1))

    after = labelled(run_dir, tmp_path / "x", "dense", Eye("other", 48, predict))
    assert seen == [(21, 48, 48, 3)] * 2  # the initial state too: the first observation holds an estimate
    assert np.allclose(after["observation"][:, :3], [0.1, 0.2, 0.9])
    assert np.allclose(after["cube_est_y"], 0.2)
    assert np.array_equal(after["reward_used"], after["reward_dense_est"])
    episodes = pq.read_table(tmp_path / "x" / "episodes.parquet").to_pylist()
    for row in episodes:
        mine = after["episode"] == row["episode"]
        assert row["return_used"] == pytest.approx(after["reward_used"][mine].sum(), rel=1e-5)
        assert row["mean_estimation_error"] == pytest.approx(after["estimation_error"][mine].mean(), rel=1e-5)
        assert row["scheme"] == "dense"


def test_finished_parts_are_not_made_again(run_dir: Path, tmp_path: Path) -> None:
    labelled(run_dir, tmp_path / "x", "sparse")
    part = tmp_path / "x" / "transitions" / "part-00000.parquet"
    before, changed = part.stat().st_mtime_ns, (tmp_path / "x" / "transitions" / "part-00001.parquet")
    changed.unlink()
    labelled(run_dir, tmp_path / "x", "sparse")
    assert part.stat().st_mtime_ns == before and changed.exists()


def flip_an_action(part: Path) -> None:
    chunk = pq.read_metadata(part).row_group(0)
    [action] = [c for c in map(chunk.column, range(chunk.num_columns)) if c.path_in_schema.startswith("action")]
    data = bytearray(part.read_bytes())
    data[action.data_page_offset + action.total_compressed_size - 20] ^= 1
    part.write_bytes(data)


def cut(part: Path) -> None:
    part.write_bytes(part.read_bytes()[:100])


def swap_with_the_next(part: Path) -> None:
    part.write_bytes(part.with_name("part-00001.parquet").read_bytes())


def other_labels(part: Path) -> None:
    table = pq.read_table(part, partitioning=None)
    write_parquet(table.set_column(0, table.schema.field(0), constant(table.schema.types[0], "x", len(table))), part)


@pytest.mark.parametrize("damage", [flip_an_action, cut, swap_with_the_next, other_labels])
def test_parts_that_are_not_what_was_written_are_made_again(
    run_dir: Path, tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    labelled(run_dir, tmp_path / "x", "sparse")
    part = tmp_path / "x" / "transitions" / "part-00000.parquet"
    whole = part.read_bytes()
    damage(part)
    assert part.read_bytes() != whole
    labelled(run_dir, tmp_path / "x", "sparse")
    assert part.read_bytes() == whole


def test_what_was_never_seen_cannot_be_labelled(fresh_run: Any) -> None:
    run_dir = fresh_run()
    config = read_manifest(run_dir).config
    edit_manifest(run_dir, config=config | {"run": config["run"] | {"scheme": "oracle"}})
    manifest = read_manifest(run_dir)
    check_possible(manifest, "oracle", estimated_again=False)
    check_possible(manifest, "dense", estimated_again=True)
    with pytest.raises(ConfigError, match="saw the true state and sparse sees estimates: name with --estimator"):
        check_possible(manifest, "sparse", estimated_again=False)
    edit_manifest(run_dir, config=manifest.config | {"policy": manifest.config["policy"] | {"oracle_sees": "estimate"}})
    check_possible(read_manifest(run_dir), "sparse", estimated_again=False)


def test_a_run_without_transitions(fresh_run: Any, tmp_path: Path) -> None:
    run_dir = fresh_run()
    for part in (run_dir / "transitions").glob("*.parquet"):
        part.unlink()
    with pytest.raises(ArtifactError, match="nothing to label"):
        labelled(run_dir, tmp_path / "x", "sparse")
