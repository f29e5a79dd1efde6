"""Makes the pictures of the README: runs scenarios and takes screenshots of the viewer.

    python scripts/screenshots.py                       # the default scenarios, into docs/
    python scripts/screenshots.py ur5 --duration 20
    python scripts/screenshots.py --file runs/ur5/run.rrd --out /tmp
    python scripts/screenshots.py --report runs/ur5/report.html

NAME.png is the recording's first page, NAME_close.png the robot alone. A report gives report.png,
report_phone.png, report_dark.png and report_print.png, by Chromium and Poppler's pdftoppm.

The viewer needs a Vulkan driver; without a graphics card, install Debian's mesa-vulkan-drivers.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient
from scipy.spatial.transform import Rotation

from nsaid_mj.base.errors import NsaidError
from nsaid_mj.base.files import OutputFolder
from nsaid_mj.cli import commands as cli
from nsaid_mj.core.log import Log
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import SimulatedRun, run
from nsaid_mj.lab.recording.forces import Arrows, body_forces, mounts_of
from nsaid_mj.lab.recording.viewer import LOCAL, free_port, listening, program
from nsaid_mj.report.recording.scene import EYE, base_poses
from nsaid_mj.robots.assets import scenarios

SCENARIOS = (
    "ur5",
    "wrong_gains",
    "scalar_rov",
    "bluerov2",
    "remus100",
    "uvms",
    "hummingbird",
    "crazyflie",
    "borinot",
    "f1tenth",
    "bmw320i",
    "rover",
    "astrobee",
    "quadruped",
)
PAPER = "wrong_gains"  # the paper's law, and no picture of the robot alone
DURATION = 30.0  # of the others, under the law `efficient` and noisy sensors [s]
DOCS = Path(__file__).resolve().parent.parent / "docs"
SIZE = (1600, 1000)
MENU = 33  # height of the viewer's own menu, which is cropped [pixels]
CLOSE, CLOSE_SIZE = (300, 100, 1300, 850), (1024, 640)
DESKTOP, PHONE = (1280, 2300), (390, 1900)  # sizes of a report's pictures [pixels]
SHEETS = 6  # of a printed report that are shown, at most
ROBOT = ("Estimated", "Nominal", "Robot", "True")  # what the title of the robot's view begins with
DRAWN = 1.0  # time for the viewer to redraw [s]
LARGEST = 300_000  # size of a picture [bytes]
PATIENCE = 60.0  # timeout of the viewer [s]
TOASTS = 10.0  # time until the viewer's start-up notifications disappear [s]


class PhotographError(NsaidError):
    """No screenshot of the viewer could be taken."""


class Ended(Exception):
    """Waiting longer does not help."""


def photograph(recording: Path, picture: Path, at: float, close: bool = False):
    """Opens a recording in a headless viewer and saves a screenshot.

    Args:
        recording: the .rrd file.
        picture: the PNG to write.
        at: position of the time cursor [s].
        close: whether to also save the robot alone, smaller, as "…_close.png".

    Raises:
        PhotographError: the viewer does not start, cannot render, or does not load the file.
    """
    port = free_port(19876)
    with tempfile.TemporaryDirectory() as folder:
        log, shot = Path(folder) / "log", Path(folder) / "shot.png"
        words = [*program(), "--headless", *listening(port), "--hide-welcome-screen"]
        words += ["--window-size", "{}x{}".format(*SIZE), str(recording.resolve())]
        with log.open("wb") as stream:
            viewer = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream)
        try:
            client = connect(viewer, port)
            patiently(lambda: client.set_time("sim_time", duration=at, play_state="paused"))
            time.sleep(TOASTS)
            client.save_screenshot(str(shot))
            reduce(shot, picture, (0, MENU, *SIZE), SIZE)
            if close:
                maximize(client)
                client.save_screenshot(str(shot))
                reduce(shot, close_up(picture), CLOSE, CLOSE_SIZE)
        except Exception as error:  # the client raises many types; report the viewer's own output
            said = log.read_text(errors="replace")
            cause = said.partition("panicked at")[2].partition("stack backtrace")[0].strip()
            raise PhotographError(
                f"the viewer could not show {recording}: {error}. It needs a Vulkan driver "
                f"(Debian: apt-get install mesa-vulkan-drivers). It said: {cause or said[-500:]}"
            ) from error
        finally:
            viewer.terminate()
            viewer.wait()


def patiently(action: Callable[[], Any]) -> Any:
    """What an action returns that fails until the viewer is ready, or the recording loaded."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return action()
        except Ended:
            raise
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def connect(viewer: subprocess.Popen[bytes], port: int) -> ViewerClient:
    """Connects to a starting viewer."""

    def action() -> ViewerClient:
        if viewer.poll() is not None:
            raise Ended(f"it ended with code {viewer.returncode}")
        client = ViewerClient.connect(f"rerun+http://{LOCAL}:{port}/proxy")
        client.get_state()
        return client

    return patiently(action)


