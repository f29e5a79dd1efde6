"""A picture of a robot for its page: its meshes, shaded, as a PNG without background."""

import base64
import io
from typing import Any

import numpy as np

from ..core import Array
from ..robots import Looks
from .page import Figure

_WIDTH = 760  # of the picture [pixels], at most; pixels per inch
_HEIGHT = 540
_DPI = 100.0
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
    from matplotlib.collections import PolyCollection  # imported late: it takes half a second
    from matplotlib.figure import Figure as Canvas

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
    flat: Any = seen[order, :, :2]  # PolyCollection takes lists too, at seven times the time
    low = flat.min(axis=(0, 1))
    high = flat.max(axis=(0, 1))
    wide, tall = high - low
    scale = min(_WIDTH / max(wide, 1e-9), _HEIGHT / max(tall, 1e-9)) / _DPI
    canvas = Canvas(figsize=(scale * wide + 0.1, scale * tall + 0.1), dpi=_DPI)
    axis = canvas.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_axis_off()
    axis.add_collection(PolyCollection(flat, facecolors=painted, edgecolors=painted, lw=0.3))
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    stream = io.BytesIO()
    canvas.savefig(stream, format="png", transparent=True, metadata={"Software": None})
    return stream.getvalue(), canvas.bbox.width / _SHARP
