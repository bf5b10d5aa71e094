"""Options that commands share."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from pipeline.artifacts.store import Store
    from pipeline.config import PipelineConfig
    from schemas.progress import Progress

Command = TypeVar("Command", bound=Callable[..., Any])


def _root(_context: click.Context, _parameter: click.Parameter, path: Path) -> Path:
    """The data root, if it is a directory or can become one."""
    try:
        there = next(each for each in (path, *path.parents) if each.exists() or each.is_symlink())
    except OSError as error:
        raise click.BadParameter(f"{path} can be no directory ({error.strerror})") from error
    if not there.is_dir():
        raise click.BadParameter(f"{path} can be no directory: {there} is none")
    return path


DATA = click.option(
    "--data",
    type=click.Path(file_okay=False, path_type=Path),
    default="data",
    envvar="PIPELINE_DATA",
    callback=_root,
    show_default=True,
    show_envvar=True,
    help="Data root: where artifacts are read and written.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
QUIET = click.option("--quiet", is_flag=True, help="No progress, no summary.")
EVIDENCE = click.option(
    "--evidence",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Copy the report's tables, figures and README to DIR, to be kept outside the data root.",
)
ACCUMULATE = click.option(
    "--accumulate",
    is_flag=True,
    help="With --evidence: keep what DIR says of runs whose logs are not here.",
)
DEBUG = click.option("--debug", is_flag=True, help="Show a traceback when something goes wrong.")

STAGE = [
    click.option("--config", "config_file", type=click.Path(path_type=Path), help="TOML file with sections [world] …"),
    click.option("--profile", metavar="demo|laptop|paper", help="Configuration that comes with the package."),
    click.option(
        "--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Change one value; repeatable."
    ),
    click.option("--name", help="Name of the artifact.  [default: the profile, else 'default']"),
    click.option("--dry-run", is_flag=True, help="Print the resolved config and the plan; do nothing."),
    click.option("--resume", is_flag=True, help="Go on from the last checkpoint of an interrupted artifact."),
]


@dataclass(frozen=True)
class Place:
    """Where artifacts are and how to talk about them."""

    data: Path
    as_json: bool
    quiet: bool

    @property
    def store(self) -> "Store":
        """The artifacts."""
        from pipeline.artifacts.store import Store

        return Store(self.data)

    @property
    def progress(self) -> "Progress":
        """Bars on stderr, or none."""
        from pipeline.progress import make_progress

        return make_progress(self.quiet)


@dataclass(frozen=True)
class StageOptions(Place):
    """What every stage command is given."""

    config_file: Path | None
    profile: str | None
    overrides: tuple[str, ...]
    name: str | None
    dry_run: bool
    resume: bool

    @property
    def config(self) -> "PipelineConfig":
        """The resolved configuration; ConfigError when it is wrong."""
        from pipeline.config import load_config

        return load_config(self.profile, self.config_file, self.overrides)

    @property
    def artifact_name(self) -> str:
        """`--name`, else the profile's, else `default`; ConfigError when it cannot be a name."""
        from pipeline.artifacts.names import check_name

        return check_name(self.profile or "default" if self.name is None else self.name)


def stage_options(command: Command) -> Command:
    """Give a stage command the common options, as one `StageOptions`."""
    return _collected(command, StageOptions, [*STAGE, DATA, JSON, QUIET, DEBUG])


def place_options(command: Command) -> Command:
    """Give a reading command `--data`, `--json`, `--quiet` and `--debug`, as one `Place`."""
    return _collected(command, Place, [DATA, JSON, QUIET, DEBUG])


def _collected(command: Command, kind: type[Place], options: list[Callable[[Any], Any]]) -> Command:
    @wraps(command)
    def call(**given: Any) -> Any:
        given.pop("debug")  # read where failures are reported
        common = {name: given.pop(name) for name in kind.__dataclass_fields__}
        return command(kind(**common), **given)

    decorated: Any = call
    for option in reversed(options):
        decorated = option(decorated)
    return decorated
