"""What a researcher puts together from public packages: robosuite's camera, a torch ResNet34, stable-baselines3's TD3.

The same sizes, spaces and update schedule as ours. The public packages' defaults are left as they are; only robosuite's
resets are soft, for a hard one recompiles the scene at every episode.
"""

import multiprocessing
import os
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.logger import configure
from stable_baselines3.common.noise import NormalActionNoise

from stages.perception.resnet34 import ResNet34
from stages.policy.config import TD3Config
from stages.policy.observation import observation_dim
from stages.sim.config import WorldConfig
from stages.sim.robosuite_scene import make_environment

OBSERVATION_DIM, ACTION_DIM = observation_dim("forward_kinematics"), 7
CAMERA = "agentview"


class _Spaces(gymnasium.Env[np.ndarray, np.ndarray]):
    """Observation and action of our reach task."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATION_DIM,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (ACTION_DIM,), np.float32)


class CameraReach(_Spaces):
    """robosuite's Lift seen by its camera: the cube's position is a ResNet34's, in float32 as torch computes it."""

    def __init__(self, config: WorldConfig, image_size: int) -> None:
        self._environment = make_environment(
            config,
            has_offscreen_renderer=True,
            use_camera_obs=True,
            camera_names=CAMERA,
            camera_heights=image_size,
            camera_widths=image_size,
        )
        self._network = ResNet34().eval()
        self._horizon, self._step = config.horizon, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start an episode."""
        super().reset(seed=seed)
        self._step = 0
        return self._observe(self._environment.reset()), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One control step with the gripper closed."""
        seen, reward, _, _ = self._environment.step(np.append(action, 1.0))
        self._step += 1
        return self._observe(seen), float(reward), False, self._step >= self._horizon, {}

    def _observe(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        picture = torch.from_numpy(seen[f"{CAMERA}_image"][::-1].copy()).permute(2, 0, 1)[None].float() / 255
        with torch.inference_mode():
            cube = self._network(picture)[0].numpy()
        eef, fingers = seen["robot0_eef_pos"], seen["robot0_gripper_qpos"]
        joints = seen["robot0_joint_pos"], seen["robot0_joint_vel"], [fingers[0] - fingers[1]]
        return np.concatenate([cube, *joints, eef, cube - eef], dtype=np.float32, casting="same_kind")


def make_td3(environment: gymnasium.Env, config: TD3Config, learning_starts: int = 100) -> TD3:
    """stable-baselines3's TD3 at our sizes, one update per environment step."""
    return TD3(
        "MlpPolicy",
        environment,
        learning_rate=config.learning_rate,
        buffer_size=100_000,
        learning_starts=learning_starts,
        batch_size=config.batch_size,
        tau=config.tau,
        gamma=config.gamma,
        train_freq=1,
        gradient_steps=1,
        policy_delay=config.policy_delay,
        target_policy_noise=config.target_noise,
        target_noise_clip=config.target_noise_clip,
        action_noise=NormalActionNoise(np.zeros(ACTION_DIM), config.exploration_noise * np.ones(ACTION_DIM)),
        policy_kwargs={"net_arch": list(config.hidden)},
        seed=0,
        device="cpu",
    )


class StockLoop:
    """The stock training loop in a process of its own, past its random start, without our settings of the machine."""

    def __init__(self, config: TD3Config, image_size: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, config, image_size), daemon=True)
        self._process.start()
        self._pipe.recv()  # ready

    @property
    def pid(self) -> int | None:
        """Of its process."""
        return self._process.pid

    def rate(self, steps: int) -> float:
        """Environment steps/s of as many steps of training."""
        self._pipe.send(steps)
        return self._pipe.recv()


def _serve(pipe: Connection, config: TD3Config, image_size: int) -> None:
    os.environ.pop("LP_NUM_THREADS", None)  # ours; users have the renderer's default
    model = make_td3(CameraReach(WorldConfig(), image_size), config, learning_starts=10)
    model.learn(20)
    pipe.send("ready")
    with suppress(EOFError):  # the parent is done
        while True:
            steps = pipe.recv()
            started = time.perf_counter()
            model.learn(steps, reset_num_timesteps=False)
            pipe.send(steps / (time.perf_counter() - started))


def filled_td3(config: TD3Config, transitions: int) -> TD3:
    """The same with random transitions in its replay buffer, ready for `train`."""
    model, rng = make_td3(_Spaces(), config), np.random.default_rng(0)
    model.set_logger(configure(None, []))
    assert model.replay_buffer is not None
    for _ in range(transitions):
        before, after = rng.standard_normal((2, 1, OBSERVATION_DIM), dtype=np.float32)
        action = rng.uniform(-1, 1, (1, ACTION_DIM)).astype(np.float32)
        model.replay_buffer.add(before, after, action, np.zeros(1), np.zeros(1), [{}])
    return model
