"""The command line: `pipeline COMMAND`. Commands are imported when called (`pipeline.commands`)."""

import click

from pipeline import __version__, interrupts
from pipeline.lazy import LazyCommand, LazyGroup

COMMANDS = {
    "collect": LazyCommand("pipeline.commands.collect:collect", "Run the robot, render the fixed camera, write MCAP."),
    "train-perception": LazyCommand(
        "pipeline.commands.train_perception:train_perception", "Train the ResNet34 position estimator on a dataset."
    ),
    "train-policy": LazyCommand(
        "pipeline.commands.train_policy:train_policy", "Train a run or a matrix of runs, logging every transition."
    ),
    "analyze": LazyCommand(
        "pipeline.commands.analyze:analyze", "Query the logs; write an HTML report, figures and recordings."
    ),
    "run": LazyCommand("pipeline.commands.run:run", "All four stages of a profile, doing only what is missing."),
    "sql": LazyCommand("pipeline.commands.sql:sql", "Ask SQL over all logs."),
    "compare": LazyCommand(
        "pipeline.commands.compare:compare",
        "Compare runs: where they ended, how sure a difference is, in which settings they differ.",
    ),
    "view": LazyCommand("pipeline.commands.view:view", "Open an artifact in the Rerun viewer, or save it for later."),
    "replay": LazyCommand("pipeline.commands.replay:replay", "Re-simulate a logged episode and prove it identical."),
    "relabel": LazyCommand(
        "pipeline.commands.relabel:relabel", "Give logged transitions the rewards of another scheme or estimator."
    ),
    "export": LazyCommand(
        "pipeline.commands.export:export", "Write a run or a dataset in the format of LeRobot, robomimic or Minari."
    ),
    "list": LazyCommand("pipeline.commands.list:list_artifacts", "List the artifacts that are there."),
    "show": LazyCommand("pipeline.commands.show:show", "Show one artifact with its lineage back to the first input."),
    "verify": LazyCommand("pipeline.commands.verify:verify", "Check that artifacts are what was written."),
    "repair": LazyCommand("pipeline.commands.repair:repair", "Keep what is whole of a damaged artifact or MCAP file."),
    "doctor": LazyCommand("pipeline.commands.doctor:doctor", "Check GL, GPU, disk and versions; say what to install."),
}

EPILOG = """\b
Example:
  pipeline run demo
  pipeline sql "SELECT scheme, avg(success::INT) FROM episodes GROUP BY scheme"

Exit codes: 0 done; 2 wrong usage or config; 3 an input artifact is missing or damaged; 4 this machine cannot do it;
130 interrupted.
"""


@click.group(
    cls=LazyGroup,
    lazy=COMMANDS,
    epilog=EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
@click.version_option(__version__, prog_name="pipeline")
def cli() -> None:
    """Dense2Sparse: from camera frames to policies, every step of it on disk.

    collect → train-perception → train-policy → analyze; each stage reads the artifacts of the ones before it.
    """


def main() -> None:
    """Entry point of the console script."""
    interrupts.install()
    cli.main()
