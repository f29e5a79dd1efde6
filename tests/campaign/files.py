"""Damaged models, scripts, logs and maps; bombs; odd names; a user's own files and modules."""

from __future__ import annotations

import random
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.formats import limited_to
from nsaid_mj.clinic.logs.tables import read
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.robots.loading import load_robot
from tests.support import damaged

from ..support.faulty import NSAID, strict
from . import texts
from .commands import desk
from .tries import Draw, Kind, nsaid, typed


def _finite(numbers: Any) -> str:
    return "" if np.isfinite(numbers).all() else f"numbers that are not finite: {numbers}"


def _inertias(model: Any) -> list[np.ndarray]:
    return [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]


def model_files(kind: str, name: str) -> Draw:
    """A damaged model file of a kind is simulated, or read to be identified."""

    def draw(rng: random.Random, here: Path) -> Kind:
        path = here / name
        path.write_bytes(texts.damaged(kind, rng))

        def simulated() -> str:
            return _finite(ArmPlant(str(path)).build(1e-3, 0).truth)

        def floating() -> str:
            return _finite(_inertias(load_robot(str(path), "free").model))

        def modelled() -> str:
            robot = load_robot_model(str(path))
            if kind == "sheet":
                return _finite([] if robot.prior is None else robot.prior)
            own = (robot.damping, robot.friction, robot.rotor, robot.gain)
            wrong = _finite(_inertias(robot.model)) or _finite(own)
            return wrong or ("NaN" if np.isnan(robot.limits).any() else "")

        actions = (modelled,) if kind == "sheet" else (simulated, floating, modelled, modelled)
        action = rng.choice(actions)
        return Kind(f"{action.__name__}, {path.read_bytes()!r}", lambda: typed(action))

    return draw


def scripts(rng: random.Random, here: Path) -> Kind:
    """Scripts with errors in them, and drivers that return something else."""
    name = f"mine{rng.randrange(10**9)}.py"
    text = texts.damaged("script", rng)
    (here / name).write_bytes(text)
    words = ["run", name, "--quiet", "--out", "run"]

    def check() -> str:
        ended = nsaid(words, here)  # a script that exits with its own code is obeyed
        return "" if ended.wrong.startswith("exit code") and ended.err else ended.wrong

    return Kind(f"{text[-900:]!r}", check)


def logs(command: str) -> Draw:
    """`nsaid inspect` or `identify` on damaged logs and maps, with strict JSON."""

    def draw(rng: random.Random, here: Path) -> Kind:
        desk(here)
        log, table = texts.log(rng), texts.damaged("map", rng)
        (here / "log.csv").write_bytes(log)
        (here / "table.toml").write_bytes(table)
        words = [command, *(["--log"] if command == "identify" else []), "log.csv", "--json"]
        words += (
            rng.choice(([], ["--model", "two.urdf"]))
            if command == "inspect"
            else ["--model", "two.urdf"]
        )
        words += [*rng.choice(([], [], ["--map", "table.toml"])), "--out", "out"]

        def check() -> str:
            ended = nsaid(words, here)
            if not ended.wrong and ended.out.strip() and ended.code != 2:
                strict(ended.out)
            return ended.wrong

        return Kind(f"{' '.join(words)}, log {log[:300]!r}, map {table!r}", check)

    return draw


def binaries(rng: random.Random, here: Path) -> Kind:
    """A damaged log of any format is read, or refused with its name, and prints nothing."""
    kind = rng.choice(damaged.FORMATS)
    path = here / (kind if kind == "record.arrow" else f"log.{kind}")
    path.write_bytes(damaged.damage(damaged.good(kind), damaged.drawn(rng)))

    def check() -> str:
        damaged.end_of_reading(path)
        return ""

    return Kind(f"damaged {kind}", check)


