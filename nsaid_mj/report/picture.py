"""A picture of a robot for its page: its meshes, shaded, as a PNG without background."""

import base64
import io

import numpy as np

from ..core import Array
from ..robots import Looks
from .page import Figure

_WIDTH = 760  # of the picture [pixels], at most
_HEIGHT = 540
_EDGE = 5  # free pixels around it
_FINE = 2  # pixels along each side that are averaged to one
_SHARP = 1.6  # pixels of the picture per pixel of the page
_AZIMUTH = np.radians(-52.0)  # of the eye
_ELEVATION = np.radians(22.0)
_LIGHT = np.array([0.35, -0.55, 0.76])
_DARKEST = 0.35  # share of the colour in the shadow


def robot_picture(looks: Looks | None, q: Array, name: str) -> Figure | None:
    """The robot at positions q (m,) as a figure of a page; None without meshes, or finite q."""
    from markupsafe import Markup

    if looks is None or not np.isfinite(q).all():
        return None
    faces, colours = _faces(looks, q)
    if not len(faces):
        return None
    rendered, width = _render(faces, colours)
    image = Markup('<img src="data:image/png;base64,{}" width="{:.0f}" alt="{}">').format(
        Markup(base64.b64encode(rendered).decode()), width, f"{name} at the start of the run"
    )
    return Figure("Robot at the start of the run", image)


def _faces(looks: Looks, q: Array) -> tuple[Array, Array]:
    """(f, 3, 3) corners of all triangles in the world [m], and (f, 4) their colours."""
    places, attitudes = looks.poses(q[None])
    faces = [np.zeros((0, 3, 3))]
    colours = [np.zeros((0, 4))]
    for i, mesh in enumerate(looks.visuals()):
        axis = attitudes[0, i, :3]
        w = attitudes[0, i, 3]
        turned = np.cross(axis, mesh.vertices)
        turned = mesh.vertices + 2 * (w * turned + np.cross(axis, turned))
        faces.append((turned + places[0, i])[mesh.triangles])
        colours.append(np.tile(np.asarray(mesh.color, float), (len(mesh.triangles), 1)))
    return np.concatenate(faces), np.concatenate(colours)


def _render(faces: Array, colours: Array) -> tuple[bytes, float]:
    """A PNG of faces (f, 3, 3) with colours (f, 4), the farthest drawn first; its width [px]."""
    from PIL import Image, ImageDraw  # imported late: needed only for a robot with meshes

    toward = np.array(
        [
            np.cos(_ELEVATION) * np.cos(_AZIMUTH),
            np.cos(_ELEVATION) * np.sin(_AZIMUTH),
            np.sin(_ELEVATION),
        ]
    )
    right = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    seen = faces @ np.stack([right, np.cross(toward, right), toward], axis=1)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = normal / np.where(length > 0, length, np.inf)
    facing *= np.where(facing @ toward < 0, -1.0, 1.0)[:, None]  # meshes may be inside out
    light = _LIGHT / np.linalg.norm(_LIGHT)
    shade = _DARKEST + (1 - _DARKEST) * (
        0.65 * np.maximum(facing @ light, 0) + 0.35 * np.abs(facing @ toward)
    )
    order = np.argsort(seen[..., 2].mean(axis=1))
    painted = np.clip(colours[:, :3] * shade[:, None], 0, 1)[order]
    flat = seen[order, :, :2]
    low = flat.min(axis=(0, 1))
    high = flat.max(axis=(0, 1))
    wide, tall = high - low
    scale = min(_WIDTH / max(wide, 1e-9), _HEIGHT / max(tall, 1e-9))
    size = np.ceil(scale * np.array([wide, tall])).astype(int) + 2 * _EDGE
    corners = np.stack([flat[..., 0] - low[0], high[1] - flat[..., 1]], axis=-1)
    points = (_FINE * (scale * corners + _EDGE)).reshape(-1, 6).tolist()
    paints = np.rint(255 * painted).astype(int).tolist()
    canvas = Image.new("RGBA", (int(_FINE * size[0]), int(_FINE * size[1])))
    draw = ImageDraw.Draw(canvas)
    for corner, paint in zip(points, paints, strict=True):
        draw.polygon(corner, fill=tuple(paint), outline=tuple(paint))
    stream = io.BytesIO()
    canvas.reduce(_FINE).save(stream, format="png", optimize=True)
    return stream.getvalue(), float(size[0]) / _SHARP
