"""A frame of the fixed camera: ours against robosuite's offscreen renderer, same states, same camera poses."""

from collections.abc import Callable
from functools import partial
from statistics import mean, median

import mujoco
import numpy as np

from benchmarks import roofline
from benchmarks.measure import Stopwatch, milliseconds, rate_of, ratio, side_by_side
from benchmarks.outcome import Outcome, Part, Target
from stages.sim.camera import CameraPose, misaligned, nominal_pose
from stages.sim.config import CameraConfig, WorldConfig
from stages.sim.renderer import Renderer
from stages.sim.robosuite_scene import make_environment
from stages.sim.scene import Scene, build_scene
from stages.sim.tasks import sample_initial_state
from stages.sim.world import World

SIZES = (128, 64)  # [pixels]; the targets are of the first
MISALIGNMENTS = [(kind, degrees) for kind in ("orbit", "pan") for degrees in (5, 10)]
STEPS_BETWEEN_STATES = 8

Render = Callable[[np.ndarray, CameraPose], np.ndarray]


class StockCamera:
    """robosuite's offscreen renderer with its defaults, its camera `agentview` put where ours is."""

    def __init__(self, config: WorldConfig, fovy: float) -> None:
        self._environment = make_environment(config, has_offscreen_renderer=True)
        self._environment.reset()
        self._sim = self._environment.sim
        self._model, self._data = self._sim.model._model, self._sim.data._data
        self._camera = self._model.camera("agentview").id
        self._model.cam_fovy[self._camera] = fovy

    def render(self, qpos: np.ndarray, pose: CameraPose, size: int) -> np.ndarray:
        """Image (H, W, 3) uint8 as `Renderer.render` makes it."""
        rotation = (pose.rotation @ np.diag([1.0, -1.0, -1.0])).ravel()  # OpenGL: y up, looking along −z
        self._model.cam_pos[self._camera] = pose.position
        mujoco.mju_mat2Quat(self._model.cam_quat[self._camera], rotation)
        self._sim._render_context_offscreen.gl_ctx.make_current()  # robosuite believes that it draws alone
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return self._sim.render(camera_name="agentview", width=size, height=size)[::-1]

    def close(self) -> None:
        """Free the OpenGL context now: the garbage collector would take the then current one's textures with it."""
        context = self._sim._render_context_offscreen
        context.gl_ctx.make_current()
        context.con.free()
        context.gl_ctx.free()


