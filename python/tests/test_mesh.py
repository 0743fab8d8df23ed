"""Meshes of trimesh and pyvista as sources: stand-ins with their attributes, and the real ones."""

import types

import numpy as np
import pytest

import slf

# A tetrahedron.
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
# One face looks at this camera, another at the second one.
ACROSS, BELOW = slf.Camera((3, 3, 3), (0.2, 0.2, 0.2)), slf.Camera((0.2, 0.3, -4), (0.2, 0.2, 0))
COLORS = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 0, 255]],
                  np.uint8)


def trimesh_like(**visual):
    return types.SimpleNamespace(vertices=POINTS, faces=FACES,
                                 visual=types.SimpleNamespace(**visual))


def pyvista_like(faces, **data):
    return types.SimpleNamespace(points=POINTS.astype("f4"), faces=faces, point_data=data)


def seen(mesh, camera=ACROSS):
    picture = slf.raycast(mesh, camera, (32, 32), shade=False, background=(0, 0, 0))
    return picture[16, 16, :3]


def test_trimesh_with_colors_of_faces_and_vertices():
    faces = trimesh_like(kind="face", face_colors=COLORS)
    assert np.allclose(seen(faces), [0, 0, 1], atol=0.01)
    assert np.allclose(seen(faces, BELOW), [1, 0, 0], atol=0.01)
    mixed = seen(trimesh_like(kind="vertex", vertex_colors=COLORS))
    assert mixed[1] > 0.1 and mixed[2] > 0.1
    dark = trimesh_like(kind="vertex", vertex_colors=np.full((4, 4), (1, 1, 1, 255), np.uint8))
    assert seen(dark).max() < 0.01
    assert seen(trimesh_like(kind=None)).min() > 0.5  # light grey


def test_trimesh_with_a_texture():
    image = pytest.importorskip("PIL.Image").new("RGB", (4, 4), (0, 255, 0))
    uv = np.zeros((4, 2))
    for material in (types.SimpleNamespace(image=image),
                     types.SimpleNamespace(baseColorTexture=image)):
        found = seen(trimesh_like(kind="texture", uv=uv, material=material))
        assert np.allclose(found, [0, 1, 0], atol=0.01)
    plain = trimesh_like(kind="texture", uv=uv, material=types.SimpleNamespace(image=None))
    assert seen(plain).min() > 0.5


def test_pyvista_with_triangles_and_polygons():
    triangles = np.insert(FACES, 0, 3, axis=1).ravel()
    rgb = np.tile(np.uint8([0, 0, 255]), (4, 1))
    assert np.allclose(seen(pyvista_like(triangles, other=np.arange(4.0), RGB=rgb)), [0, 0, 1],
                       atol=0.01)
    square = pyvista_like(np.array([4, 0, 1, 2, 3, 3, 0, 2, 1]))
    square.points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    above = slf.Camera((0.5, 0.5, 4), (0.5, 0.5, 0), (0, 1, 0))
    assert seen(square, above).min() > 0.5
    with pytest.raises(slf.UsageError, match="extract_surface"):
        slf.raycast(pyvista_like(None))


def test_built_evaluated_and_resumed(tmp_path):
    mesh = trimesh_like(kind="face", face_colors=COLORS)
    settings = dict(name="four", entry=2, exit=4, finest_level=0, lighting="direct")
    with slf.build(mesh, tmp_path / "mesh.slf", **settings) as field:
        assert field.provenance["source"] == "four.ply"
        assert field.evaluate(mesh, 1, (32, 32)).differs == ""
    slf.build(mesh, tmp_path / "mesh.slf", **settings).close()  # it is complete


def test_the_studio_takes_meshes(tmp_path):
    try:
        studio = slf.studio(trimesh_like(kind="face", face_colors=COLORS), tmp_path / "mesh.slf")
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    with studio:
        assert "studio at" in repr(studio)


def test_real_ones():
    trimesh = pytest.importorskip("trimesh")
    assert seen(trimesh.creation.box(), slf.Camera((0, -4, 0), (0, 0, 0))).min() > 0.3


def test_real_ones_of_pyvista():
    pyvista = pytest.importorskip("pyvista")
    assert seen(pyvista.Cube(), slf.Camera((0, -4, 0), (0, 0, 0))).min() > 0.3
