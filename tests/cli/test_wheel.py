"""The built wheel in an environment of its own: it runs a scenario from an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from nsaid_mj.robots.assets import scenarios
from tests.support.faulty import CHECKOUT, FILES, strict


def call(*words: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PIP_"))}
    return subprocess.run(
        [str(word) for word in words],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env={**clean, "PYTHONUTF8": "1", "OMP_NUM_THREADS": "1", **more},
    )


def checkout() -> set[str]:
    """Names at the checkout's top, where a build would leave things."""
    return {path.name for path in CHECKOUT.iterdir()} | {
        str(path) for path in CHECKOUT.glob("dist/*")
    }


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, before = tmp_path_factory.mktemp("wheel"), checkout()
    built = call(
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        folder,
        CHECKOUT,
        cwd=folder,
    )
    assert built.returncode == 0, built.stderr
    assert checkout() - before == set()
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def binaries(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment with the wheel, and our own environment's dependencies."""
    home = tmp_path_factory.mktemp("environment") / "venv"
    venv.create(home, with_pip=False, symlinks=True)
    python = home / "bin" / "python"
    installed = call(
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        wheel,
        cwd=home,
    )
    assert installed.returncode == 0, installed.stderr
    (packages,) = home.glob("lib/python*/site-packages")
    ours = [path for path in sys.path if "site-packages" in path]  # pin has one of its own
    (packages / "dependencies.pth").write_text("\n".join(ours) + "\n")
    return home / "bin"


def test_the_wheel_has_scenarios_and_assets_and_nothing_made_by_running(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    packed = {Path(name).stem for name in names if name.startswith("nsaid_mj/_scenarios/")}
    assert packed == set(scenarios())
    here = {
        str(path.relative_to(CHECKOUT / "assets"))
        for path in (CHECKOUT / "assets").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {n.removeprefix("nsaid_mj/_assets/") for n in names if "/_assets/" in n} == here
    assert here
    assert [name for name in names if "/_kernels/" in name]
    pages = {path.name for path in (CHECKOUT / "nsaid_mj/report/templates").glob("*.*")}
    assert {Path(name).name for name in names if "/templates/" in name} == pages
    assert {"page.html", "plots.js"} <= pages
    assert all(name.startswith(("nsaid_mj/", "nsaid_mj-")) for name in names)
    assert not [name for name in names if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]
    assert [name for name in names if name.endswith("licenses/LICENSE")]


def test_the_wheel_environment_imports_the_wheels_package(binaries: Path, tmp_path: Path) -> None:
    question = "import nsaid_mj, sys; print(nsaid_mj.__file__); print(sys.path)"
    asked = call(binaries / "python", "-c", question, cwd=tmp_path)
    file, path = asked.stdout.splitlines()
    assert Path(file).is_relative_to(binaries.parent)
    assert repr(str(CHECKOUT)) not in path


def test_the_wheel_lists_and_runs_a_scenario_from_an_empty_folder(
    binaries: Path, tmp_path: Path
) -> None:
    listed = call(binaries / "nsaid", "list", cwd=tmp_path)
    assert (listed.returncode, listed.stderr) == (0, "")
    assert all(f"  {name}" in listed.stdout for name in scenarios())
    words = ("run", "scalar_rov", "--duration", "2", "--quiet")
    ran = call(binaries / "nsaid", *words, cwd=tmp_path)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    folder = tmp_path / "runs" / "scalar_rov-paper"
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    summary = strict((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["status"] == "completed" and summary["sim_s"] == pytest.approx(2.0)
    assert all((folder / name).stat().st_size > 0 for name in FILES)