def bombs(rng: random.Random, here: Path) -> Kind:
    """A small file that becomes a large one is refused by the limit."""
    kind, count = rng.choice(("gz", "npz", "parquet", "arrow")), rng.randrange(300_000, 3_000_000)
    path = here / f"log.{kind}"
    damaged.write_bomb(kind, path, count)

    def check() -> str:
        with limited_to(1e6):
            try:
                read(path)
            except UnusableLog as error:
                return "" if "--limit" in str(error) else f"refused otherwise: {error}"
        return "it was read"

    return Kind(f"bomb of {count} numbers, {kind}", check)


# -- names -----------------------------------------------------------------------------------------

_NAMES = (
    "universe",
    "world",
    "a---b",
    "a---><link name='evil'/>",
    "[/red]",
    "\x1b[31mq",
    "\x9b2J",
    "q\u202eevil",
    "{{ 7 }}",
    "<script>",
    "&amp;",
    "../../x",
    "a" * 3000,
    "%s%n",
    "名",
)


def names(rng: random.Random, here: Path) -> Kind:
    """Odd names of columns and joints are data on the terminal, in JSON, and in maps."""
    column, joint = rng.choice(_NAMES), rng.choice(_NAMES)
    plain = "".join(c for c in joint if c.isprintable())  # XML holds no control characters
    plain = plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    (here / "two.urdf").write_text(texts.URDF.replace('"j1"', f'"{plain}"'), encoding="utf-8")
    rows = "".join(f"{0.01 * k:.2f},{k % 7},{k % 5},{k % 3}\n" for k in range(200))
    head = f't,"{column}","q_{column}",tau_j2\n'
    (here / "log.csv").write_text(head + rows, encoding="utf-8")
    words = ["inspect", "log.csv", "--out", "out"]
    words += rng.choice(([], ["--model", "two.urdf"])) + rng.choice(([], ["--json"]))

    def check() -> str:
        ended = nsaid(words, here)
        if any(control in ended.out + ended.err for control in "\x1b\x9b\u202e"):
            return "a control character reaches the terminal"
        if "--json" in words and ended.code != 2:
            strict(ended.out)
        return ended.wrong

    return Kind(f"names {column[:20]!r} and {joint[:20]!r}", check)


_ODD = (
    "-x",
    "[red]",
    "a\nb",
    "\udcff",
    " ",
    "~",
    "*",
    "{}",
    "a" * 240,
    "é",
    "$(touch pwned)",
    "<img src=x onerror=alert(1)>",
    "{{ 7 }}",
    "%s%n",
    "\x1b[31m",
    "; touch pwned",
    "'",
    '"',
    "a:b",
    "a b",
    "..",
    "#",
    "&amp;",
    "\u202egnp",
    "run",
    "ur5",
    "--",
    "`touch pwned`",
    "\\",
)
_SHORT = ("--duration", "0.1", "--held-out", "0.05", "--pe-window", "0.05")


def file_names(rng: random.Random, here: Path) -> Kind:
    """Odd names of files and folders are names: on the terminal, in pages, and on command lines."""
    log, model, out = (f"{rng.choice(_ODD)}{end}" for end in (".csv", ".urdf", ""))
    place = here / "here"
    place.mkdir()
    desk(place, log, model)
    words = rng.choice(
        (
            ["inspect", "--model", f"./{model}", f"./{log}"],
            ["identify", "--model", f"./{model}", "--log", f"./{log}"],
            ["run", "arm", "--robot", f"./{model}", *_SHORT],
        )
    )
    words += ["--out", f"./{out}" if out != ".." else "./x"]

    def check() -> str:
        ended = nsaid(words, place)
        if ended.wrong:
            return ended.wrong
        if any(control in ended.out + ended.err for control in ("\x1b[31m", "\u202e")):
            return "a control character of a name reaches the terminal"
        if (place / "pwned").exists():
            return "a name was executed"
        pages = [page for page in place.rglob("*.html") if "<img src=x" in page.read_text("utf-8")]
        return "markup of a name is in the page" if pages else ""

    return Kind(" ".join(words), check)


# -- a user's own ----------------------------------------------------------------------------------

