"""A data root as the stages would write it: the paper's matrix, and studies beside it."""

from pathlib import Path

from stages.analyze.studies import Study
from tests.analyze.fake_artifacts import write_dataset, write_estimator
from tests.analyze.fake_runs import write_run


def write_switch_study(root: Path, seeds: int = 3, estimator: Path | None = None) -> Study:
    """What the switch is for, beside the main runs `study`: when to switch, and what becomes of the buffer."""
    for episode, reward in ((25, 150.0), (150, 168.0)):
        for seed in range(seeds):
            outcome, settings = (reward + seed, 1.0), {"policy.switch_episode": episode, "policy.final_episodes": 50}
            name = f"study-switch-{episode}"
            write_run(root, name, degrees=10.0, seed=seed, outcome=outcome, settings=settings, estimator=estimator)
    names = ("study-switch-25", "study-switch-150")
    return Study("switch", "When should the reward switch?", ("policy.switch_episode",), names, "study")


def write_buffer_study(root: Path, seeds: int = 3, estimator: Path | None = None) -> Study:
    """What becomes of buffer and networks at the switch; the first of its variants is better than the main runs."""
    keys, variants = ("policy.buffer", "policy.reset"), {("relabel", "critics"): 190.0, ("empty", "none"): 120.0}
    for values, reward in variants.items():
        for seed in range(seeds):
            name, settings = f"study-buffer-{'-'.join(values)}", dict(zip(keys, values, strict=True))
            outcome = (reward + seed, 1.0)
            write_run(root, name, degrees=10.0, seed=seed, outcome=outcome, settings=settings, estimator=estimator)
    names = tuple(f"study-buffer-{'-'.join(values)}" for values in variants)
    return Study("buffer", "What becomes of the old dense rewards?", keys, names, "study")


def write_paper_study(root: Path, seeds: int = 3, logged_steps: int = 400, final_steps: int = 2) -> None:
    """The paper's matrix: reach at 0°, 5° and 10°, lift at 0°, four schemes; one run failed, one still runs."""
    estimator = write_estimator(root, dataset=write_dataset(root))
    settings = [("reach", 0.0), ("reach", 5.0), ("reach", 10.0), ("lift", 0.0)]
    for task, degrees in settings:
        for scheme in ("oracle", "dense2sparse", "dense", "sparse"):
            for seed in range(seeds):
                steps = {"logged_steps": logged_steps, "final_steps": final_steps}
                write_run(root, "study", task, scheme, "orbit", degrees, seed, estimator=estimator, **steps)
    write_run(root, "study", "reach", "sparse", "orbit", 10.0, seeds, status="failed", final=False, episodes=60)
    write_run(
        root, "study", "lift", "dense2sparse", "orbit", 0.0, seeds, status="running", final=False, estimator=estimator
    )
