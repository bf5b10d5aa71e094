"""`pipeline relabel`."""

import click

from pipeline.commands.options import Place, place_options


@click.command(
    epilog="""\b
Example:
  pipeline relabel demo/reach-dense-orbit00-seed0 --scheme sparse
  pipeline relabel demo --scheme dense2sparse --switch-episode 20 --name early
  pipeline relabel demo/reach-dense-orbit00-seed0 --scheme dense --estimator better
"""
)
@place_options
@click.argument("runs", metavar="RUN...", nargs=-1, required=True)
@click.option("--scheme", type=click.Choice(["dense", "sparse", "oracle", "dense2sparse"]), required=True)
@click.option("--switch-episode", type=click.IntRange(min=0), help="Of dense2sparse.  [default: as in the run]")
@click.option("--estimator", metavar="NAME", help="Estimate again by this one, before the run's camera.")
@click.option("--name", help="Name of the result.  [default: the run's, and what is new]")
@click.option("--resume", is_flag=True, help="Go on with an interrupted one.")
def relabel(
    options: Place,
    runs: tuple[str, ...],
    scheme: str,
    switch_episode: int | None,
    estimator: str | None,
    name: str | None,
    resume: bool,
) -> None:
    """Give logged transitions the rewards of another scheme or estimator.

    Writes relabels/NAME/CELL-as-SCHEME for each RUN (NAME: all its complete cells): the same transitions with the
    rewards, and where the cube is seen otherwise the observations, that SCHEME would have given TD3. Ask them with
    `pipeline sql` (relabelled_transitions), learn from them with `pipeline train-policy --offline`.
    """
    from pipeline.artifacts.inputs import resolve
    from pipeline.artifacts.names import check_name
    from pipeline.commands.results import show_labels
    from pipeline.config import load_config
    from pipeline.steps import relabel as step
    from pipeline.steps.session import Session
    from pipeline.steps.sources import complete
    from schemas.errors import ConfigError

    if switch_episode is not None and scheme != "dense2sparse":
        raise ConfigError(f"--switch-episode: the scheme {scheme} has no switch")
    seen = resolve(options.data, estimator, ("estimators",)) if estimator is not None else None
    cells = complete(options.data, runs)
    session = Session(options.store, load_config(None, None, ()), options.progress, resume)
    wish = step.Wish(scheme, switch_episode, seen)
    show_labels(options, step.relabel(session, None if name is None else check_name(name), cells, wish))