_OWN = (
    "report.html",
    "map.toml",
    "map-new.toml",
    "inspection.html",
    "run.rrd",
    "two.xml",
    "two-calibrated.urdf",
    "calibrated.yaml",
    "summary.txt",
    "rows.txt",
    "motion.csv",
    "compare.csv",
    "scenario.py",
    "montecarlo.parquet",
    "sysid.yaml",
)
_COMMANDS = (
    ("inspect", "log.csv"),
    ("inspect", "log.csv", "--model", "two.urdf"),
    ("run", "scalar_rov", *_SHORT),
    ("verify", "scalar_rov", *_SHORT),
    ("identify", "--model", "two.urdf", "--log", "log.csv"),
    ("sweep", "scalar_rov", *_SHORT, "--seeds", "1", "--jobs", "1"),
    ("montecarlo", "scalar_rov", *_SHORT, "--runs", "1", "--jobs", "1"),
    ("compare", "scalar_rov", "--durations", "0.2", "--seeds", "0:1", "--methods", "paper"),
    ("excite", "--model", "two.urdf", "--duration", "x"),
)


def own_files(rng: random.Random, here: Path) -> Kind:
    """No command overwrites what it did not make; inputs stay even with --force."""
    desk(here)
    mine = here / rng.choice((".", "mine"))
    mine.mkdir(exist_ok=True)
    for name in rng.sample(_OWN, rng.choice((1, 1, 3))):
        (mine / name).write_text(f"dear: {name}", encoding="utf-8")
    (here / "link").symlink_to(mine)
    places = (".", "link", str(mine), "two.urdf", "log.csv/x", "link/..", "./mine/../link")
    words = [*rng.choice(_COMMANDS), "--out", rng.choice(places)]
    if forced := rng.random() < 0.2 and words[0] in ("run", "identify"):
        words.append("--force")
    kept = [here / "log.csv", here / "two.urdf"]
    kept += [] if forced else [path for path in mine.iterdir() if path.name in _OWN]
    before = {path: path.read_bytes() for path in kept}

    def check() -> str:
        wrong = nsaid(words, here).wrong
        lost = [p.name for p, b in before.items() if not p.is_file() or p.read_bytes() != b]
        return wrong or (f"overwritten: {', '.join(lost)}" if lost else "")

    return Kind(f"{' '.join(words)} beside {', '.join(sorted(p.name for p in kept))}", check)


_POISON = ("json", "numpy", "pydantic", "pyarrow", "rich", "typing", "numba", "scipy", "tyro")


def poisoned(rng: random.Random, here: Path) -> Kind:
    """Modules of the current folder are not imported."""
    chosen = rng.sample(_POISON, 3)
    for name in chosen:
        text = f"open({str(here / 'trace')!r}, 'a').write({name!r})\n"
        (here / f"{name}.py").write_text(text, encoding="utf-8")
    (here / "log.csv").write_text("t,q\n0,1\n1,2\n2,3\n", encoding="utf-8")
    words = rng.choice((("list",), ("inspect", "log.csv"), ("identify", "--log", "log.csv")))

    def check() -> str:
        ran = subprocess.run([NSAID, *words], cwd=here, capture_output=True, check=False)
        if (here / "trace").exists():
            return f"imported: {(here / 'trace').read_text(encoding='utf-8')}"
        return "" if ran.returncode in (0, 1, 2) else f"exit code {ran.returncode}"

    return Kind(f"{words[0]} beside {', '.join(chosen)}", check)


FAMILIES: dict[str, Draw] = {
    "urdfs": model_files("urdf", "robot.urdf"),
    "MJCF files": model_files("mjcf", "robot.xml"),
    "vehicles' sheets": model_files("sheet", "vehicle.toml"),
    "scripts": scripts,
    "logs": logs("inspect"),
    "identifications": logs("identify"),
    "damaged binaries": binaries,
    "bombs": bombs,
    "names": names,
    "file names": file_names,
    "user's files": own_files,
    "poisoned folders": poisoned,
}