def run(quick: bool) -> Outcome:
    """Rates of both, how much their pictures differ, and what of our time is OpenGL's."""
    count, rounds = (8, 1) if quick else (64, 7)
    camera, scene = CameraConfig(), build_scene(WorldConfig())
    stock, pose = StockCamera(WorldConfig(), camera.fovy), nominal_pose(camera)
    states = varied_states(scene, count)
    some = states[:: max(1, count // 16)]
    ours = {size: Renderer(scene, size, camera.fovy) for size in SIZES}
    theirs: dict[int, Render] = {size: partial(stock.render, size=size) for size in SIZES}
    contenders = {f"ours {size}²": _rate(ours[size].render, states, pose) for size in SIZES}
    contenders |= {f"stock {size}²": _rate(theirs[size], some, pose) for size in SIZES}
    rates = side_by_side(contenders, rounds)

    figures, big = {}, SIZES[0]
    for size in SIZES:
        found = differences(ours[size].render, theirs[size], states, pose)
        figures[f"pixel difference at {size}²"], figures[f"worst state's at {size}²"] = mean(found), max(found)
        for kind, degrees in MISALIGNMENTS:
            turned = misaligned(pose, kind, degrees, np.array(camera.target))
            found = differences(ours[size].render, theirs[size], some, turned)
            figures[f"pixel difference at {size}², {kind} {degrees}°"] = mean(found)
        figures[f"ours at {size}² [ms]"] = 1e3 / median(rates[f"ours {size}²"])
        figures[f"ours / stock at {size}²"] = ratio(rates, f"ours {size}²", f"stock {size}²")
        figures[f"background of a new pose at {size}² [ms]"] = background_ms(ours[size], states[0], pose)
    parts = frame_parts(ours[big], some, pose)
    figures["fraction of the limit"] = sum(p.limit or 0 for p in parts) / sum(p.milliseconds for p in parts)
    stock.close()
    for renderer in ours.values():
        renderer.close()
    return Outcome(
        benchmark="render",
        compares=f"one {big}² frame of a known camera pose, against robosuite's offscreen renderer with its defaults",
        unit=f"{big}² frame",
        targets=[
            Target("ours / stock", figures.pop(f"ours / stock at {big}²"), 8.0, "×"),
            Target("mean pixel difference", figures.pop(f"pixel difference at {big}²"), 2.0, "of 255", at_least=False),
        ],
        figures=figures,
        parts=parts,
        rounds=rates,
        notes=[f"pixel differences are of 255, means over {count} states, {len(some)} where the camera is misaligned"],
    )


def varied_states(scene: Scene, count: int) -> list[np.ndarray]:
    """Generalised positions (nq,) of both tasks, a quarter initial, the rest on the way to the cube or anywhere."""
    rng, found = np.random.default_rng(0), []
    for number in range(count // 4):
        world = World(scene, ("reach", "lift")[number % 2])
        world.reset(sample_initial_state(scene, world.task, rng))
        found.append(world.qpos_full())
        for _ in range(3):
            whim = rng.uniform(-1, 1, world.action_dim)
            for _ in range(STEPS_BETWEEN_STATES):
                world.step(whim if number // 2 % 2 else _towards_cube(world))
            found.append(world.qpos_full())
    return found


def differences(ours: Render, theirs: Render, states: list[np.ndarray], pose: CameraPose) -> list[float]:
    """Mean absolute difference of each state's two pictures, in 0…255."""
    return [float(np.abs(ours(q, pose).astype(int) - theirs(q, pose)).mean()) for q in states]


def frame_parts(renderer: Renderer, states: list[np.ndarray], pose: CameraPose) -> list[Part]:
    """Where the time of a frame goes; the limit is OpenGL alone, each state's frame again and again."""
    renderer.render(states[0], pose)
    bare, watch = [], Stopwatch()
    for qpos in states:
        renderer.render(qpos, pose)
        bare.append(roofline.raster_ms(renderer))
    canvas, repetitions = renderer._canvas, 20
    watch.wrap(renderer, "render", "frame")
    for holder, method in [(canvas, "place"), (canvas, "draw"), (renderer, "_composed")]:
        watch.wrap(holder, method, method)
    for _ in range(repetitions):
        for qpos in states:
            renderer.render(qpos, pose)
    spent = {name: 1e3 * seconds / repetitions / len(states) for name, seconds in watch.seconds.items()}
    return [
        Part("render: kinematics", spent["place"]),
        Part("render: choice of geoms", spent["frame"] - spent["place"] - spent["draw"] - spent["_composed"]),
        Part("render: OpenGL", spent["draw"], mean(bare)),
        Part("render: compositing and averaging", spent["_composed"]),
    ]


def background_ms(renderer: Renderer, qpos: np.ndarray, pose: CameraPose) -> float:
    """What the first frame of a pose costs beyond the others [ms]."""
    renderer.render(qpos, pose)
    return milliseconds(lambda: renderer._draw_background(pose), repetitions=10)


def _rate(render: Render, states: list[np.ndarray], pose: CameraPose) -> Callable[[], float]:
    return rate_of(lambda: [render(qpos, pose) for qpos in states], len(states))


def _towards_cube(world: World) -> np.ndarray:
    """Action that moves the gripper point straight to the cube."""
    state = world.state()
    velocity = np.linalg.pinv(world.gripper_jacobian()) @ (state["cube_position"] - state["eef"])
    action = velocity / np.abs(velocity).max()
    return np.append(action, -1.0) if world.task == "lift" else action
