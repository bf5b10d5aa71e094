"""One environment step without camera: ours against stock robosuite, from the same state with the same actions."""

import time
from collections.abc import Callable
from statistics import median

import mujoco
import numpy as np

from benchmarks.measure import Rate, milliseconds, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from benchmarks.stock_world import StockWorld, largest_difference
from stages.sim.config import WorldConfig
from stages.sim.scene import build_scene
from stages.sim.state import unpack_state
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World

TOLERANCE = 1e-9  # of everything the future depends on, over an episode (SPEC §3)


def run(quick: bool) -> Outcome:
    """Rates, the largest difference of the trajectories, and the share of MuJoCo itself."""
    steps, rounds = (20, 2) if quick else (200, 15)
    config = WorldConfig()
    scene = build_scene(config)
    world, stock = World(scene, "reach"), StockWorld(config, "reach")
    start = sample_initial_state(scene, "reach", np.random.default_rng(0))
    actions = np.random.default_rng(1).uniform(-1, 1, (steps, world.action_dim))
    difference = largest_difference(world, stock, start, actions)

    contenders = {
        "ours": _rate(world.step, actions, lambda: world.reset(start)),
        "stock": _rate(stock.step, actions, lambda: stock.reset(start)),
        "bare mj_step": _rate(_physics(world), _states(world, start, actions)),
    }
    rates = side_by_side(contenders, rounds)
    step_ms, fraction = 1e3 / median(rates["ours"]), ratio(rates, "ours", "bare mj_step")
    bare, reading = fraction * step_ms, milliseconds(world.state, repetitions=1000)
    return Outcome(
        benchmark="step",
        compares="one environment step (50 ms of simulation) without camera, against stock robosuite",
        unit="environment step",
        targets=[
            Target("ours / stock", ratio(rates, "ours", "stock"), 4.0, "×"),
            Target("largest difference of the trajectories", difference, TOLERANCE, at_least=False),
        ],
        figures={"fraction of the limit": fraction},
        parts=[
            Part("physics (mj_step)", bare, bare),
            Part("control and calls", step_ms - bare - reading),
            Part("reading the state", reading),
        ],
        rounds=rates,
        notes=["limit: mj_step from the same states, with nothing between its 25 substeps"],
    )


def _states(world: World, start: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Integration states (n, k) that the actions are applied from."""
    world.reset(start)
    states = []
    for action in actions:
        states.append(world.integration_state())
        world.step(action)
    return np.array(states)


def _physics(world: World) -> Callable[[np.ndarray], None]:
    """One control step's physics from an integration state, the arm held against gravity as the control does."""
    scene, data = world.scene, mujoco.MjData(world.scene.model)

    def step(state: np.ndarray) -> None:
        unpack_state(scene.model, data, state)
        data.ctrl[scene.arm_actuators] = data.qfrc_bias[scene.arm_qvel]
        mujoco.mj_step(scene.model, data, scene.substeps)

    return step


def _rate(step: Callable[[np.ndarray], object], inputs: np.ndarray, prepare: Callable[[], object] = int) -> Rate:
    """Steps per second through the inputs (n, …); to prepare is not counted."""

    def measured() -> float:
        prepare()
        started = time.perf_counter()
        for row in inputs:
            step(row)
        return len(inputs) / (time.perf_counter() - started)

    return measured
