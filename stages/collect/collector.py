"""One process's means of making episodes: scene, worlds, renderer and actor, each built when first needed."""

from functools import cached_property
from pathlib import Path

from schemas.errors import ArtifactError, DivergedError
from stages.collect.behaviours import Actor, ActorFactory, make_behaviour
from stages.collect.config import CollectStageConfig
from stages.collect.failure import keep_failure
from stages.collect.frames import EpisodeResult, read_episode
from stages.collect.plan import EpisodePlan, Stream
from stages.collect.recorder import Recorder, config_sha256
from stages.collect.scripts import Manner
from stages.collect.simulate import UnstableError, simulate
from stages.sim.camera import CameraPose, displaced, nominal_pose
from stages.sim.postures import sample_posture
from stages.sim.renderer import Renderer
from stages.sim.scene import Scene, build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World


class Collector:
    """Makes planned episodes, leaving alone those that are whole already."""

    def __init__(
        self, config: CollectStageConfig, out: Path, dataset: str, actor_factory: ActorFactory | None = None
    ) -> None:
        self._config, self._out, self._dataset = config, out, dataset
        self._actor_factory = actor_factory
        self._config_sha256 = config_sha256(config)
        self._worlds: dict[str, World] = {}

    def collect(self, plan: EpisodePlan) -> EpisodeResult:
        """The episode's result, from its file when that is whole and of this configuration, else after running it.

        Raises:
            DivergedError: unstable simulation; what led to it is kept in failure/.
            MachineError: no OpenGL.
            OSError: the disk is full, or read-only.
        """
        path = self._out / plan.file
        if path.exists():
            try:
                return self._read(path, plan)
            except ArtifactError:  # left damaged by an interruption: make it again
                path.unlink()
        self._make(path, plan)
        return self._read(path, plan)

    def close(self) -> None:
        """Free the OpenGL context."""
        if "_renderer" in self.__dict__:
            self._renderer.close()

    def _read(self, path: Path, plan: EpisodePlan) -> EpisodeResult:
        return read_episode(path, plan, self._dataset, self._config_sha256)

    def _make(self, path: Path, plan: EpisodePlan) -> None:
        collect, world = self._config.collect, self._world(plan.task)
        half_range = plan.spread * self._config.world.cube_half_range
        posture = sample_posture(self._scene, plan.rng(Stream.POSTURE)) if plan.leaning else None
        start_rng = plan.rng(Stream.INITIAL_STATE)
        initial_state = sample_initial_state(self._scene, plan.task, start_rng, half_range, posture)
        manner = Manner(half_range, posture)
        behaviour = make_behaviour(plan.behaviour, collect.action_noise, manner, plan.rng(Stream.ACTION), self._actor)
        try:
            episode = simulate(world, plan, initial_state, behaviour, collect.steps)
        except UnstableError as error:
            kept = keep_failure(self._out, plan, initial_state, error.actions)
            raise DivergedError(f"{error}; what led to it is kept in {kept}") from error  # it crosses processes
        self._recorder.record(path, plan, episode, self._camera_of(plan))

    def _camera_of(self, plan: EpisodePlan) -> CameraPose:
        """The nominal camera, displaced a little in each episode: domain randomisation (paper §IV)."""
        collect = self._config.collect
        nominal, rng = nominal_pose(self._config.camera), plan.rng(Stream.CAMERA)
        return displaced(nominal, rng, collect.camera_translation, collect.camera_rotation)

    def _world(self, task: str) -> World:
        """One world for all episodes of a task: resetting leaves nothing of the episode before."""
        if task not in self._worlds:
            self._worlds[task] = World(self._scene, task)
        return self._worlds[task]

    @cached_property
    def _scene(self) -> Scene:
        return build_scene(self._config.world)

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self._scene, self._config.camera.image_size, self._config.camera.fovy)

    @cached_property
    def _recorder(self) -> Recorder:
        return Recorder(self._config, self._renderer, self._scene.joint_names)

    @cached_property
    def _actor(self) -> Actor | None:
        return self._actor_factory() if self._actor_factory else None
