"""Lines and the slabs that sample them: in the plane as (r, β), in space by coordinates in which
lines are uniform (the measure that motions keep), and how evenly sets of slabs fill both."""

import numpy as np

# ---- lines in the plane --------------------------------------------------------------------


def circle_lines(points):
    """All chords between points evenly around the unit circle: (ends a, ends b)."""
    angles = 2 * np.pi * np.arange(points) / points
    at = np.stack([np.cos(angles), np.sin(angles)], 1)
    i, j = np.triu_indices(points, 1)
    return at[i], at[j]


def pair_lines(points, extent, vertical=False):
    """All lines between points evenly along two parallel segments at distance 1 from the centre."""
    x = np.linspace(-extent, extent, points)
    a, b = np.meshgrid(x, x)
    a = np.stack([a.ravel(), -np.ones(points * points)], 1)
    b = np.stack([b.ravel(), np.ones(points * points)], 1)
    return (a[:, ::-1], b[:, ::-1]) if vertical else (a, b)


def line_space(a, b):
    """(r, β): signed distance from the centre, angle of the normal in [0, π)."""
    along = b - a
    normal = np.stack([-along[:, 1], along[:, 0]], 1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    r = (a * normal).sum(1)
    beta = np.arctan2(normal[:, 1], normal[:, 0])
    turned = (beta < 0) | (beta >= np.pi)
    return np.where(turned, -r, r), np.mod(beta, np.pi)


# ---- lattices on the sphere ----------------------------------------------------------------


def _barycentric(cells):
    """The points of one octsphere's lattice, as barycentric coordinates."""
    i, j = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1))
    keep = i + j <= cells
    i, j = i[keep], j[keep]
    return np.stack([i, j, cells - i - j], 1) / cells


def gnomonic(b):
    return b / np.linalg.norm(b, axis=-1)[..., None]


def equal_angle(b):
    return gnomonic(np.sin(b * np.pi / 2))


def equal_area(b):
    r = b[..., 0] + b[..., 1]
    angle = np.where(r > 0, np.pi / 2 * b[..., 1] / np.maximum(r, 1e-12), 0)
    side = r * np.sqrt(np.maximum(0, 2 - r * r))
    return np.stack([side * np.cos(angle), side * np.sin(angle), 1 - r * r], -1)


LATTICES = {"gnomonic": gnomonic, "equal-angle": equal_angle, "equal-area": equal_area}


def lattice_points(spread, cells):
    """All points of a lattice, each once."""
    octsphere = spread(_barycentric(cells))
    signs = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)])
    points = (octsphere[None] * signs[:, None]).reshape(-1, 3)
    return np.unique(np.round(points, 9), axis=0)


def octsphere_cells(spread, cells):
    """The triangles of one octsphere, (count, 3 corners, xyz), and their areas over their mean."""
    triangles = []
    for j in range(cells):
        for i in range(cells - j):
            triangles.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < cells - 1:
                triangles.append([(i + 1, j + 1), (i, j + 1), (i + 1, j)])
    grid = np.array(triangles, float)
    b = np.concatenate([grid, cells - grid.sum(2, keepdims=True)], 2) / cells
    corners = spread(b)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(sides, axis=1)
    return corners, areas / areas.mean()


# ---- slabs in space ------------------------------------------------------------------------


def sphere_slabs(spread, cells, count, random):
    """Random slabs of a lattice: points on the lines and their directions."""
    points = lattice_points(spread, cells)
    a, b = (points[random.integers(len(points), size=count)] for _ in range(2))
    differ = (a != b).any(1)
    return a[differ], (b - a)[differ]


def plane_slabs(first, second, first_nodes, second_nodes, count, random):
    """Random slabs of six pairs of planes, and which of them are useful: those cross the sphere
    in a direction that no other pair has."""
    extent = lambda height: np.sqrt(2) + abs(height)  # noqa: E731
    node = lambda nodes: random.integers(nodes, size=(count, 2)) * 2 / (nodes - 1) - 1  # noqa: E731
    a = np.concatenate([extent(first) * node(first_nodes), np.full((count, 1), first)], 1)
    b = np.concatenate([extent(second) * node(second_nodes), np.full((count, 1), second)], 1)
    d = b - a
    useful = (np.abs(d[:, :2]) <= d[:, 2:]).all(1)
    useful &= np.linalg.norm(np.cross(a, d), axis=1) < np.linalg.norm(d, axis=1)
    pair = random.integers(6, size=count)
    flip = np.where(pair % 2, -1, 1)[:, None]
    turn = (np.arange(3)[None] - pair[:, None] // 2 + 2) % 3  # world axis k is the pair's axis turn
    out = [np.take_along_axis(v * np.where(np.arange(3) == 2, flip, 1), turn, 1) for v in (a, d)]
    return out[0], out[1], useful


def uniform_slabs(count, random):
    """Lines uniform among those that cross the unit sphere: ends uniform on it."""
    a, b = (gnomonic(random.normal(size=(count, 3))) for _ in range(2))
    return a, b - a


def line_coordinates(points, directions):
    """Four coordinates in [0, 1) in which lines that cross the unit sphere are uniform: of the
    direction height and longitude, of the nearest point squared distance and angle."""
    d = directions / np.linalg.norm(directions, axis=1)[:, None]
    nearest = points - (points * d).sum(1)[:, None] * d
    east = np.stack([-d[:, 1], d[:, 0], np.zeros(len(d))], 1)
    east /= np.maximum(np.linalg.norm(east, axis=1), 1e-12)[:, None]
    north = np.cross(d, east)
    angle = np.arctan2((nearest * north).sum(1), (nearest * east).sum(1))
    longitude = np.arctan2(d[:, 1], d[:, 0])
    squared = np.minimum((nearest**2).sum(1), 1 - 1e-9)
    clip = lambda x: np.clip(x, 0, 1 - 1e-9)  # noqa: E731
    turns = lambda x: clip(x / (2 * np.pi) + 0.5)  # noqa: E731
    return np.stack([clip((d[:, 2] + 1) / 2), turns(longitude), squared, turns(angle)], 1)


# ---- evenness ------------------------------------------------------------------------------


def evenness(coordinates, bins, random, boxes=2000):
    """How evenly points fill the unit cube: the density of each bin over the mean, and
    variation    their standard deviation
    ratio        the density that 95 % of the bins stay below over that of 5 %
    empty        share of bins without any
    discrepancy  greatest difference between the share of the points in a box at the origin and
                 the box's volume, over random boxes"""
    counts, _ = np.histogramdd(coordinates, bins=bins, range=[(0, 1)] * coordinates.shape[1])
    density = counts.ravel() / counts.mean()
    low, high = np.quantile(density, [0.05, 0.95])
    few = coordinates[:200_000]
    corners = random.random((boxes, coordinates.shape[1]))
    shares = np.array([(few < corner).all(1).mean() for corner in corners[: boxes // 4]])
    worst = np.abs(shares - corners[: boxes // 4].prod(1)).max()
    return {
        "variation": float(density.std()),
        "ratio": float(high / low) if low > 0 else float("inf"),
        "empty": float((density == 0).mean()),
        "discrepancy": float(worst),
    }, density
