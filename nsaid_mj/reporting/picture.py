"""A picture of a robot for its page: its meshes, shaded, as a PNG without background."""

from __future__ import annotations

import base64
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..experiment.loop import Looks
from ..parameters import Array

_WIDTH, _HEIGHT, _MARGIN = 760, 540, 0.05  # of the picture [pixels], and share left empty
_AZIMUTH, _ELEVATION = np.radians(-52.0), np.radians(22.0)  # of the eye
_LIGHT = np.array([0.35, -0.55, 0.76])
_SPACING = 0.75  # between points [pixels]
_DARKEST = 0.35  # share of the colour in the shadow


def picture(looks: Looks | None, q: Array, name: str) -> dict[str, Any] | None:
    """The robot at positions q (m,) as a figure for the template `parts.html`.

    Args:
        looks: its meshes and their poses.
        q: (m,) positions.
        name: of the robot.

    Returns:
        None if it has no meshes, or if q is not finite.
    """
    from markupsafe import Markup, escape

    if looks is None or not np.isfinite(q).all():
        return None
    faces, colours = _faces(looks, q)
    if not len(faces):
        return None
    pixels = _render(faces, colours)
    code = base64.b64encode(png(pixels)).decode()
    alt = escape(f"{name} at the start of the run")
    image = Markup('<img src="data:image/png;base64,{}" alt="{}" width="{}" height="{}">').format(
        Markup(code), alt, _WIDTH, len(pixels)
    )
    return {"title": "Robot at the start of the run", "svg": image, "wide": False, "legend": []}


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file of (h, w, 4) RGBA pixels."""
    height, width, _ = pixels.shape
    rows = pixels.astype(np.int16)
    rows[:, 1:] -= pixels[:, :-1]  # each pixel less its left neighbour compresses well
    lines = np.empty((height, 1 + 4 * width), np.uint8)
    lines[:, 0] = 1  # of this filter
    lines[:, 1:] = rows.reshape(height, -1) % 256
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = [(b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b"")]
    chunks = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _faces(looks: Looks, q: Array) -> tuple[Array, Array]:
    """(f, 3, 3) corners of all triangles in the world [m], and (f, 4) their colours."""
    places, attitudes = looks.poses(q[None])
    faces, colours = [np.zeros((0, 3, 3))], [np.zeros((0, 4))]
    for i, mesh in enumerate(looks.visuals()):
        axis, w = attitudes[0, i, :3], attitudes[0, i, 3]
        turned = np.cross(axis, mesh.vertices)
        turned = mesh.vertices + 2 * (w * turned + np.cross(axis, turned))
        faces.append((turned + places[0, i])[mesh.triangles])
        colours.append(np.tile(np.asarray(mesh.color, float), (len(mesh.triangles), 1)))
    return np.concatenate(faces), np.concatenate(colours)


def _render(faces: Array, colours: Array) -> NDArray[np.uint8]:
    """(h, w, 4) pixels: points on all faces, the nearest of each pixel."""
    toward = np.array([
        np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH),
        np.sin(_ELEVATION),
    ])  # fmt: skip
    right = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    seen = faces @ np.stack([right, np.cross(toward, right), toward], axis=1)
    flat = seen[..., :2].reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = np.array([_WIDTH, _HEIGHT])
    zoom = float(((1 - 2 * _MARGIN) * size / np.maximum(high - low, 1e-9)).min())
    seen[..., :2] = (seen[..., :2] - (low + high) / 2) * zoom + size / 2
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = normal / np.where(length > 0, length, np.inf)
    facing *= np.where(facing @ toward < 0, -1.0, 1.0)[:, None]  # meshes may be inside out
    light = _LIGHT / np.linalg.norm(_LIGHT)
    shade = _DARKEST + (1 - _DARKEST) * (0.65 * np.maximum(facing @ light, 0) + 0.35 * np.abs(
        facing @ toward
    ))  # fmt: skip
    painted = np.round(255 * np.clip(colours[:, :3] * shade[:, None], 0, 1)).astype(np.uint8)
    image = np.zeros((_HEIGHT, _WIDTH, 4), np.uint8)
    points, face = _points(seen.astype(np.float32))
    near = np.argsort(points[:, 2])  # later points overwrite earlier ones
    column, row = points[near, 0].astype(int), size[1] - 1 - points[near, 1].astype(int)
    image[row, column, :3] = painted[face[near]]
    image[row, column, 3] = 255
    used = np.flatnonzero(image[..., 3].any(axis=1))
    edge = int(_MARGIN * _HEIGHT)
    return image[max(0, used[0] - edge) : used[-1] + edge + 1]


def _points(seen: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Points on projected faces (f, 3, 3) at most `_SPACING` apart, and the face of each.

    Points lie on lines parallel to a face's longest edge, so that long thin faces need few.
    """
    edges = np.roll(seen, -1, axis=1)[..., :2] - seen[..., :2]
    lengths = np.linalg.norm(edges, axis=2)
    first = lengths.argmax(axis=1)
    order = (first[:, None] + np.arange(3)) % 3  # the longest edge runs from 0 to 1
    corners = np.take_along_axis(seen, order[..., None], axis=1)
    longest = lengths.max(axis=1)
    area = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    height = area / np.where(longest > 0, longest, np.inf)
    sizes = np.stack([longest, height], axis=1)
    steps = np.maximum(np.ceil(sizes / _SPACING), 1).astype(int)
    points, owner = [], []
    kinds, kind = np.unique(steps, axis=0, return_inverse=True)
    sorted_, starts = np.argsort(kind.ravel(), kind="stable"), np.bincount(kind.ravel()).cumsum()
    for (n, m), chosen in zip(kinds, np.split(sorted_, starts[:-1]), strict=True):
        i, j = (part.ravel() for part in np.mgrid[0 : m + 1, 0 : n + 1])
        base = (1 - i / m) * j / n
        weights = np.stack([1 - i / m - base, base, i / m], axis=1).astype(np.float32)
        points.append((weights @ corners[chosen]).reshape(-1, 3))
        owner.append(np.repeat(chosen, len(weights)))
    return np.concatenate(points), np.concatenate(owner)
