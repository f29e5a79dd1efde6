"""A vehicle is known by its file being there."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest

import nsaid_mj
from nsaid_mj.core import structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab import control, plants
from nsaid_mj.lab.control.driver import DriverConfig
from nsaid_mj.lab.plants.world.config import PlantConfig

PACKAGE = Path(nsaid_mj.__file__).parent

NEW_PLANT = '''"""A plant in a file of its own."""

from dataclasses import dataclass

from .scalar_rov import ScalarRovPlant


@dataclass(frozen=True)
class HoveringPlant(ScalarRovPlant):
    """The heave axis by another name."""
'''


def subclasses(base: type) -> set[type]:
    found = {base}
    for cls in base.__subclasses__():
        found |= subclasses(cls)
    return {cls for cls in found if cls.__module__.startswith("nsaid_mj.")}


def test_every_public_name_resolves_and_is_listed():
    assert set(nsaid_mj.__all__) <= set(dir(nsaid_mj))
    for name in nsaid_mj.__all__:
        assert getattr(nsaid_mj, name).__name__ == name


def test_the_log_the_multibody_systems_and_the_vehicles_are_public():
    expected = {
        "Log",
        "JointTree",
        "SingleBody",
        "NullspaceIdentifier",
        "BlueROV2Plant",
    }
    assert expected <= set(dir(nsaid_mj))


@pytest.mark.parametrize("base", [PlantConfig, SecondOrderSystem, DriverConfig])
def test_every_implementation_of_an_interface_is_public(base):
    for folder in (control, plants, structure):
        for file in walk_packages(folder.__path__, f"{folder.__name__}."):
            import_module(file.name)
    concrete = {cls for cls in subclasses(base) if not getattr(cls, "__abstractmethods__", None)}
    assert len(concrete) > 1
    for cls in concrete:
        line = f"from .{cls.__module__.removeprefix('nsaid_mj.')} import {cls.__name__}"
        found = getattr(nsaid_mj, cls.__name__, None)
        assert found is cls, f"add `{line} as {cls.__name__}` to nsaid_mj/__init__.pyi"


def test_a_new_file_in_plants_makes_a_plant_known(tmp_path):
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, tmp_path / "nsaid_mj", ignore=ignored)
    (tmp_path / "assets").symlink_to(PACKAGE.parent / "assets")
    (tmp_path / "nsaid_mj" / "lab" / "plants" / "hovering.py").write_text(
        NEW_PLANT, encoding="utf-8"
    )
    code = """
import sys; sys.path.insert(0, ".")
import nsaid_mj
assert "numpy" not in sys.modules
from nsaid_mj import Scenario
from nsaid_mj.lab.plants import HoveringPlant
scenario = Scenario(plant=HoveringPlant())
assert Scenario.from_json(scenario.to_json()) == scenario
print(nsaid_mj.__file__)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        timeout=120,
        check=False,
        env={"PATH": "", "PYTHONPATH": ""},
    )
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).is_relative_to(tmp_path)


def test_an_unknown_name_is_an_attribute_error():
    for module in (nsaid_mj, plants):
        with pytest.raises(AttributeError, match=r"attribute '?BlueROV3Plant"):
            _ = module.BlueROV3Plant
