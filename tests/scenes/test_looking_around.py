"""`stimuli look` proposes views from where a scene is meant to be seen."""

import numpy as np
import pytest
import trimesh

from protocols.load import parse_view
from stimuli.rendering import scene_views
from stimuli.rendering.scene_views import ScenePreview, look_around

COUNT = 4


@pytest.fixture
def views(gl_context, tmp_path, monkeypatch):
    """Write a mesh, look around it, and return the eye of each view with what was reported."""
    monkeypatch.setattr(scene_views, "TRIED", 16)
    monkeypatch.setattr(scene_views, "TILE_PX", (64, 48))

    def of(mesh: trimesh.Trimesh) -> np.ndarray:
        mesh.export(tmp_path / "place.glb")
        told: list[tuple[int, int]] = []
        lines = look_around(
            gl_context, ScenePreview(str(tmp_path / "place.glb")), tmp_path / "views.png", COUNT,
            report=lambda done, total: told.append((done, total)),
        )  # fmt: skip
        assert [done for done, _ in told] == list(range(1, told[-1][1] + 1))
        return np.array([parse_view(line).position_m for line in lines])

    return of


def coloured(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    shades = np.random.default_rng(1).integers(40, 220, (len(mesh.vertices), 3))
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=shades.astype(np.uint8))
    return mesh


def test_a_closed_body_is_looked_at_from_outside(views):
    """1,280 triangles, with level ones at the bottom, on which nobody stands."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.vertices[:, 1] = ball.vertices[:, 1].clip(-0.7, None)
    eyes = views(coloured(ball))
    assert len(eyes) == COUNT
    assert (np.linalg.norm(eyes, axis=1) > 1).all()


def test_a_room_is_looked_at_from_inside(views):
    room = trimesh.creation.box((8, 3, 6)).subdivide().subdivide()
    table = trimesh.creation.box((1.5, 0.8, 1)).apply_translation((1, -1.1, 0))
    room.invert()
    eyes = views(coloured(trimesh.util.concatenate([room, table])))
    assert (np.abs(eyes) < (4, 1.5, 3)).all()


def test_a_terrain_is_looked_at_from_above(views):
    steps = np.linspace(-10, 10, 21)
    x, z = np.meshgrid(steps, steps)
    height = 1.5 * np.sin(0.6 * x) * np.cos(0.5 * z)
    corners = np.stack([x, height, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(corners)).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, b), (b, c, d))]
    eyes = views(coloured(trimesh.Trimesh(corners, np.concatenate(faces), process=False)))
    ground = 1.5 * np.sin(0.6 * eyes[:, 0]) * np.cos(0.5 * eyes[:, 2])
    inside = (np.abs(eyes[:, [0, 2]]) < 10).all(axis=1)
    assert (eyes[:, 1] > np.where(inside, ground, 0)).all()