def maximize(client: ViewerClient) -> None:
    """Maximises the view of the robot."""
    parts = client.get_blueprint().blueprint
    robot = next(v for v in client.get_state().views if v.name.startswith(ROBOT))
    parts["/viewport"]["ViewportBlueprint"]["maximized"] = robot.view_id
    client.set_blueprint(parts, of="recording")
    time.sleep(DRAWN)


def best_moment(result: SimulatedRun) -> float:
    """A time [s] near the middle of the run that makes a good picture.

    For a vehicle, it is upright, seen from the front and the side, with its arm and its forces
    across the line of sight. For other robots it is the middle of the run.
    """
    record, system, truth = result.record, result.plant.system, result.plant.truth
    t = record["t"]
    k = np.unique(np.linspace(0.4, 0.6, 2000) * (len(t) - 1)).astype(int)
    rows = Log.unchecked(*(record[column][k] for column in Log._fields))
    if not mounts_of(system):
        return float(t[len(t) // 2])
    arrows = Arrows(system, 1.0, rows, truth)
    places, attitudes = base_poses(system, rows.q)
    turn = Rotation.from_quat(attitudes)
    eye = turn.inv().apply(EYE)[:, None]  # in the vehicle's axes
    forces = arrows.lengths * body_forces(system, arrows.parts, rows, truth)
    length = np.linalg.norm(forces, axis=2)
    across = np.linalg.norm(np.cross(forces, eye), axis=2)
    upright, front = turn.apply([0, 0, 1])[:, 2], turn.apply([1, 0, 0]) @ EYE
    too_long = np.maximum(length.max(axis=1) - 1.0, 0)
    push = np.minimum(across, 0.6).mean(axis=1)
    parts = result.plant.poses(rows.q)[0] - places[:, None]
    reach = np.linalg.norm(np.cross(parts, EYE), axis=2).max(axis=1)
    good = 2 * upright - 0.5 * np.abs(front - 0.6) + 2 * push - too_long + reach / reach.max()
    return float(rows.t[np.argmax(good)])


def close_up(picture: Path) -> Path:
    """Path of the picture that shows the robot alone."""
    return picture.with_name(f"{picture.stem}_close.png")


def reduce(
    shot: Path, picture: Path, part: tuple[int, int, int, int], size: tuple[int, int]
) -> None:
    """Crops a screenshot to a part of a window of SIZE, and scales it as a window to a size."""
    image = Image.open(shot).convert("RGB")
    image = image.resize(SIZE, Image.Resampling.LANCZOS).crop(part)
    share = size[0] / SIZE[0]
    if share < 1:
        image = image.resize([round(share * side) for side in image.size], Image.Resampling.LANCZOS)
    save(image, picture)


def save(image: Image.Image, picture: Path) -> None:
    """Saves an image with as many colours as fit into LARGEST."""
    for colors in (256, 128, 64, 32):
        image.quantize(colors, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
            picture, optimize=True
        )
        if picture.stat().st_size < LARGEST:
            return


def photograph_report(page: Path, out: Path) -> list[Path]:
    """Saves a report as it looks on a desktop, on a phone, on a dark screen and on paper.

    Raises:
        PhotographError: Chromium or pdftoppm is missing, or fails.
    """
    found = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    program, poppler = next(filter(None, found), None), shutil.which("pdftoppm")
    if program is None or poppler is None:
        raise PhotographError("it needs Chromium and Poppler (Debian: chromium, poppler-utils)")
    pictures = [out / f"report{suffix}.png" for suffix in ("", "_phone", "_dark", "_print")]
    with tempfile.TemporaryDirectory() as folder:
        shot, frame, paper = (Path(folder) / name for name in ("shot.png", "frame.html", "paper"))
        url = page.resolve().as_uri()
        width, height = PHONE  # a window of Chromium is wider than a phone: take a frame in it
        frame.write_text(
            f'<body style="margin:0"><iframe src="{url}" width="{width}" height="{height}" '
            'style="border:0" scrolling="no"></iframe>'
        )
        desktop, dark = "--window-size={},{}".format(*DESKTOP), "preferredColorScheme=0"
        for flags, picture in (
            ((desktop, url), pictures[0]),
            ((f"--window-size=800,{height}", frame.as_uri()), pictures[1]),
            ((desktop, f"--blink-settings={dark}", url), pictures[2]),
        ):
            chromium(program, f"--screenshot={shot}", *flags)
            image = Image.open(shot).convert("RGB")
            save(image.crop((0, 0, width, height)) if picture == pictures[1] else image, picture)
        chromium(program, f"--print-to-pdf={paper}.pdf", "--no-pdf-header-footer", url)
        subprocess.run([poppler, "-r", "50", "-png", f"{paper}.pdf", str(paper)], check=True)
        sheets = [Image.open(sheet) for sheet in sorted(Path(folder).glob("paper*.png"))[:SHEETS]]
        whole = Image.new("RGB", (sum(s.width + 6 for s in sheets), sheets[0].height), "gray")
        for k, sheet in enumerate(sheets):
            whole.paste(sheet, (k * (sheet.width + 6), 0))
        save(whole, pictures[3])
    return pictures


def chromium(program: str, *flags: str) -> None:
    """Runs Chromium without a window.

    Raises:
        PhotographError: it fails, or takes more than a minute.
    """
    command = [
        program,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--allow-file-access-from-files",
        *flags,
    ]
    try:
        subprocess.run(command, check=True, timeout=PATIENCE, capture_output=True)
    except (OSError, subprocess.SubprocessError) as error:
        raise PhotographError(f"Chromium failed: {error}") from error


def photograph_run(name: str, out: Path, duration: float | None, at: float | None) -> list[Path]:
    """Runs a scenario and saves its pictures."""
    scenario, close = cli.load(name), name != PAPER
    if close:
        law = dataclasses.replace(scenario.identifier, law="efficient")
        scenario = dataclasses.replace(scenario, identifier=law, sensors="noisy", duration=DURATION)
    scenario = dataclasses.replace(scenario, duration=duration or scenario.duration)
    picture = out / f"{name}.png"
    with tempfile.TemporaryDirectory() as folder:
        result = run(scenario, Path(folder) / name)
        postprocessing.finish(result)
        moment = best_moment(result) if at is None else at
        photograph(result.folder / OutputFolder.RECORDING, picture, moment, close=close)
    return [picture, close_up(picture)] if close else [picture]


def main() -> int:
    """Takes the screenshots; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", help=f"scenarios (default: {' '.join(SCENARIOS)})")
    parser.add_argument(
        "--duration", type=float, help="of every run [s] (default: 30, the paper's)"
    )
    parser.add_argument("--at", type=float, help="time of the cursor [s] (default: a good one)")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of the pictures")
    parser.add_argument("--file", type=Path, help="take a screenshot of this recording instead")
    parser.add_argument("--report", type=Path, help="take screenshots of this page instead")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    try:
        if chosen.report:
            made = [photograph_report(chosen.report, chosen.out)]
        elif chosen.file:
            picture = chosen.out / f"{chosen.file.resolve().parent.name}.png"
            photograph(chosen.file, picture, chosen.at or 0.0, close=True)
            made = [[picture]]
        else:
            names = chosen.names or [name for name in SCENARIOS if name in scenarios()]
            made = (photograph_run(n, chosen.out, chosen.duration, chosen.at) for n in names)
        for pictures in made:
            for file in pictures:
                print(f"{file}  {file.stat().st_size // 1000} kB", flush=True)
    except NsaidError as error:
        print(f"screenshots: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
