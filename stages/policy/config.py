"""Configuration of policy training (SPEC §5)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from schemas.config import Config, Device, Precision
from stages.sim.config import MisalignmentKind, TaskName, WorldConfig

Scheme = Literal["dense", "sparse", "oracle", "dense2sparse"]
Proprioception = Literal["joints", "forward_kinematics", "gripper_goal"]
Degrees = Annotated[float, Field(ge=0, le=90)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]


class TD3Config(Config):
    """Fujimoto et al. 2018, with the paper's discount."""

    gamma: Annotated[float, Field(ge=0, lt=1)] = 0.9
    """Discount; paper §III."""
    tau: Annotated[float, Field(gt=0, le=1)] = 0.005
    """Share of the online network in each soft update of the targets."""
    learning_rate: Annotated[float, Field(gt=0, le=1)] = 1e-3
    learning_rate_end: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Share of the learning rate that is left at the end; it falls linearly over the second half of the training
    episodes, so that the last policy is not one, lucky or not, of many that differ. 1: constant, as in TD3."""
    hidden: Annotated[tuple[Annotated[int, Field(ge=1, le=65_536)], ...], Field(min_length=1, max_length=64)] = (
        256,
        256,
    )
    batch_size: Annotated[int, Field(ge=1, le=1_000_000)] = 256
    policy_delay: Annotated[int, Field(ge=1)] = 2
    """Critic updates per actor and target update."""
    target_noise: Annotated[float, Field(ge=0, le=100)] = 0.2
    """Standard deviation of the noise on target actions."""
    target_noise_clip: Annotated[float, Field(ge=0)] = 0.5
    exploration_noise: Annotated[float, Field(ge=0, le=100)] = 0.2
    """Standard deviation of the Gaussian noise on training actions, of the normalised range."""
    exploration_correlation: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Of that noise with the one of the step before. 0: white, as TD3's. DDPG's Ornstein-Uhlenbeck process has 0.85
    (Lillicrap et al. 2016, θ = 0.15): joints that are pushed the same way for a while get somewhere."""
    preactivation_penalty: Annotated[float, Field(ge=0, le=1e6)] = 0.1
    """Weight in the actor's loss of its squared output before tanh, which it keeps from saturating (Andrychowicz et al.
    2017, hindsight experience replay, appendix A); 0: plain TD3."""
    behaviour_cloning: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """TD3+BC (Fujimoto & Gu 2021), for learning from logs alone: weight α of the value, scaled to a mean of 1, against
    staying close to the logged actions; theirs is 2.5. Observations are standardised, as theirs; the penalty above and
    the falling learning rate stay as they are set. None: plain TD3."""
    buffer_size: Annotated[int, Field(ge=1, le=1_000_000_000)] = 1_000_000
    """Transitions kept for replay, oldest dropped first."""
    precision: Precision = "bfloat16"
    """Arithmetic of the hidden layers in updates; float32 where a CPU does not multiply bfloat16."""


Size = Annotated[float, Field(ge=1e-6, le=1e6)]


class ObservationScale(Config):
    """Typical sizes, by which entries of the observation are divided on their way into the networks; 1: as they are.

    About as much as each differs while the gripper is near the cube. Lengths of centimetres beside angles of radians
    are seen late, for first layers are drawn as if all were of one size: in metres reaching is learnt half as fast
    (results/laptop/NOTES.md). Logs, saved policies and their observations stay in metres and radians. TD3+BC, which
    standardises observations by those of its logs, takes no notice.
    """

    cube: Size = 0.15
    """Cube position [m]."""
    qpos: Size = 1.0
    """Joint positions [rad]."""
    qvel: Size = 1.0
    """Joint velocities [rad/s]."""
    gripper_opening: Size = 0.03
    """[m]"""
    eef: Size = 0.2
    """Gripper point [m]."""
    cube_to_eef: Size = 0.05
    """Cube − gripper point [m]."""


IN_METRES = ObservationScale(cube=1, gripper_opening=1, eef=1, cube_to_eef=1)
"""How runs saw whose configuration is older than the sizes."""


