"""relabel → relabels/NAME/CELL, the new labels of one run each."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artifacts.inputs import input_ref, load, load_complete
from pipeline.artifacts.space import require_space
from pipeline.artifacts.store import Build, Request
from pipeline.machine import require_sim
from pipeline.steps.session import Outcome, Session, make

if TYPE_CHECKING:
    from stages.replay.reestimate import Eye


@dataclass(frozen=True)
class Wish:
    """The labels asked for."""

    scheme: str
    switch_episode: int | None  # None: as in the run
    estimator: str | None  # id; None: the estimates stay


def default_name(run: str, wish: Wish) -> str:
    """NAME of the result: of the run, and what is new."""
    switch = "" if wish.switch_episode is None else f"-switch{wish.switch_episode}"
    by = f"-{wish.estimator.split('/')[1]}" if wish.estimator else ""
    return f"{run.split('/')[1]}-{wish.scheme}{switch}{by}"


def request(session: Session, name: str, run: str, wish: Wish) -> Request:
    """The labels of one run as an artifact; the run and the estimator verified and pinned."""
    ids = [run, *([wish.estimator] if wish.estimator else [])]
    for each in ids:
        load_complete(session.root, each)
    was = load(session.root, run).config
    policy = was["policy"] | ({} if wish.switch_episode is None else {"switch_episode": wish.switch_episode})
    identity = was["run"] | {"scheme": wish.scheme}
    config = {
        "source": run.removeprefix("runs/"),
        "world": was["world"],
        "policy": policy,
        "run": identity,
        "estimator": wish.estimator.removeprefix("estimators/") if wish.estimator else was["estimator"],
    }
    cell = f"{run.split('/')[2]}-as-{wish.scheme}"  # runs that differ in the scheme alone stay apart
    return Request(f"relabels/{name}/{cell}", config, [input_ref(session.root, each) for each in ids])


def relabel(session: Session, name: str | None, runs: Sequence[str], wish: Wish) -> list[Outcome]:
    """Label runs anew, one after the other, none of them if one would be refused."""
    require_sim()
    from stages.replay.relabel import check_possible

    asked = [(run, request(session, name or default_name(run, wish), run, wish)) for run in runs]
    for run, each in asked:
        session.store.existing(each, session.resume)
        check_possible(load(session.root, run), wish.scheme, wish.estimator is not None)
    return [_relabel(session, run, each, wish) for run, each in asked]


def _relabel(session: Session, run: str, asked: Request, wish: Wish) -> Outcome:
    def stage(build: Build) -> dict[str, Any]:
        from stages.policy.observation import with_cube
        from stages.replay.relabel import Labels, relabel

        if not build.resumed:
            require_space(session.root, _bytes(session.store.path(run)))
        labels = Labels(asked.id.removeprefix("relabels/"), asked.config, with_cube, _eye(session, wish.estimator))
        return relabel(session.store.path(run), labels, build.path, session.progress)

    return make(session, asked, stage, renders=wish.estimator is not None)


def _bytes(run: Path) -> int:
    """The logs with other labels are about as large."""
    return sum(path.stat().st_size for path in run.rglob("*.parquet"))


def _eye(session: Session, estimator: str | None) -> "Eye | None":
    return load_eye(session.store.path(estimator)) if estimator else None


def load_eye(directory: Path) -> "Eye":
    """An estimator as a replay looks through it; the replay room does not know perception."""
    from stages.perception.estimator import Estimator
    from stages.replay.reestimate import Eye

    loaded = Estimator.load(directory)
    return Eye(directory.name, loaded.image_size, loaded.predict, loaded.camera)
