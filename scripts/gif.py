"""Makes docs/demo.gif: a UR5 while it is identified, from a real run.

    nsaid run ur5 --law efficient --sensors noisy --duration 12 --out runs/demo
    python scripts/gif.py runs/demo

The robot is drawn from its own visual meshes; the distance needs the truth of the simulated plant.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.collections import PolyCollection
from scipy.spatial.transform import Rotation

from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import SimulatedRun, reopen
from nsaid_mj.lab.record import Record

OUT = Path(__file__).parents[1] / "docs" / "demo.gif"
FRAMES, RATE, LAST = 72, 12, 12.0  # pictures, pictures per second, end of the picture [s]
MARGIN = 0.12  # around the robot [m]
VIEW = Rotation.from_euler("zx", [-125, -65], degrees=True)  # world to screen: x right, y up
LIGHT = np.array([0.3, 0.6, 0.75])
TINT = np.array([0.80, 0.90, 1.0])
INK, PAPER, BLUE, ORANGE = "#22303a", "#ffffff", "#2f6db3", "#d9742b"


class Robot:
    """The run's robot as shaded triangles, the farthest drawn first."""

    def __init__(self, run: SimulatedRun, rows: np.ndarray):
        self._meshes = run.plant.visuals()
        self._poses = run.plant.poses(run.record["q"][rows])

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (2,) of where the links' origins ever are, with a margin."""
        places = VIEW.apply(self._poses[0].reshape(-1, 3))[:, :2]
        return places.min(0) - MARGIN, places.max(0) + MARGIN

    def draw(self, collection: PolyCollection, frame: int) -> None:
        """Sets the triangles of a picture."""
        corners, colors = [], []
        for k, mesh in enumerate(self._meshes):
            turned = Rotation.from_quat(self._poses[1][frame, k]).apply(mesh.vertices)
            seen = VIEW.apply(turned + self._poses[0][frame, k])[mesh.triangles]
            normal = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
            shade = 0.35 + 0.65 * np.abs(normal @ LIGHT)
            corners.append(seen)
            colors.append(np.clip(shade[:, None] * TINT * mesh.color[:3], 0, 1))
        triangles, shades = np.concatenate(corners), np.concatenate(colors)
        order = np.argsort(triangles[:, :, 2].mean(axis=1))
        collection.set_verts(list(triangles[order, :, :2]))
        collection.set_facecolor([tuple(shade) for shade in shades[order]])


def main(folder: Path) -> None:
    """Draws robot, distance and gains of a run."""
    run = reopen(folder, Record.read(folder))
    record, space = run.record, run.system.space
    last = np.searchsorted(record["t"], LAST) - 1
    rows = np.linspace(0, last, FRAMES).astype(int)
    t, theta = record["t"][rows], record["theta_hat"][rows]
    truth = Truth.of(run)
    distance = truth.nullspace.ratio(theta / space.scale)
    true = truth.theta[space.actuators]
    share = theta[:, space.actuators] / true
    share /= share.mean(axis=1, keepdims=True)

    plt.rcParams.update({"font.size": 9, "axes.edgecolor": INK, "axes.labelcolor": INK})
    figure = plt.figure(figsize=(7.2, 3.6), dpi=90, facecolor=PAPER)
    grid = figure.add_gridspec(
        2,
        2,
        width_ratios=(1.1, 1),
        left=0.02,
        right=0.98,
        top=0.9,
        bottom=0.13,
        wspace=0.22,
        hspace=0.55,
    )
    view = figure.add_subplot(grid[:, 0])
    robot = Robot(run, rows)
    (left, low), (right, high) = robot.extent()
    view.set(xlim=(left, right), ylim=(low - 0.1 * (high - low), high), aspect="equal")
    view.axis("off")
    collection = PolyCollection([], edgecolor="none", antialiased=False)
    view.add_collection(collection)
    upper, lower = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    upper.set_title("distance of the estimate to the true set", loc="left", fontsize=9)
    upper.set(yscale="log", xlim=(0, t[-1]), ylim=(distance.min() / 2, 2 * distance.max()))
    lower.set_title("motor gains, estimate / truth (1 is right)", loc="left", fontsize=9)
    lower.set(xlim=(0, t[-1]), ylim=(0.75, 1.25), xlabel="time [s]")
    (curve,) = upper.plot([], [], color=BLUE, linewidth=2)
    gains = lower.plot(np.full((1, share.shape[1]), np.nan), color=ORANGE, linewidth=1)
    clock = view.text(0.08, 0.02, "", transform=view.transAxes, color=INK)

    def draw(frame: int) -> None:
        robot.draw(collection, frame)
        curve.set_data(t[: frame + 1], distance[: frame + 1])
        for k, line in enumerate(gains):
            line.set_data(t[: frame + 1], share[: frame + 1, k])
        clock.set_text(f"{t[frame]:4.1f} s   {distance[frame]:.2%} from the true set")

    FuncAnimation(figure, draw, frames=FRAMES).save(OUT, PillowWriter(fps=RATE))
    print(f"{OUT}: {OUT.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
