"""Writes an episode's scene into a Rerun recording: arm, table, cubes, camera and its image."""

import numpy as np
import rerun as rr

from schemas import entities
from stages.replay.projection import cube_edges, in_image
from stages.replay.track import Clock, EpisodeTrack, Pose
from stages.sim.scene import CUBE_HALF_SIZE, TABLE_HEIGHT

_TABLE_HALF_SIZE = (0.4, 0.4, 0.025)  # [m], robosuite's Lift
_TABLE_COLOUR = (120, 104, 88)
_IMAGE_PLANE_DISTANCE = 0.3  # [m], of the frustum drawn in 3D


def log_scene(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    """Everything with a place in space."""
    _log_still(recording, track)
    _log_links(recording, track)
    _log_cubes(recording, track)
    _log_camera(recording, track)


def times(clock: Clock) -> list[rr.TimeColumn]:
    """Both timelines of a recording."""
    return [
        rr.TimeColumn(entities.SIM_TIME, duration=clock.time_ns.astype("timedelta64[ns]")),
        rr.TimeColumn(entities.STEP, sequence=clock.step.astype(np.int64)),
    ]


def _log_still(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    log_table(recording)
    for index, mesh in enumerate(track.meshes):
        path = f"{entities.link(mesh.link)}/{index}"
        recording.log(path, rr.CoordinateFrame(mesh.link), static=True)
        recording.log(
            path,
            rr.Mesh3D(
                vertex_positions=mesh.vertices,
                triangle_indices=mesh.triangles,
                vertex_normals=_normals(mesh.vertices, mesh.triangles),
                albedo_factor=mesh.rgba,
            ),
            static=True,
        )


def log_table(recording: rr.RecordingStream) -> None:
    """The table of robosuite's Lift, without legs."""
    centre = (0.0, 0.0, TABLE_HEIGHT - _TABLE_HALF_SIZE[2])
    table = rr.Boxes3D(centers=[centre], half_sizes=[_TABLE_HALF_SIZE], colors=_TABLE_COLOUR, fill_mode="Solid")
    recording.log(entities.TABLE, rr.CoordinateFrame(entities.WORLD), table, static=True)


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Vertex normals (n, 3), each the area-weighted mean of its triangles': smooth shading."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], face)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _log_links(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    """`/tf` as Rerun's MCAP loader writes it: a row for every frame at every time."""
    count = len(track.clock)
    camera = Pose(np.tile(track.camera.position, (count, 1)), np.tile(track.camera.quaternion, (count, 1)))
    frames = track.links | {entities.CAMERA: camera}
    rows = np.repeat(np.arange(count), len(frames))
    recording.send_columns(
        entities.TRANSFORMS,
        times(track.clock.at(rows)),
        rr.Transform3D.columns(
            translation=np.stack([pose.position for pose in frames.values()], axis=1).reshape(-1, 3),
            quaternion=xyzw(np.stack([pose.quaternion for pose in frames.values()], axis=1).reshape(-1, 4)),
            child_frame=list(frames) * count,
            parent_frame=[entities.WORLD] * len(rows),
        ),
    )


def _log_cubes(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    _log_cube(recording, track, entities.CUBE_TRUE, track.cube, entities.TRUE_COLOUR, "Solid")
    if track.estimate is not None:
        # the estimate has no orientation: shown with the true one, so that the two differ by the error alone
        estimate = Pose(track.estimate, track.cube.quaternion)
        _log_cube(recording, track, entities.CUBE_EST, estimate, entities.ESTIMATED_COLOUR, "MajorWireframe")
        _log_error(recording, track, track.estimate)
    if track.gripper_point is not None:
        _log_gripper(recording, track, track.gripper_point)


def _log_cube(
    recording: rr.RecordingStream,
    track: EpisodeTrack,
    path: str,
    pose: Pose,
    colour: tuple[int, ...],
    fill: rr.components.FillModeLike,
) -> None:
    recording.log(path, rr.CoordinateFrame(entities.WORLD), static=True)
    box = rr.Boxes3D(half_sizes=[[CUBE_HALF_SIZE] * 3], colors=colour, fill_mode=fill, radii=rr.Radius.ui_points(1.5))
    recording.log(path, box, static=True)
    columns = rr.InstancePoses3D.columns(translations=pose.position, quaternions=xyzw(pose.quaternion))
    recording.send_columns(path, times(track.clock), columns)


def _log_error(recording: rr.RecordingStream, track: EpisodeTrack, estimate: np.ndarray) -> None:
    strips = np.stack([track.cube.position, estimate], axis=1)  # (n, 2, 3)
    style = rr.LineStrips3D.from_fields(colors=entities.ERROR_COLOUR, radii=rr.Radius.ui_points(2.5))
    recording.log(entities.CUBE_ERROR, rr.CoordinateFrame(entities.WORLD), style, static=True)
    recording.send_columns(entities.CUBE_ERROR, times(track.clock), rr.LineStrips3D.columns(strips=list(strips)))


def _log_gripper(recording: rr.RecordingStream, track: EpisodeTrack, points: np.ndarray) -> None:
    world = rr.CoordinateFrame(entities.WORLD)
    style = rr.Points3D.from_fields(colors=entities.GRIPPER_COLOUR, radii=rr.Radius.ui_points(5))
    recording.log(entities.GRIPPER_POINT, world, style, static=True)
    recording.send_columns(entities.GRIPPER_POINT, times(track.clock), rr.Points3D.columns(positions=points))
    path = rr.LineStrips3D([points], colors=(*entities.GRIPPER_COLOUR, 90), radii=rr.Radius.ui_points(1))
    recording.log(entities.GRIPPER_PATH, world, path, static=True)


def _log_camera(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    pinhole = rr.Pinhole(
        image_from_camera=track.intrinsics.matrix,
        resolution=[track.intrinsics.size] * 2,
        parent_frame=entities.CAMERA,
        child_frame=entities.IMAGE_PLANE,
        image_plane_distance=_IMAGE_PLANE_DISTANCE,
        color=entities.NEUTRAL_COLOUR,
    )
    recording.log(entities.CALIBRATION, pinhole, static=True)
    recording.log(entities.IMAGE, rr.CoordinateFrame(entities.IMAGE_PLANE), static=True)
    columns = rr.EncodedImage.columns(blob=track.images, media_type=[track.media_type] * len(track.images))
    recording.send_columns(entities.IMAGE, times(track.clock), columns)
    _log_projection(recording, track, entities.IMAGE_CUBE_TRUE, track.cube.position, entities.TRUE_COLOUR)
    if track.estimate is not None:
        _log_projection(recording, track, entities.IMAGE_CUBE_EST, track.estimate, entities.ESTIMATED_COLOUR)
        _log_projected_error(recording, track, track.estimate)


def _log_projection(
    recording: rr.RecordingStream, track: EpisodeTrack, path: str, position: np.ndarray, colour: tuple[int, ...]
) -> None:
    """The edges of a cube at `position` (n, 3), as the camera sees them."""
    strips = cube_edges(position, track.cube.quaternion, track.camera, track.intrinsics)
    _log_strips(recording, track, path, strips, colour, 1.5)


def _log_projected_error(recording: rr.RecordingStream, track: EpisodeTrack, estimate: np.ndarray) -> None:
    ends = np.stack([track.cube.position, estimate], axis=1)  # (n, 2, 3)
    strips = in_image(ends, track.camera, track.intrinsics)
    _log_strips(recording, track, entities.IMAGE_ERROR, strips, entities.ERROR_COLOUR, 2.0)


def _log_strips(
    recording: rr.RecordingStream,
    track: EpisodeTrack,
    path: str,
    strips: np.ndarray,
    colour: tuple[int, ...],
    points: float,
) -> None:
    style = rr.LineStrips2D.from_fields(colors=colour, radii=rr.Radius.ui_points(points), draw_order=10.0)
    recording.log(path, rr.CoordinateFrame(entities.IMAGE_PLANE), style, static=True)
    recording.send_columns(path, times(track.clock), rr.LineStrips2D.columns(strips=list(strips)))


def xyzw(quaternion: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) from MuJoCo's order to Rerun's."""
    return quaternion[:, [1, 2, 3, 0]]