class RunConfig(Config):
    """One run but for its identity: what every cell of a matrix shares."""

    episodes: Annotated[int, Field(ge=1, le=1_000_000)] = 300
    """Training episodes."""
    warmup_episodes: Annotated[int, Field(ge=0, le=1_000_000)] = 5
    """Episodes of uniformly random actions, without updates, before learning starts."""
    switch_episode: Annotated[int, Field(ge=0)] = 100
    """dense2sparse: first training episode under the sparse reward."""
    buffer: Literal["keep", "relabel", "empty"] = "keep"
    """dense2sparse: what becomes at the switch of the dense rewards in the replay buffer."""
    reset: Literal["none", "critics", "all"] = "none"
    """dense2sparse: which networks are drawn afresh at the switch."""
    reset_updates: Annotated[int, Field(ge=0, le=10_000_000)] = 0
    """Updates by which critics that are drawn afresh learn, from what the buffer holds, what the policy is worth,
    before it in turn learns from them: as drawn they lead it away from all that it has learnt. For reset = "critics"
    and a buffer that is not emptied."""
    updates_per_step: Annotated[int, Field(ge=0, le=1000)] = 1
    proprioception: Proprioception = "forward_kinematics"
    """joints: the paper's list; forward_kinematics adds gripper position and estimated cube-gripper vector;
    gripper_goal also where the gripper is going: a command moves its goal by a tenth of the way, and a gripper that
    holds something looks the same until half of them have opened it."""
    observation_scale: ObservationScale = ObservationScale()
    oracle_sees: Literal["truth", "estimate"] = "truth"
    """oracle: the cube position it observes; truth: the paper's. With estimate its reward alone is true: what a policy
    that acts on estimates could learn, were nothing wrong with its reward."""
    eval_every: Annotated[int, Field(ge=1)] = 20
    """Training episodes between evaluations."""
    eval_episodes: Annotated[int, Field(ge=1, le=1_000_000)] = 5
    final_episodes: Annotated[int, Field(ge=0, le=1_000_000)] = 200
    """Fresh episodes of the final evaluation."""
    checkpoint_every: Annotated[int, Field(ge=1)] = 10
    """Training episodes between checkpoints (`--resume` continues from the last) and log parts."""
    record_every: Annotated[int, Field(ge=0)] = 0
    """Every n-th episode of each split is recorded to MCAP with the frames the policy saw; 0: none, for any episode's
    frames are rendered again by a replay."""
    log_updates_every: Annotated[int, Field(ge=1)] = 100
    td3: TD3Config = TD3Config()

    @model_validator(mode="after")
    def _check_catching_up(self) -> "RunConfig":
        if self.reset_updates and (self.reset != "critics" or self.buffer == "empty"):
            raise ValueError(
                f"reset_updates = {self.reset_updates} is for new critics that learn from an old buffer: it takes "
                f'reset = "critics" (is "{self.reset}") and buffer = "keep" or "relabel" (is "{self.buffer}")'
            )
        return self


SECTIONS = ("td3", "observation_scale")
"""Keys of a run's configuration that have keys of their own: a task overrides these one by one."""


class MatrixConfig(RunConfig):
    """A matrix of runs: tasks × schemes × misalignments × seeds."""

    tasks: Annotated[tuple[TaskName, ...], Field(min_length=1)] = ("reach",)
    schemes: Annotated[tuple[Scheme, ...], Field(min_length=1)] = ("dense", "sparse", "oracle", "dense2sparse")
    misalignment_kind: MisalignmentKind = "orbit"
    """Default: the kind whose effect on the estimate is closer to what the paper describes (pan's is 6 to 9 cm)."""
    misalignment_degrees: Annotated[tuple[Degrees, ...], Field(min_length=1)] = (0.0,)
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    device: Device = "cpu"
    processes: Annotated[int, Field(ge=1, le=256)] | None = None
    """Processes that train a part of the runs each. Default: one per core, or one with a GPU."""
    workers: Annotated[int, Field(ge=0, le=256)] | None = None
    """Processes that simulate and render for each of them; 0: none. Default: the cores that are left."""
    threads: Annotated[int, Field(ge=1, le=256)] | None = None
    """CPU threads of each one's networks. Default: its share of the cores. The logs depend on none of the three
    (layers of fewer than 16 units: but for the last digit)."""
    reach: dict[str, Any] = Field(default={})
    """Keys of this section that differ for reach."""
    lift: dict[str, Any] = Field(default={})
    """Keys of this section that differ for lift."""

    @model_validator(mode="after")
    def _check_overrides(self) -> "MatrixConfig":
        if self.reach:
            self.for_task("reach")
        if self.lift:
            self.for_task("lift")
        return self

    def for_task(self, task: TaskName) -> "MatrixConfig":
        """This matrix for one task, its overrides applied."""
        overrides = getattr(self, task)
        base = self.model_dump(exclude={"reach", "lift"})
        merged = {key: base[key] | overrides.get(key, {}) for key in SECTIONS}
        return MatrixConfig.model_validate({**base, **overrides, **merged, "tasks": (task,)})


def acts_on_truth(scheme: Scheme, config: RunConfig) -> bool:
    """Whether the policy observes the cube's true position, not an estimate."""
    return scheme == "oracle" and config.oracle_sees == "truth"


@dataclass(frozen=True)
class RunSpec:
    """One cell of a matrix: what to train, and where its logs go."""

    run_id: str  # NAME/CELL
    task: TaskName
    scheme: Scheme
    misalignment_kind: MisalignmentKind
    misalignment_deg: float
    seed: int
    world: WorldConfig
    config: RunConfig
    out: Path
    sources: tuple[Path, ...] = ()
    """Directories of logged transitions to learn from alone; none: from its own steps in the world."""

    @property
    def identity(self) -> dict[str, Any]:
        """What every row of its log says of it."""
        names = ("task", "scheme", "misalignment_kind", "misalignment_deg", "seed")
        return {"run": self.run_id} | {name: getattr(self, name) for name in names}

    @property
    def acts_on_truth(self) -> bool:
        """It observes the cube's true position: no estimator is needed to train it."""
        return acts_on_truth(self.scheme, self.config)


@dataclass(frozen=True)
class RunResult:
    """How a run ended."""

    run_id: str
    status: Literal["complete", "failed"]
    summary: dict[str, Any]
    error: str | None = None
